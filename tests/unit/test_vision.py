"""A camera on the bus as a source of sightings: capture time, frames that cannot be used, what is wrong with tags."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator
from concurrent.futures import Executor
from contextlib import asynccontextmanager
from typing import Any

import numpy as np
import pytest

from basestation.localization.localizer import Localizer
from basestation.localization.sightings import Sightings
from basestation.station import Station
from basestation.tasks import vision
from basestation.tasks.vision import cameras_on_bus
from muro_zenoh import channels
from muro_zenoh.config import Scenario, parse_scenario
from muro_zenoh.config.cameras import camera_model
from muro_zenoh.errors import ConfigError
from muro_zenoh.messages import Clear, Frame
from muro_zenoh.runtime.virtual_time import InlineExecutor, VirtualClock, run_virtually
from muro_zenoh.simulation.camera import OverheadCamera
from muro_zenoh.transport import Bus, MemoryNetwork, make_bus
from muro_zenoh.transport.delay import UNMEASURED

POSE = (0.3, 0.1, 0.2)
LAB = parse_scenario({"robots": 1, "camera": {"north": {}}}, "lab.toml", name="lab")
_RENDERER = OverheadCamera(camera_model("north", LAB.camera["north"], LAB.arena), noise=3.0)
_RNG = np.random.default_rng(1)


def picture(stamp: float = 0.0, lab: Scenario = LAB, pose: tuple[float, float, float] = POSE) -> Frame:
    """A frame that shows robot r1."""
    robot = lab.robot["r1"]
    grey = _RENDERER.render(np.array([pose]), [robot.mount], [robot.radius], _RNG)
    return Frame(stamp=stamp, width=1280, height=720, format="grey", data=grey.tobytes())


@pytest.fixture(autouse=True)
def known(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cameras that never say how their clocks differ, and have been there for long."""
    monkeypatch.setattr(vision, "UNMEASURED", 0.0)


class Watched:
    """The sightings of one camera, as they come."""

    def __init__(self, bus: Bus, lab: Scenario, executor: Executor) -> None:
        (source,) = cameras_on_bus(bus, lab, executor)
        self.seen: list[Sightings] = []
        self.task = asyncio.create_task(self._watch(aiter(source)))

    async def _watch(self, sightings: AsyncIterator[Sightings]) -> None:
        async for each in sightings:
            self.seen.append(each)


@asynccontextmanager
async def watched(lab: Scenario = LAB) -> AsyncIterator[tuple[Bus, Watched]]:
    """A camera's bus, and what is seen by it."""
    network, clock = MemoryNetwork(), VirtualClock()
    async with make_bus(network.link(), clock=clock) as room, make_bus(network.link(), clock=clock) as bus:
        watcher = Watched(bus, lab, InlineExecutor())
        await asyncio.sleep(0)
        try:
            yield room, watcher
        finally:
            watcher.task.cancel()
            await asyncio.wait({watcher.task})


def test_a_frame_was_captured_its_cameras_latency_before_the_quickest_one_arrives() -> None:
    lab = parse_scenario({"robots": 1, "camera": {"north": {"latency": 0.03}}}, "lab.toml", name="lab")
    ahead = 7.0  # the camera's clock

    async def main() -> None:
        async with watched(lab) as (room, watcher):
            frames = room.publisher(channels.CAMERA, "north")
            for extra in (0.0, 0.02, 0.0, 0.1):
                captured = room.clock.now()
                await asyncio.sleep(0.03 + extra)
                frames.put(picture(captured + ahead, lab))
                await asyncio.sleep(0.001)
                seen = watcher.seen[-1]
                assert (seen.camera, seen.frame, [robot.name for robot in seen.robots]) == ("north", "good", ["r1"])
                assert seen.captured == pytest.approx(captured, abs=1e-5)
                assert seen.robots[0].pose == pytest.approx(POSE, abs=0.01)

    run_virtually(main())


