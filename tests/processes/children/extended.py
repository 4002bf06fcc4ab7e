"""Uses one addition of ``docs/architecture.md``, named by its argument, in the extended copy of the packages."""

from __future__ import annotations

import asyncio
import sys
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest

from agents.simulator import Room
from basestation.station import Station
from basestation.tasks.vision import cameras_on_bus
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.channels.page import page
from muro_zenoh.config import Scenario, load_scenario, parse_scenario
from muro_zenoh.errors import ConfigError
from muro_zenoh.messages import Goal, SetBehaviour
from muro_zenoh.runtime.virtual_time import InlineExecutor, VirtualClock, run_virtually
from muro_zenoh.scoring.expectations import expectation_of
from muro_zenoh.scoring.observed import Observed
from muro_zenoh.scoring.score import score_run
from muro_zenoh.supervision.preflight import check_can_run
from muro_zenoh.transport import MemoryNetwork, make_bus
from tests.support.memory_fleet import memory_fleet, scenario

LAB = Path("lab.toml")


def lab(table: dict[str, Any]) -> Scenario:
    return parse_scenario({"camera": {"north": {}}, **table}, "lab.toml", name="lab")


def refuse(table: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        check_can_run(lab(table), "lab.toml")


def behaviour() -> None:
    """A run accepts it, a base station accepts the order, a fleet runs it, its score sheet shows the circle."""
    wanted = lab({"behaviour": {"name": "patrol", "pace": 0.12}})
    check_can_run(wanted, "lab.toml")
    assert expectation_of(wanted).follows_circle
    refuse({"behaviour": {"name": "patrol", "pace": -0.1}}, r"behaviour\.pace: got -0\.1 .*above 0 \[m/s\]")

    async def main() -> None:
        async with memory_fleet(scenario(2, "hold")) as fleet:
            patrol = SetBehaviour(behaviour="patrol", parameters={"pace": 0.12})
            await fleet.order(channels.SET_BEHAVIOUR, patrol)
            assert "pace" in await fleet.refusal(
                channels.SET_BEHAVIOUR, SetBehaviour(behaviour="patrol", parameters={"pace": "slow"})
            )
            await asyncio.sleep(25.0)
            assert {health.state for health in fleet.healths.values()} == {"patrol"}
            for name in ("r1", "r2"):
                assert fleet.radius_error(name) < 0.01
                assert fleet.speed(name) == pytest.approx(0.12, abs=0.02)

    run_virtually(main())


def channel() -> None:
    """Its writers may publish on it, its readers receive it, and it is on the page."""
    home = channels.HOME  # type: ignore[attr-defined]  # it is there in the copy
    assert home in channels.CHANNELS

    async def main() -> None:
        network, clock = MemoryNetwork(), VirtualClock()
        async with AsyncExitStack() as stack:
            operator, agent = [
                await stack.enter_async_context(make_bus(network.link(), roles=(role,), clock=clock))
                for role in (Role.OPERATOR, Role.AGENT)
            ]
            operator.publisher(home, "r1").put(Goal(x=1.0, y=0.5))
            received = await agent.latest(home, "r1").next()  # late, and it is a kept channel
            assert (received.message.x, received.message.y) == (1.0, 0.5)
            with pytest.raises(ConfigError, match="channel home: got a process with the role agent to publish on it"):
                agent.publisher(home, "r1")

    run_virtually(main())
    assert "| `muro/home/<robot>` | Goal | operator | agent/control |" in page(Path("docs/channels.md").read_text())


def setting() -> None:
    """A fleet file sets it, and a wrong one is refused with its unit."""
    LAB.write_text("[all]\nmass = 2.5\n[robot.r1]\ntag = 0\n[robot.r2]\ntag = 1\nmass = 4.0\n")
    robots = load_scenario(LAB).robot
    assert [robots[name].mass for name in ("r1", "r2")] == [2.5, 4.0]  # type: ignore[attr-defined]
    refuse({"all": {"mass": -1.0}}, r"all\.mass: got -1\.0 .*above 0 and at most 100 \[kg\]")


def check() -> None:
    """A run is checked by it: in the unit of its limit, which differs from the report's."""
    for limit, passed in ((0.004, True), (0.002, False)):
        wanted = lab({"checks": {"pose_to_command_p99": limit}})
        seen = Observed(wanted.name, wanted.robots, 60.0, expectation_of(wanted), pose_to_command=[0.003] * 10)
        sheet = score_run(seen, wanted.checks)
        assert sheet.checks["pose_to_command_p99"].value == pytest.approx(0.003)
        assert sheet.passed is passed
    refuse({"checks": {"pose_to_command_p99": 0}}, r"checks\.pose_to_command_p99: got 0 .*above 0 \[s\]")


def camera() -> None:
    """The simulator renders it, and the base station sees the robots in its pictures."""
    small = "width = 640\nheight = 480\n"
    LAB.write_text(f"robots = 2\n[camera.north]\n{small}{LAB.read_text()}")
    wanted = load_scenario(LAB)
    check_can_run(wanted, "lab.toml")
    south = wanted.camera["south"]
    assert (south.width, south.height) == (960, 720)

    async def main() -> None:
        network, clock = MemoryNetwork(), VirtualClock()
        async with AsyncExitStack() as stack:
            room, station, observer = [
                await stack.enter_async_context(make_bus(network.link(), clock=clock)) for _ in range(3)
            ]
            fixes = observer.every(channels.POSE, "*", depth=1024)
            mains = [
                Room(room, wanted, seed=3, executor=InlineExecutor()).run(),
                Station(station, wanted, None, cameras_on_bus(station, wanted, InlineExecutor())).run(),
            ]
            tasks = [asyncio.create_task(main) for main in mains]
            await asyncio.sleep(1.0)
            assert not any(task.done() for task in tasks), tasks
            for task in tasks:
                task.cancel()
            await asyncio.wait(tasks)
            seen = {(fix.name, camera) for fix in fixes.drain() for camera in fix.message.camera.split("+")}
            assert seen == {(robot, name) for robot in wanted.robots for name in ("north", "south")}

    run_virtually(main())


if __name__ == "__main__":
    {"behaviour": behaviour, "channel": channel, "setting": setting, "check": check, "camera": camera}[sys.argv[1]]()
