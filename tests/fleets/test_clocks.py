"""Machines whose clocks disagree or that are suspended, and cameras of others: robots drive; in virtual time."""

from __future__ import annotations

import asyncio
import math
import random
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass

import msgpack  # type: ignore[import-untyped]  # it publishes no types
import msgspec
import pytest

from agents.simulated_camera import SimulatedCamera
from agents.simulator import Room
from muro_zenoh import channels
from muro_zenoh.config import Scenario, parse_scenario
from muro_zenoh.config.cameras import camera_model
from muro_zenoh.geometry import wrap_to_pi
from muro_zenoh.messages import Frame, Reply, Truth, VelocityCommand, decode, encode
from muro_zenoh.runtime.virtual_time import InlineExecutor, VirtualClock, run_virtually
from muro_zenoh.transport import Bus, Latest, MemoryNetwork
from muro_zenoh.transport.link import Closable, Question
from muro_zenoh.transport.memory_faults import Delay
from muro_zenoh.transport.memory_link import MemoryLink
from tests.support.memory_lab import Lab, agent, basestation, memory_lab, simulator

CAMERA = {"rate": 10, "jpeg_quality": 0}
ALL = {"tag_x": -0.03, "tag_y": 0.02, "tag_yaw": 0.2}


def scenario(**cameras: object) -> Scenario:
    """Two robots on a circle."""
    table = {"robots": 2, "all": ALL, "camera": cameras, "behaviour": {"name": "circle", "speed": 0.25}}
    return parse_scenario(table, "lab.toml", name="lab")


ONE = scenario(north=CAMERA)
OVERLAP = 0.3


def half(left: float, right: float) -> dict[str, object]:
    """A camera over a part of the floor."""
    pixels = [[0, 719], [1279, 719], [1279, 0], [0, 0]]
    return {**CAMERA, "pixels": pixels, "metres": [[left, -1.5], [right, -1.5], [right, 1.5], [left, 1.5]]}


TWO = scenario(west=half(-2.3, OVERLAP), east=half(-OVERLAP, 2.3))


@dataclass
class Observer:
    """What is seen of the robots, by nobody's clock."""

    lab: Lab
    truth: Latest[Truth]
    commands: Latest[VelocityCommand]

    def driving(self) -> bool:
        """Whether both robots really drive."""
        truth = self.truth.values()
        return len(truth) == 2 and all(abs(received.message.v) > 0.05 for received in truth.values())

    def commanded(self) -> bool:
        """Whether the newest command of any robot is not zero."""
        return any(c.message.v or c.message.omega for c in self.commands.values().values())

    def radius_error(self) -> float:
        """Largest true distance from the circle [m]."""
        return max(abs(math.hypot(t.message.x, t.message.y) - 0.8) for t in self.truth.values().values())

    async def until_driving(self, limit: float) -> float:
        """Wait until both drive; how long it took [s]."""
        loop = asyncio.get_running_loop()
        began = loop.time()
        while not self.driving():
            assert loop.time() - began < limit, [self.lab.reasons(name) for name in ("basestation", "r1", "r2")]
            await asyncio.sleep(0.02)
        return loop.time() - began


@asynccontextmanager
async def observed() -> AsyncIterator[Observer]:
    async with memory_lab() as there:
        yield Observer(there, there.bus.latest(channels.TRUTH, "*"), there.bus.latest(channels.CMD_VEL, "*"))


async def on_the_circle(seen: Observer) -> None:
    await seen.until_driving(5)
    await asyncio.sleep(15.0)
    for _ in range(20):
        await asyncio.sleep(0.1)
        assert seen.radius_error() < 0.02
        assert seen.driving()


@pytest.mark.parametrize(
    "offsets", [(0.0, 0.0, 0.0, 0.0), (5.0, -40.0, 1000.0, -3.0), (-7.0, 0.4, -0.4, 86400.0)], ids=str
)
def test_machines_whose_clocks_disagree_drive_alike(offsets: Sequence[float]) -> None:
    """A machine each for the room with its camera, the base station and the two agents."""

    async def main() -> None:
        async with observed() as seen:
            room, station, r1, r2 = map(VirtualClock, offsets)
            seen.lab.start(ONE, simulator, clock=room)
            seen.lab.start(ONE, basestation, clock=station)
            seen.lab.start(ONE, agent("r1"), clock=r1)
            seen.lab.start(ONE, agent("r2"), clock=r2)
            await on_the_circle(seen)

    run_virtually(main())


