"""The processes of a lab on the in-memory bus, in virtual time, each with a clock of its own; cameras take pictures."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager

from agents.agent import Agent
from agents.simulator import Room
from basestation.station import Station
from basestation.tasks.vision import cameras_on_bus
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import Scenario
from muro_zenoh.messages import Health
from muro_zenoh.runtime.clock import Clock
from muro_zenoh.runtime.virtual_time import InlineExecutor, VirtualClock
from muro_zenoh.transport import Bus, Latest, MemoryNetwork, make_bus
from muro_zenoh.transport.memory_link import MemoryLink

Main = Callable[[Bus, Scenario], Awaitable[None]]
"""The main task of a process."""


def agent(name: str) -> Main:
    """An agent's process.

    Args:
        name: the robot's.
    """

    async def run(bus: Bus, scenario: Scenario) -> None:
        bus.announce(Role.AGENT, name)
        await Agent(bus, scenario, name).run()

    return run


async def basestation(bus: Bus, scenario: Scenario) -> None:
    """The base station's process."""
    await Station(bus, scenario, None, cameras_on_bus(bus, scenario, InlineExecutor())).run()


async def simulator(bus: Bus, scenario: Scenario) -> None:
    """The simulator's process."""
    await Room(bus, scenario, 1, InlineExecutor()).run()


class Lab:
    """Processes on one network, and their healths. Made by :func:`memory_lab`.

    Attributes:
        network: what they share.
        bus: an observer's.
    """

    def __init__(self, network: MemoryNetwork, bus: Bus, tasks: asyncio.TaskGroup) -> None:
        self.network = network
        self.bus = bus
        self._healths: Latest[Health] = bus.latest(channels.HEALTH, "*")
        self._tasks = tasks
        self._running: list[asyncio.Task[None]] = []

    def start(
        self, scenario: Scenario, *mains: Main, clock: Clock | None = None, link: MemoryLink | None = None
    ) -> asyncio.Task[None]:
        """Start processes of one machine; the last one's task, for a test that ends it.

        Args:
            scenario: their settings.
            mains: what they run.
            clock: of that machine; one that is right by default.
            link: of the process, where it is only one; one without delay by default.
        """
        for main in mains:
            running = self._run(main, scenario, clock or VirtualClock(), link or self.network.link())
            self._running.append(self._tasks.create_task(running))
        return self._running[-1]

    async def _run(self, main: Main, scenario: Scenario, clock: Clock, link: MemoryLink) -> None:
        async with make_bus(link, clock=clock) as bus:
            await main(bus, scenario)

    def health(self, name: str) -> Health:
        """A process's newest health."""
        return self._healths.values()[name].message

    def reasons(self, name: str) -> tuple[str, ...]:
        """Why a process does not do its work, by its newest health."""
        return self.health(name).reasons

    def end(self) -> None:
        """Cancel all processes."""
        for task in self._running:
            task.cancel()


@asynccontextmanager
async def memory_lab() -> AsyncIterator[Lab]:
    """A lab without processes; all that are started are gone at the end of the block."""
    network = MemoryNetwork()
    async with make_bus(network.link(), clock=VirtualClock()) as bus, asyncio.TaskGroup() as tasks:
        there = Lab(network, bus, tasks)
        try:
            yield there
        finally:
            there.end()