def test_two_cameras_with_clocks_and_latencies_of_their_own_give_fixes_of_the_right_age() -> None:
    clocks = {"north": 0.0, "south": -7.0}  # the south camera's computer is seven seconds behind
    latencies = {"north": 0.05, "south": 0.12}
    table = {"robots": 1, "camera": {name: {"latency": latency} for name, latency in latencies.items()}}
    lab = parse_scenario(table, "lab.toml", name="lab")

    async def main() -> None:
        network, clock = MemoryNetwork(), VirtualClock()
        async with make_bus(network.link(), clock=clock) as room, make_bus(network.link(), clock=clock) as bus:
            task = asyncio.create_task(Station(bus, lab, None, cameras_on_bus(bus, lab, InlineExecutor())).run())
            frames = {name: room.publisher(channels.CAMERA, name) for name in latencies}
            fixes, positions = room.every(channels.POSE, "r1"), room.latest(channels.ALL_POSITIONS)
            await asyncio.sleep(0.1)
            for _ in range(10):
                for name, latency in latencies.items():
                    frames[name].put(picture(clock.now() - latency + clocks[name], lab))
                    await asyncio.sleep(0.025)
            received = [fix.message for fix in fixes.drain()]
            # One of them leads; what the other sees of the same robot weighs in.
            assert len(received) == 10
            for fix in received:
                leader = fix.camera.partition("+")[0]
                assert leader == received[0].camera
                assert fix.age == pytest.approx(latencies[leader], abs=1e-4)
                assert fix.stamp == pytest.approx(clock.now(), abs=1.0), "by the base station's clock"
            newest = positions.get()
            assert newest is not None
            # The north's newest frame was captured later than the south's, though it arrived earlier.
            assert newest.message.robots[0].age == pytest.approx(0.075, abs=1e-4)
            task.cancel()
            await asyncio.wait({task})

    run_virtually(main())