def test_two_cameras_hand_robots_over_to_each_other() -> None:
    """Each sees a half of the floor, and a strip of the other's; on machines with different clocks."""

    async def main() -> None:
        async with observed() as seen:
            seen.lab.start(TWO, simulator, clock=VirtualClock(11.0))
            seen.lab.start(TWO, basestation)
            seen.lab.start(TWO, agent("r1"), agent("r2"))
            poses = seen.lab.bus.every(channels.POSE, "r1", depth=4096)
            await on_the_circle(seen)
            await asyncio.sleep(12.0)
            assert seen.radius_error() < 0.02
            cameras = [(fix.message.camera, fix.message.x) for fix in poses.drain()]
            assert {camera for camera, x in cameras if x < -OVERLAP} == {"west"}
            assert {camera for camera, x in cameras if x > OVERLAP} == {"east"}
            between = {camera for camera, x in cameras if abs(x) < OVERLAP - 0.2}
            assert between >= {"west+east", "east+west"}, "one fix of both, first the camera whose frame it is"

    run_virtually(main())


class ForeignCamera:
    """Stands in for a publisher: sends frames as another lab's program does, with its own clock and without epoch."""

    def __init__(self, network: MemoryNetwork, offset: float) -> None:
        self._network = network
        self.offset = offset

    def put(self, frame: Frame) -> None:
        sent = {"stamp": frame.stamp + self.offset, "width": frame.width, "height": frame.height}
        payload = msgpack.packb({**sent, "format": frame.format, "data": frame.data})
        self._network.put("muro/camera/north", payload)


def others_camera(lab: Lab, offset: float) -> ForeignCamera:
    """Start a room whose camera is another lab's program."""
    blind, frames = scenario(), ForeignCamera(lab.network, offset)

    async def room(bus: Bus, settings: Scenario) -> None:
        there = Room(bus, settings, 1, InlineExecutor())
        camera = SimulatedCamera(
            frames,  # type: ignore[arg-type]  # it has a publisher's put()
            ONE.camera["north"],
            camera_model("north", ONE.camera["north"], ONE.arena),
            ONE,
            there.floor,
            1,
            InlineExecutor(),
        )
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(there.run())
            tasks.create_task(camera.run())

    lab.start(blind, room)
    return frames


@pytest.mark.parametrize("offset", [-40.0, 0.0, 3.0])
def test_a_camera_of_others_with_a_clock_of_its_own(offset: float) -> None:
    async def main() -> None:
        async with observed() as seen:
            others_camera(seen.lab, offset)
            seen.lab.start(ONE, basestation, agent("r1"), agent("r2"))
            await on_the_circle(seen)

    run_virtually(main())


@pytest.mark.parametrize("step", [-40.0, -1.0, 1.0, 40.0])
def test_a_camera_of_others_whose_clock_is_set(step: float) -> None:
    """It has no epoch, so that nothing tells a clock that was set from a picture that is late."""

    async def main() -> None:
        async with observed() as seen:
            camera = others_camera(seen.lab, 0.0)
            seen.lab.start(ONE, basestation, agent("r1"), agent("r2"))
            await on_the_circle(seen)
            camera.offset += step
            await asyncio.sleep(3.0)
            await seen.until_driving(1)
            await asyncio.sleep(10.0)
            assert seen.driving()
            assert seen.radius_error() < 0.03

    run_virtually(main())


def test_a_machine_that_comes_back_with_another_clock() -> None:
    """The room's host restarts forty seconds behind, then a day ahead."""

    async def main() -> None:
        async with observed() as seen:
            seen.lab.start(ONE, basestation, agent("r1"), agent("r2"))
            for offset in (0.0, -40.0, 86400.0):
                room = seen.lab.start(ONE, simulator, clock=VirtualClock(offset))
                await seen.until_driving(6)
                await asyncio.sleep(3.0)
                assert seen.driving()
                room.cancel()
                await asyncio.sleep(1.0)
                assert not seen.commanded()

    run_virtually(main())


def test_after_a_suspend_nothing_old_is_driven_on_and_the_robots_go_on() -> None:
    """All clocks jump, as they do when the machine was suspended: what was sent before is a minute old."""

    async def main() -> None:
        async with observed() as seen:
            clock = VirtualClock()
            seen.lab.start(ONE, simulator, basestation, agent("r1"), agent("r2"), clock=clock)
            await on_the_circle(seen)
            await asyncio.sleep(0.6)
            before = {name: truth.message for name, truth in seen.truth.values().items()}
            clock.offset += 60.0
            await asyncio.sleep(0.12)  # a beat of the bases, and a tick of the agents
            assert not seen.commanded()
            assert await seen.until_driving(3) < 3.0
            for name, then in before.items():
                now = seen.truth.values()[name].message
                turned = abs(wrap_to_pi(math.atan2(now.y, now.x) - math.atan2(then.y, then.x)))
                assert turned < 1.0  # not a minute's way: 18 rad
            await asyncio.sleep(5.0)
            assert seen.radius_error() < 0.03

    run_virtually(main())


