"""A fleet in one process and in virtual time: real agents, bases and base station on the in-memory bus.

The processes are put together as on real computers; only the floor, the wheels and the cameras are simulated.
"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable, Coroutine
from types import TracebackType
from typing import Any, Self

import numpy as np

from agents.agent import Agent
from agents.base.run import run_bases
from agents.base.simulated import make_plant
from basestation.station import Station
from muro_zenoh.channels import ALL_ROLES, Role
from muro_zenoh.checking.camera import SightingCamera, SightingsOnBus, View
from muro_zenoh.checking.process import Process
from muro_zenoh.checking.witness import Witnesses
from muro_zenoh.checking.world import GuardedWheels, World
from muro_zenoh.config import CameraSettings, Scenario
from muro_zenoh.config.faults import Place
from muro_zenoh.runtime.virtual_time import VirtualClock
from muro_zenoh.transport import Bus, MemoryNetwork, draw_epoch, make_bus
from muro_zenoh.transport.measured_clock import StationClock
from muro_zenoh.transport.memory_link import Witness

BASESTATION = "basestation"
_BASES = "bases"
_AGENT = "/agent"

_RESTART = 0.5
"""Time after which a process that has ended by itself is started anew [s], as ``muro run`` does."""


class VirtualFleet:
    """The fleet. In its block the floor is there; :meth:`start` starts the processes, and all end after the block.

    A robot that a fault names has a base process of its own, as a real one has; all others share one, as in ``muro
    sim``.

    Args:
        scenario: the settings; its faults are applied by :mod:`muro_zenoh.checking.faults`.
        seed: of everything that is random.
        restart: whether a process that ends by itself is started anew, as by ``muro run``.

    Attributes:
        scenario: the settings.
        network: what the processes share.
        clock: the true one.
        world: the robots and the floor.
        view: what the cameras do not see.
        processes: by name, in the order of their start.
        witnesses: what looks at the messages that reach the robots.
        station: the base station of the newest start.
        operator: an operator's bus.
        ends: the processes that ended by themselves: when [s since the start], which, and why.
        begun: when it was made [s, loop].
    """

    station: Station

    def __init__(self, scenario: Scenario, seed: int, *, restart: bool = False) -> None:
        self.scenario = scenario
        self.network = MemoryNetwork()
        self.clock = VirtualClock()
        self.view = View()
        self.processes: dict[str, Process] = {}
        self.witnesses = Witnesses(scenario.robots)
        self.ends: list[tuple[float, str, BaseException | None]] = []
        self._seed = seed
        self._restart = restart
        self._epochs = random.Random(seed)
        plant = make_plant(scenario, self.generator("plant"), count_contacts=False)
        self.world = World(plant, self.clock, scenario.timeouts.command)
        self.begun = asyncio.get_running_loop().time()
        self._buses: list[Bus] = []
        self.operator = self.open_bus()
        self._floor: asyncio.Task[None] | None = None
        self._put_together()

    def generator(self, what: str) -> np.random.Generator:
        """A generator of this seed.

        Args:
            what: for what; each has its own, so that one that draws more does not change the others.
        """
        return np.random.default_rng([self._seed, *what.encode()])

    @property
    def elapsed(self) -> float:
        """Time since the start [s]."""
        return asyncio.get_running_loop().time() - self.begun

    @property
    def cameras(self) -> dict[str, CameraSettings]:
        """The cameras by name; one that is not in the scenario, where it has none."""
        return self.scenario.camera or {"north": CameraSettings()}

    # ---- the processes

    def _put_together(self) -> None:
        own = {fault.robot for fault in self.scenario.faults}
        if any(fault.place is Place.ROUTER for fault in self.scenario.faults):
            own = set(self.scenario.robots)
        self.add(BASESTATION, self._put_station, (Role.BASESTATION,), (BASESTATION,))
        shared = tuple(name for name in self.scenario.robots if name not in own)
        if shared:
            self._add_bases(_BASES, shared)
        for name in self.scenario.robots:
            if name in own:
                self._add_bases(f"{name}/base", (name,))
        for name in self.cameras:
            self._add_camera(name)
        for name in self.scenario.robots:
            self._add_agent(name)
        self.world.has_base = self._has_base

    def _has_base(self, row: int) -> bool:
        base = self.base_of(self.scenario.robots[row])
        return base.running and not base.frozen

    async def start(self, *, agents: bool = True) -> None:
        """Start the processes.

        Args:
            agents: whether those of the agents too.
        """
        for process in list(self.processes.values()):
            if agents or not process.name.endswith(_AGENT):
                process.start()
        await asyncio.sleep(0.001)  # from now on the base station answers

    def add(
        self,
        name: str,
        main: Callable[[Bus], Coroutine[Any, Any, None]],
        roles: tuple[Role, ...],
        computers: tuple[str, ...],
        witnesses: dict[str, Witness] | None = None,
    ) -> Process:
        """Add a process, which is not started yet.

        Args:
            name: its name.
            main: puts it together.
            roles: what it is.
            computers: where it runs.
            witnesses: what looks at the messages that reach it, by key expression.
        """
        process = Process(
            self.network,
            name,
            main,
            roles=roles,
            computers=computers,
            rng=self._epochs,
            witnesses=witnesses,
        )
        process.ended = lambda error: self._note_end(name, error)
        self.processes[name] = process
        return process

    def _note_end(self, name: str, error: BaseException | None) -> None:
        self.ends.append((self.elapsed, name, error))
        if self._restart:
            self.processes[name].start_after_end(_RESTART)

    def _put_station(self, bus: Bus) -> Coroutine[Any, Any, None]:
        sources = [
            SightingsOnBus(bus, name, camera.latency, self.scenario.robots, self.witnesses.located)
            for name, camera in self.cameras.items()
        ]
        self.station = Station(bus, self.scenario, None, sources)
        bus.announce(Role.BASESTATION, BASESTATION)
        return self.station.run()

    def _add_agent(self, name: str) -> None:
        def put(bus: Bus) -> Coroutine[Any, Any, None]:
            agent = Agent(bus, self.scenario, name)
            bus.announce(Role.AGENT, name)
            return agent.run()

        self.add(f"{name}{_AGENT}", put, (Role.AGENT,), (name,), self.witnesses.of_agent(name))

    def _add_bases(self, process_name: str, names: tuple[str, ...]) -> None:
        rows = [self.scenario.robots.index(name) for name in names]

        def put(bus: Bus) -> Coroutine[Any, Any, None]:
            wheels = {name: GuardedWheels(self.world, row) for name, row in zip(names, rows, strict=True)}

            def cut() -> None:
                for guarded in wheels.values():
                    guarded.cut()

            process.killed = cut
            for name in names:
                bus.announce(Role.BASE, name)
            limits = {name: self.scenario.robot[name].wheels for name in names}
            bases = run_bases(bus, wheels, bus.clock, self.scenario.timeouts.command, limits)
            return self._with_clock(bus, bases)

        process = self.add(process_name, put, (Role.BASE,), names, self.witnesses.of_bases(names))

    def _add_camera(self, name: str) -> None:
        rng = self.generator(f"camera {name}")
        settings, latency = self.cameras[name], self.scenario.simulation.camera_latency

        def put(bus: Bus) -> Coroutine[Any, Any, None]:
            robots = self.scenario.robots
            camera = SightingCamera(bus, name, settings, self.world, self.view, robots, latency, rng)
            return self._with_clock(bus, camera.run())

        self.add(f"camera/{name}", put, (Role.CAMERA,), (f"camera/{name}",))

    async def _with_clock(self, bus: Bus, work: Coroutine[Any, Any, None]) -> None:
        """A process's work, and its clock compared with the base station's."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(work, name="work")
            tasks.create_task(StationClock(bus, self.scenario.clocks).run(), name="clock")

    def base_of(self, name: str) -> Process:
        """The process of a robot's base.

        Args:
            name: the robot's.
        """
        return self.processes.get(f"{name}/base") or self.processes[_BASES]

    def open_bus(self, *roles: Role) -> Bus:
        """A bus of another process, such as a tool's; by default with every role. It is closed with the fleet.

        Args:
            roles: what it is.
        """
        bus = make_bus(self.network.link(), roles=roles or ALL_ROLES, clock=self.clock, epoch=draw_epoch(self._epochs))
        self._buses.append(bus)
        return bus

    async def __aenter__(self) -> Self:
        self._floor = asyncio.create_task(self.world.run(), name="floor")
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.end()
        for bus in self._buses:
            await bus.close()
        if self._floor is not None:
            self._floor.cancel()
            await asyncio.wait({self._floor})

    async def end(self) -> None:
        """End all processes, the agents first, and wait for them."""
        for agents in (True, False):
            tasks = []
            for name, process in self.processes.items():
                if name.endswith(_AGENT) is agents and process.task is not None:
                    process.end_for_good()
                    tasks.append(process.task)
            if tasks:
                await asyncio.wait(tasks)
