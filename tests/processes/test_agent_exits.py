"""An agent process exits on SIGTERM, whatever its behaviour does, and its last command is zero."""

from __future__ import annotations

import asyncio
import json
import re
import signal
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from muro_zenoh import channels
from muro_zenoh.channels import ALL_ROLES
from muro_zenoh.config import as_table, parse_scenario
from muro_zenoh.messages import Behaviour, PoseFix, StopOrder, VelocityCommand
from muro_zenoh.runtime.process import FAILED, OK
from muro_zenoh.transport import Bus, Every, open_bus
from tests.support.process import Process
from tests.support.router import router
from tests.support.waiting import seconds, within

OURS = """
import asyncio
import time

async def deaf(robot):
    while True:
        try:
            await asyncio.sleep(0.01)
        except asyncio.CancelledError:
            pass
        robot.drive(0.2, 0.0)

async def polite(robot):
    async for _ in robot.estimates():
        robot.drive(0.2, 0.0)

async def blocked(robot):
    driven = 0
    async for _ in robot.estimates():
        robot.drive(0.2, 0.0)
        driven += 1
        if driven == 20:
            print("BLOCKED", flush=True)
            time.sleep(3600)
"""

COVARIANCE = (1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 1e-5)


@asynccontextmanager
async def driving_agent(folder: Path, behaviour: str) -> AsyncIterator[tuple[Process, Every[VelocityCommand]]]:
    """An agent process that drives, and every command that it sends; poses and orders come from the test."""
    (folder / "ours.py").write_text(OURS)
    with router() as there:
        table = {"robots": 1, "separation": {"enabled": False}, "bus": {"mode": "client", "connect": [there.endpoint]}}
        file = folder / "lab.json"
        file.write_text(json.dumps(as_table(parse_scenario(table, "lab.json", name="lab"))))
        async with open_bus(there.settings(), *ALL_ROLES) as bus:
            commands = bus.every(channels.CMD_VEL, "r1", depth=8192)
            feeding = asyncio.create_task(_feed(bus, f"ours:{behaviour}"))
            with Process(["-m", "muro_zenoh", "agent", str(file), "r1"], name=behaviour) as agent:
                try:
                    agent.ready()
                    await within(20, _first_that_drives(commands), "a command that drives")
                    yield agent, commands
                finally:
                    feeding.cancel()
                    await asyncio.wait({feeding})


async def _feed(bus: Bus, behaviour: str) -> None:
    poses, stop = bus.publisher(channels.POSE, "r1"), bus.publisher(channels.STOP)
    order = bus.publisher(channels.BEHAVIOUR, "r1")
    while True:
        poses.put(
            PoseFix(age=0.05, x=0.0, y=0.0, theta=0.0, covariance=(1e-6, 0, 0, 0, 1e-6, 0, 0, 0, 1e-5), camera="c")
        )
        stop.put(StopOrder(all=False, revision=1))
        order.put(Behaviour(behaviour=behaviour, revision=1))
        await asyncio.sleep(0.05)


async def _first_that_drives(commands: Every[VelocityCommand]) -> None:
    async for received in commands:
        if received.message.v:
            return


async def _until_it_ends(agent: Process, limit: float) -> None:
    end = time.monotonic() + seconds(limit)
    while agent.running:
        assert time.monotonic() < end, f"still there after {seconds(limit):g} s\n{agent.last_lines()}"
        await asyncio.sleep(0.01)


@pytest.mark.parametrize(("behaviour", "code"), [("polite", OK), ("deaf", FAILED)])
async def test_an_agent_ends_and_its_last_command_is_zero(behaviour: str, code: int, tmp_path: Path) -> None:
    async with driving_agent(tmp_path, behaviour) as (agent, commands):
        agent.send(signal.SIGTERM)
        await _until_it_ends(agent, 3)
        await asyncio.sleep(0.2)  # until its messages have arrived
        last = commands.drain()[-1].message
        assert (last.v, last.omega) == (0.0, 0.0)
        assert agent.wait() == code
        said = agent.last_lines()
        assert ("ended by force" in said) == (behaviour == "deaf")
        if behaviour == "deaf":
            assert "ours:deaf" in said


@pytest.mark.slow
async def test_an_agent_whose_behaviour_blocks_its_loop_ends_and_says_where(tmp_path: Path) -> None:
    async with driving_agent(tmp_path, "blocked") as (agent, _):
        agent.line("BLOCKED")
        agent.send(signal.SIGTERM)
        await _until_it_ends(agent, 12)
        assert agent.wait() == FAILED
        assert re.search(r'ours\.py", line \d+ in blocked', agent.last_lines())