# ---- the clocks are compared, and what the comparison is used for


@pytest.mark.parametrize("offset", [0.03, -0.03, 40.0, -40.0])
def test_a_clock_that_is_off_is_measured_and_named_and_the_robot_drives(offset: float) -> None:
    async def main() -> None:
        async with observed() as seen:
            seen.lab.start(ONE, simulator, basestation, agent("r1"))
            seen.lab.start(ONE, agent("r2"), clock=VirtualClock(offset))
            await seen.until_driving(5)
            await asyncio.sleep(2.0)
            right, off = seen.lab.health("r1"), seen.lab.health("r2")
            assert right.complaints == ()
            assert right.numbers["clock_offset_s"] == pytest.approx(0.0, abs=1e-3)
            assert off.numbers["clock_offset_s"] == pytest.approx(-offset, abs=1e-3)
            assert off.numbers["clock_round_trip_s"] == pytest.approx(0.0, abs=1e-3)
            assert off.numbers["clock_bound_s"] < 1e-3
            (complaint,) = off.complaints
            words = f"{abs(offset):g} s" if abs(offset) > 1 else f"{1e3 * abs(offset):.0f} ms"
            assert (
                complaint == f"clock {words} {'ahead of' if offset > 0 else 'behind'} the base station's (limit 20 ms)"
            )
            assert off.reasons == ()
            assert seen.driving()

    run_virtually(main())


@pytest.mark.parametrize("step", [0.08, -0.08, 1.0, -1.0])
def test_a_clock_that_is_set_is_named_within_two_seconds(step: float) -> None:
    async def main() -> None:
        async with observed() as seen:
            clock = VirtualClock()
            seen.lab.start(ONE, simulator, basestation, agent("r1"))
            seen.lab.start(ONE, agent("r2"), clock=clock)
            await seen.until_driving(5)
            await asyncio.sleep(3.0)
            clock.offset += step
            await asyncio.sleep(2.2)
            words = f"{abs(step):g} s" if abs(step) >= 1 else f"{1e3 * abs(step):.0f} ms"
            named = f"clock was set {words} {'forward' if step > 0 else 'back'} against the base station's"
            assert any(named in complaint for complaint in seen.lab.health("r2").complaints)
            assert seen.lab.health("r1").complaints == ()
            clock.offset -= step
            await asyncio.sleep(12.5)
            assert seen.lab.health("r2").complaints == ()

    run_virtually(main())


def slow_link(lab: Lab, there: float, back: float) -> MemoryLink:
    """A link on which everything takes its time, to the others and back [s]."""
    link = lab.network.link()
    link.begin(Delay(random.Random(1), there), "out")
    link.begin(Delay(random.Random(1), back), "in")
    return link


class Believed:
    """How old the robot's agent takes its poses for, and how old they are."""

    def __init__(self, seen: Observer) -> None:
        self._healths = seen.lab.bus.every(channels.HEALTH, "r2", depth=1024)

    async def from_now_on(self) -> None:
        """Forget all that was reported before."""
        await asyncio.sleep(2.0)
        self._healths.drain()

    def ages(self) -> list[float]:
        """Since the last call [s]."""
        return [age for health in self._healths.drain() for age in health.message.samples["pose_age_s"]]


@pytest.mark.parametrize("offset", [0.0, 40.0])
@pytest.mark.parametrize(("there", "back"), [(0.1, 0.1), (0.0, 0.2), (0.2, 0.0)])
def test_a_delay_that_all_poses_have_is_in_their_age_up_to_half_of_the_asymmetry(
    offset: float, there: float, back: float
) -> None:
    async def main() -> None:
        async with observed() as seen:
            seen.lab.start(ONE, simulator, basestation, agent("r1"))
            seen.lab.start(
                ONE, agent("r2"), clock=VirtualClock(offset), link=slow_link(seen.lab, there=there, back=back)
            )
            await seen.until_driving(6)
            believed = Believed(seen)
            await believed.from_now_on()
            await asyncio.sleep(3.0)
            ages = believed.ages()
            assert min(ages) == pytest.approx(0.05 + 0.5 * (there + back), abs=0.01)
            assert max(ages) < 0.05 + 0.5 * (there + back) + 0.08

    run_virtually(main())


