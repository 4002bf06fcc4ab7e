"""Machines whose clocks disagree or that are suspended, and cameras of others: robots drive; in virtual time."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass

import msgpack  # type: ignore[import-untyped]  # it publishes no types
import pytest

from agents.simulated_camera import SimulatedCamera
from agents.simulator import Room
from muro_zenoh import channels
from muro_zenoh.config import Scenario, parse_scenario
from muro_zenoh.config.cameras import camera_model
from muro_zenoh.geometry import wrap_to_pi
from muro_zenoh.messages import Frame, Truth, VelocityCommand
from muro_zenoh.runtime.virtual_time import InlineExecutor, VirtualClock, run_virtually
from muro_zenoh.transport import Bus, Latest, MemoryNetwork
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
