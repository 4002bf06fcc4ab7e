"""A process on its own reports within a few seconds what it waits for: once in its log, and in its health."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any

import pytest

from agents.agent import Agent
from agents.simulator import Room
from basestation.station import Station
from basestation.tasks.vision import cameras_on_bus
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import Scenario, parse_scenario
from muro_zenoh.messages import Health
from muro_zenoh.runtime.virtual_time import InlineExecutor, VirtualClock, run_virtually
from muro_zenoh.transport import Bus, Latest, MemoryNetwork, make_bus

CAMERA = {"rate": 5}
LAB = parse_scenario({"robots": 2, "camera": {"north": CAMERA}}, "lab.toml", name="lab")
NO_CAMERA = parse_scenario({"robots": 1, "behaviour": {"name": "circle"}}, "lab.toml", name="lab")
BLIND = parse_scenario(  # its camera looks at another floor than the one where the robots are
    {
        "robots": 1,
        "camera": {
            "north": {
                **CAMERA,
                "pixels": [[0, 0], [1279, 0], [1279, 719], [0, 719]],
                "metres": [[50, 53], [54, 53], [54, 50], [50, 50]],
            }
        },
        "behaviour": {"name": "circle"},
    },
    "lab.toml",
    name="lab",
)

Main = Callable[[Bus, Scenario], Coroutine[Any, Any, None]]


def agent(bus: Bus, scenario: Scenario) -> Coroutine[Any, Any, None]:
    bus.announce(Role.AGENT, "r1")
    return Agent(bus, scenario, "r1").run()


def other_agent(bus: Bus, scenario: Scenario) -> Coroutine[Any, Any, None]:
    bus.announce(Role.AGENT, "r2")
    return Agent(bus, scenario, "r2").run()


def basestation(bus: Bus, scenario: Scenario) -> Coroutine[Any, Any, None]:
    return Station(bus, scenario, None, cameras_on_bus(bus, scenario, InlineExecutor())).run()


def simulator(bus: Bus, scenario: Scenario) -> Coroutine[Any, Any, None]:
    return Room(bus, scenario, 1, InlineExecutor()).run()


class Lab:
    """Processes on one network, and their reports."""

    def __init__(self, network: MemoryNetwork, healths: Latest[Health], tasks: asyncio.TaskGroup) -> None:
        self._network = network
        self._healths = healths
        self._tasks = tasks
        self._running: list[asyncio.Task[None]] = []

    def start(self, scenario: Scenario, *mains: Main) -> None:
        for main in mains:
            self._running.append(self._tasks.create_task(self._run(main, scenario)))

    async def _run(self, main: Main, scenario: Scenario) -> None:
        async with make_bus(self._network.link(), clock=VirtualClock()) as bus:
            await main(bus, scenario)

    def reasons(self, name: str) -> tuple[str, ...]:
        """Why a process cannot work, from its newest health."""
        return self._healths.values()[name].message.reasons

    def end(self) -> None:
        for task in self._running:
            task.cancel()


@asynccontextmanager
async def lab() -> AsyncIterator[Lab]:
    network = MemoryNetwork()
    async with make_bus(network.link(), clock=VirtualClock()) as bus, asyncio.TaskGroup() as tasks:
        there = Lab(network, bus.latest(channels.HEALTH, "*"), tasks)
        try:
            yield there
        finally:
            there.end()


@pytest.mark.parametrize(
    ("main", "name", "line", "reasons"),
    [
        (
            basestation,
            "basestation",
            "waiting: ",
            ("no agent of r1", "no agent of r2", "no frames from camera north yet"),
        ),
        (simulator, "simulator", "waiting: ", ("no commands for r1 r2: waiting for their agents",)),
        (
            agent,
            "r1",
            "stationary: ",
            (
                "no stop state received yet: waiting for the base station",
                "no pose yet: waiting for a camera to see this robot",
                "no behaviour yet",
            ),
        ),
    ],
)
def test_a_process_alone_says_what_it_waits_for(
    main: Main, name: str, line: str, reasons: tuple[str, ...], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)

    async def run() -> None:
        async with lab() as there:
            there.start(LAB, main)
            await asyncio.sleep(5.0)
            assert there.reasons(name) == reasons
            await asyncio.sleep(30.0)
            assert there.reasons(name) == reasons

    run_virtually(run())
    assert [message for message in caplog.messages if message.startswith(line)] == [line + "; ".join(reasons)]


@pytest.mark.parametrize(
    ("scenario", "missing"),
    [
        (NO_CAMERA, "no camera in the settings: no robot drives without poses"),
        (BLIND, "no camera has seen r1 yet"),
    ],
)
def test_robots_that_no_camera_sees(scenario: Scenario, missing: str, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)

    async def run() -> None:
        async with lab() as there:
            there.start(scenario, simulator, basestation, agent)
            await asyncio.sleep(6.0)
            assert there.reasons("basestation") == (missing,)
            assert there.reasons("r1") == ("no pose yet: waiting for a camera to see this robot",)
            assert there.reasons("simulator") == ()  # zero is a command, too

    run_virtually(run())
    assert caplog.messages.count(f"waiting: {missing}") == 1
    assert caplog.messages.count("stationary: no pose yet: waiting for a camera to see this robot") == 1


def test_a_missing_process_is_reported_when_it_ends_and_when_it_is_back(caplog: pytest.LogCaptureFixture) -> None:
    """Each episode has a line for its beginning and one for its end."""
    caplog.set_level(logging.INFO)

    async def run() -> None:
        async with lab() as there:
            there.start(LAB, simulator)
            await asyncio.sleep(5.0)
            there.start(LAB, basestation)
            await asyncio.sleep(5.0)
            there.start(LAB, agent, other_agent)
            await asyncio.sleep(5.0)
            assert (there.reasons("simulator"), there.reasons("basestation")) == ((), ())

    run_virtually(run())
    said = [message for message in caplog.messages if message.startswith(("waiting", "every", "nothing"))]
    assert said[:2] == [
        "waiting: no commands for r1 r2: waiting for their agents",
        "waiting: no agent of r1; no agent of r2",
    ]
    assert sorted(said[2:]) == ["every robot receives commands", "nothing is missing now"]