def test_pictures_are_not_used_before_the_cameras_clock_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its link may have been slow from the start. One that never says it is used after five seconds."""
    monkeypatch.setattr(vision, "UNMEASURED", UNMEASURED)

    async def used(known_from: float) -> list[bool]:
        network, clock = MemoryNetwork(), VirtualClock()
        async with make_bus(network.link(), clock=clock) as room, make_bus(network.link(), clock=clock) as bus:
            watcher = Watched(bus, LAB, InlineExecutor())
            await asyncio.sleep(0)
            frames = room.publisher(channels.CAMERA, "north")
            for k in range(55):
                if 0.1 * k >= known_from:
                    bus.clocks.note(room.epoch, 0.0, clock.now())
                frames.put(picture(clock.now()))
                await asyncio.sleep(0.1)
            watcher.task.cancel()
            await asyncio.wait({watcher.task})
            complaints = {text for seen in watcher.seen for text in seen.complaints}
            assert complaints <= {"camera north: its clock is not known yet"}
            return [seen.frame == "good" for seen in watcher.seen]

    assert run_virtually(used(0.0)) == [True] * 55
    assert run_virtually(used(0.95)) == [False] * 10 + [True] * 45
    assert run_virtually(used(math.inf)) == [False] * 50 + [True] * 5


def test_a_camera_that_is_stuck_gives_no_poses(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        async with watched() as (room, watcher):
            frames = room.publisher(channels.CAMERA, "north")
            stuck = picture()
            for frame in (stuck, stuck, stuck, picture(), stuck):
                frames.put(frame)
                await asyncio.sleep(0.05)
            # The first, the new one, and one that is not like the one before.
            assert [seen.frame for seen in watcher.seen] == ["good", "bad", "bad", "good", "good"]
            assert [len(seen.robots) for seen in watcher.seen] == [1, 0, 0, 1, 1]
            assert "is the camera stuck?" in watcher.seen[1].complaints[0]
            assert sum("is the camera stuck?" in record.message for record in caplog.records) == 1

    run_virtually(main())


def test_frames_that_come_late_are_not_searched() -> None:
    async def main() -> None:
        async with watched() as (room, watcher):
            frames = room.publisher(channels.CAMERA, "north")
            for late in (0.0, 0.1, 0.8):
                frames.put(picture(room.clock.now() - 0.05 - late))
                await asyncio.sleep(0.05)
            assert [seen.frame for seen in watcher.seen] == ["good", "good", "stale"]
            assert watcher.seen[2].complaints == ("camera north: frames arrive 0.8 s late",)
            assert watcher.seen[2].robots == ()

    run_virtually(main())


@pytest.mark.parametrize(("late", "searched"), [(0.49, True), (0.51, False)])
def test_a_frame_is_searched_up_to_half_a_second_after_its_time(
    late: float, searched: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    pictures = 0
    locate = Localizer.locate

    def counting(self: Localizer, grey: Any) -> Any:
        nonlocal pictures
        pictures += 1
        return locate(self, grey)

    monkeypatch.setattr(Localizer, "locate", counting)

    async def main() -> None:
        async with watched() as (room, watcher):
            frames = room.publisher(channels.CAMERA, "north")
            for delay in (0.0, late):
                frames.put(picture(room.clock.now() - 0.05 - delay))
                await asyncio.sleep(0.05)
            assert [seen.frame for seen in watcher.seen] == ["good", "good" if searched else "stale"]
            assert pictures == (2 if searched else 1)

    run_virtually(main())


def test_a_frame_that_is_old_once_it_is_searched_gives_no_poses() -> None:
    """As when this process is suspended in between."""

    class Suspended(InlineExecutor):
        def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Any:
            done = super().submit(fn, *args, **kwargs)
            later: Any = type(done)()
            asyncio.get_running_loop().call_later(0.6, later.set_result, done.result())
            return later

    async def main() -> None:
        network, clock = MemoryNetwork(), VirtualClock()
        async with make_bus(network.link(), clock=clock) as room, make_bus(network.link(), clock=clock) as bus:
            watcher = Watched(bus, LAB, Suspended())
            await asyncio.sleep(0)
            room.publisher(channels.CAMERA, "north").put(picture(clock.now() - 0.05))
            await asyncio.sleep(1.0)
            assert [(seen.frame, seen.robots) for seen in watcher.seen] == [("stale", ())]
            watcher.task.cancel()
            await asyncio.wait({watcher.task})

    run_virtually(main())


def test_health_counts_the_frames_and_repeats_the_complaints() -> None:
    lab = parse_scenario(
        {"robots": 1, "all": {"tag_size": 0.3}, "camera": {"north": {}}}, "lab.toml", name="lab"
    )  # the tags seen are of 0.16 m

    async def main() -> None:
        network, clock = MemoryNetwork(), VirtualClock()
        async with make_bus(network.link(), clock=clock) as room, make_bus(network.link(), clock=clock) as bus:
            task = asyncio.create_task(Station(bus, lab, None, cameras_on_bus(bus, lab, InlineExecutor())).run())
            health = room.latest(channels.HEALTH, "basestation")
            frames = room.publisher(channels.CAMERA, "north")
            await asyncio.sleep(0.1)
            for frame in (picture(), Frame(width=1280, height=720, format="jpeg", data=b"noise"), picture()):
                frames.put(frame)
                await asyncio.sleep(0.05)
            frames.put(picture(room.clock.now() - 2.0))
            await asyncio.sleep(0.05)
            frames.put(picture())
            await asyncio.sleep(1.0)
            reported = health.get()
            assert reported is not None
            numbers = reported.message.numbers
            assert (numbers["frames"], numbers["bad_frames"], numbers["stale_frames"]) == (4.0, 1.0, 1.0)
            assert any("m: check its tag_size" in reason for reason in reported.message.reasons)
            task.cancel()
            await asyncio.wait({task})

    run_virtually(main())


def test_a_robot_that_jumps_is_on_health_and_not_on_pose_until_it_is_cleared() -> None:
    async def main() -> None:
        network, clock = MemoryNetwork(), VirtualClock()
        async with make_bus(network.link(), clock=clock) as room, make_bus(network.link(), clock=clock) as bus:
            task = asyncio.create_task(Station(bus, LAB, None, cameras_on_bus(bus, LAB, InlineExecutor())).run())
            health, poses = room.latest(channels.HEALTH, "basestation"), room.every(channels.POSE, "r1")
            frames = room.publisher(channels.CAMERA, "north")
            await asyncio.sleep(1.0)
            for pose in (POSE, POSE, *[(-1.7, -1.0, 0.2)] * 4):  # it is looked for everywhere after a while
                frames.put(picture(pose=pose))
                await asyncio.sleep(0.05)
            assert [fix.message.pose for fix in poses.drain()] == [pytest.approx(POSE, abs=0.01)] * 2
            await asyncio.sleep(1.0)
            reported = health.get()
            assert reported is not None
            assert any("m from where it was" in reason for reason in reported.message.reasons), reported.message.reasons
            assert reported.message.numbers["disbelieved"] >= 1.0
            assert (await room.ask(channels.CLEAR, Clear(name="r1"))).accepted
            frames.put(picture(pose=(-1.7, -1.0, 0.2)))
            await asyncio.sleep(0.05)
            assert len(poses.drain()) == 1
            task.cancel()
            await asyncio.wait({task})

    run_virtually(main())


def test_a_camera_with_tags_of_an_unknown_family_is_a_wrong_setting() -> None:
    table = {"robots": 1, "camera": {"north": {"family": "DICT_9X9_9"}}}
    wrong = parse_scenario(table, "lab.toml", name="lab")

    async def main() -> None:
        async with make_bus(MemoryNetwork().link()) as bus:
            with pytest.raises(ConfigError, match=r"camera\.north\.family: got 'DICT_9X9_9'"):
                cameras_on_bus(bus, wrong, InlineExecutor())

    run_virtually(main())
