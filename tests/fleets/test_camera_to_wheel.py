"""The simulator's room, the base station and the agents on the in-memory bus: from rendered frame to wheel, at once."""

from __future__ import annotations

import asyncio
import math
from contextlib import AsyncExitStack

import pytest

from agents.agent import Agent
from agents.base.run import run_base_process
from agents.simulator import Room
from basestation.station import Station
from basestation.tasks.vision import cameras_on_bus
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import parse_scenario
from muro_zenoh.errors import ConfigError
from muro_zenoh.messages import Clear
from muro_zenoh.runtime.virtual_time import InlineExecutor, VirtualClock, run_virtually
from muro_zenoh.transport import MemoryNetwork, make_bus

LAB = parse_scenario(
    {
        "robots": 2,
        "all": {"tag_x": -0.03, "tag_y": 0.02, "tag_yaw": 0.2},
        "camera": {"north": {}},
        "behaviour": {"name": "pursuit"},
    },
    "lab.toml",
    name="lab",
)


def test_two_robots_go_to_the_circle_and_spread_by_what_the_camera_sees() -> None:
    async def main() -> None:
        network, clock = MemoryNetwork(), VirtualClock()
        async with AsyncExitStack() as stack:
            buses = [await stack.enter_async_context(make_bus(network.link(), clock=clock)) for _ in range(5)]
            room = Room(buses[0], LAB, seed=3, executor=InlineExecutor())
            station = Station(buses[1], LAB, None, cameras_on_bus(buses[1], LAB, InlineExecutor()))
            mains = [room.run(), station.run()]
            for bus, name in zip(buses[2:4], LAB.robots, strict=True):
                mains.append(Agent(bus, LAB, name).run())
                bus.announce(Role.AGENT, name)
            observer = buses[4]
            fixes = observer.every(channels.POSE, "*", depth=4096)
            snapshots = observer.latest(channels.ALL_POSITIONS)
            tasks = [asyncio.create_task(main) for main in mains]
            try:
                await asyncio.sleep(14.0)
                assert not any(task.done() for task in tasks), tasks
                for x, y, _ in room.plant.pose.tolist():
                    assert math.hypot(x, y) == pytest.approx(0.8, abs=0.03)
                angles = [math.atan2(y, x) for x, y, _ in room.plant.pose.tolist()]
                assert abs((angles[1] - angles[0]) % math.tau - math.pi) < 0.1
                got = fixes.drain()
                for name in LAB.robots:
                    assert sum(fix.name == name for fix in got) > 0.95 * 14 * 20
                assert {fix.message.camera for fix in got} == {"north"}
                # One clock for all: a frame arrives after the simulated latency, and is searched in no time.
                assert {round(fix.message.age, 3) for fix in got} == {LAB.simulation.camera_latency}
                shown = [fix.message.stamp - fix.message.age for fix in got]  # captured: on the plant's steps of 10 ms
                assert max(abs(t * 100 - round(t * 100)) for t in shown) < 0.1
                said = snapshots.get()
                assert said is not None
                assert [(r.name, r.state) for r in said.message.robots] == [("r1", "tracking"), ("r2", "tracking")]
                assert [r.v for r in said.message.robots] == pytest.approx([0.2, 0.2], abs=0.03)
                assert (await observer.ask(channels.CLEAR, Clear(name="r1"))).accepted
            finally:
                for task in tasks:
                    task.cancel()
                await asyncio.wait(tasks)
            assert room.floor.commands.tolist() == [[0.0, 0.0], [0.0, 0.0]]

    run_virtually(main())


async def test_a_robot_that_the_settings_do_not_have_is_a_wrong_setting() -> None:
    async with make_bus(MemoryNetwork().link()) as bus:
        with pytest.raises(ConfigError, match="got 'r9', expected one of r1, r2"):
            Agent(bus, LAB, "r9")
    with pytest.raises(ConfigError, match="got 'r9', expected one of r1, r2"):
        await run_base_process(LAB, "r9")