def test_a_robot_whose_poses_are_always_too_old_stands_still() -> None:
    """Half a second on the way is more than the limit, and was so from the beginning."""

    async def main() -> None:
        async with observed() as seen:
            seen.lab.start(ONE, simulator, basestation, agent("r1"))
            seen.lab.start(ONE, agent("r2"), link=slow_link(seen.lab, there=0.5, back=0.5))
            await asyncio.sleep(4.0)
            truth = seen.truth.values()
            assert truth["r1"].message.v > 0.05
            assert truth["r2"].message.v == 0.0
            assert "no pose for 0." in seen.lab.reasons("r2")[0]

    run_virtually(main())


class StationLink(MemoryLink):
    """The base station's link; what it answers about the time is changed, or lost."""

    def __init__(self, network: MemoryNetwork, lie: Callable[[Reply], Reply | None]) -> None:
        super().__init__(network, frozenset(), {})
        self.lie = lie

    def answer(self, key: str, file: Callable[[Question], None]) -> Closable:
        if not key.endswith("/time"):
            return super().answer(key, file)
        return super().answer(key, lambda question: file(_Lied(question, self)))


class _Lied:
    def __init__(self, question: Question, link: StationLink) -> None:
        self._question, self._link = question, link
        self.payload, self.encoding = question.payload, question.encoding

    def reply(self, payload: bytes, encoding: str) -> None:
        reply = self._link.lie(decode(payload, Reply))
        if reply is not None:
            self._question.reply(encode(reply), encoding)


def shifted(by: float) -> Callable[[Reply], Reply]:
    return lambda reply: msgspec.structs.replace(reply, received=reply.received + by, stamp=reply.stamp + by)


@pytest.mark.parametrize("lie", [-40.0, -1.0, -0.2, 0.2, 1.0, 40.0])
def test_a_base_station_that_lies_about_its_time_makes_no_pose_younger(lie: float) -> None:
    """Ahead, its poses seem old to the agents; behind, the pictures seem old to itself."""

    async def main() -> None:
        async with observed() as seen:
            station = StationLink(seen.lab.network, lambda reply: reply)
            seen.lab.start(ONE, basestation, link=station)
            seen.lab.start(ONE, simulator, agent("r1"), agent("r2"))
            await seen.until_driving(5)
            believed = Believed(seen)
            await believed.from_now_on()
            await asyncio.sleep(2.0)
            honest = min(believed.ages())
            station.lie = shifted(lie)
            await asyncio.sleep(3.0)
            await believed.from_now_on()
            await asyncio.sleep(1.0)
            ages = believed.ages()
            assert not ages or min(ages) > honest - 0.005
            assert abs(lie) < 1.0 or not seen.driving()
            assert any("clock" in complaint for complaint in seen.lab.health("r2").complaints)

    run_virtually(main())


def test_a_base_station_that_does_not_tell_the_time_is_named_and_what_it_said_stays_true() -> None:
    async def main() -> None:
        async with observed() as seen:
            station = StationLink(seen.lab.network, lambda reply: reply)
            seen.lab.start(ONE, basestation, link=station)
            seen.lab.start(ONE, simulator, agent("r1"))
            seen.lab.start(ONE, agent("r2"), link=slow_link(seen.lab, there=0.05, back=0.05))
            await seen.until_driving(5)
            believed = Believed(seen)
            await believed.from_now_on()
            station.lie = lambda reply: None
            await asyncio.sleep(20.0)
            assert min(believed.ages()) > 0.09
            (complaint,) = seen.lab.health("r2").complaints
            assert "clock not compared: the base station has not answered for" in complaint
            assert seen.driving()

    run_virtually(main())


def test_a_camera_whose_frames_are_slow_from_the_beginning_is_as_late_as_it_is() -> None:
    """Its configured latency is the least; what its link adds was invisible before the clocks were compared."""

    async def main() -> None:
        async with observed() as seen:
            seen.lab.start(ONE, simulator, link=slow_link(seen.lab, there=0.15, back=0.15))
            seen.lab.start(ONE, basestation, agent("r1"), agent("r2"))
            await seen.until_driving(6)
            believed = Believed(seen)
            await believed.from_now_on()
            await asyncio.sleep(3.0)
            assert min(believed.ages()) > 0.19

    run_virtually(main())
