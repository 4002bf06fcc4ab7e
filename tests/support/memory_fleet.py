"""A fleet on the in-memory bus: real agents, bases on simulated wheels, and the real base station without pictures."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any, TypeVar

import numpy as np

from agents.agent import Agent
from agents.base.run import run_bases
from agents.base.simulated import Floor, SimulatedWheels
from basestation.fleet.state_store import StateStore
from basestation.localization.sightings import Sighting, Sightings
from basestation.station import Station
from muro_zenoh import channels
from muro_zenoh.channels import ALL_ROLES, Channel, Role, Verb
from muro_zenoh.config import Scenario, parse_scenario
from muro_zenoh.control import ring
from muro_zenoh.geometry import Circle, Pose2
from muro_zenoh.messages import Health, Message, Reply
from muro_zenoh.runtime.virtual_time import VirtualClock
from muro_zenoh.simulation.plant import Plant
from muro_zenoh.simulation.starts import random_starts
from muro_zenoh.transport import Bus, MemoryNetwork, Publisher, make_bus

T = TypeVar("T", bound=Message)

_FRAME = 0.05
_LATENCY = 0.05
_SIGMA = (0.001, 0.001, 0.005)
_COVARIANCE = (1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 2.5e-5)


def scenario(robots: int, behaviour: str, clockwise: bool = False, **parameters: object) -> Scenario:
    """A scenario for a fleet in memory."""
    table = {
        "robots": robots,
        "circle": {"clockwise": clockwise},
        "behaviour": {"name": behaviour, **parameters},
    }
    return parse_scenario(table, "lab.toml", name="lab")


class SimulatedSightings:
    """A camera that sees the whole floor without pictures: the true poses, with noise and delay.

    Args:
        floor: what it sees.
        robots: the names of the robots, in the plant's order.
        rng: for the noise.
        period: from one frame to the next [s].
        latency: from capture to arrival [s].

    Attributes:
        seeing: whether frames come.
    """

    def __init__(
        self,
        floor: Floor,
        robots: tuple[str, ...],
        rng: np.random.Generator,
        period: float = _FRAME,
        latency: float = _LATENCY,
    ) -> None:
        self.seeing = True
        self._floor = floor
        self._robots = robots
        self._rng = rng
        self._period = period
        self._latency = latency

    async def __aiter__(self) -> AsyncIterator[Sightings]:
        arrived: asyncio.Queue[Sightings] = asyncio.Queue()
        filming = asyncio.create_task(self._film(arrived))
        try:
            while True:
                yield await arrived.get()
        finally:
            filming.cancel()
            await asyncio.wait({filming})

    async def _film(self, arrived: asyncio.Queue[Sightings]) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            due += self._period
            await asyncio.sleep(due - loop.time())
            captured = self._floor.catch_up()
            if self.seeing:
                loop.call_at(due + self._latency, arrived.put_nowait, self._look(captured))

    def _look(self, captured: float) -> Sightings:
        poses = self._floor.plant.pose
        seen = (poses + self._rng.normal(0.0, _SIGMA, poses.shape)).tolist()
        robots = (Sighting(name, Pose2(*pose), _COVARIANCE) for name, pose in zip(self._robots, seen, strict=True))
        return Sightings(camera="north", captured=captured, robots=tuple(robots))


class MemoryFleet:
    """The fleet. Made by :func:`memory_fleet`.

    Attributes:
        network: what they share.
        clock: shared by all.
        plant: the robots.
        floor: what their wheels are commanded.
        camera: what the base station sees.
        station: the base station.
        agents: the tasks of the agents, by name.
    """

    def __init__(self, lab: Scenario, seed: int, stack: AsyncExitStack, tasks: asyncio.TaskGroup) -> None:
        self.scenario = lab
        self.network = MemoryNetwork()
        self.clock = VirtualClock()
        self.agents: dict[str, asyncio.Task[None]] = {}
        rng = np.random.default_rng(seed)
        starts = random_starts(rng, len(lab.robots), lab.arena, np.full(len(lab.robots), 0.177))
        self.plant = Plant(starts, rng)
        self.floor = Floor(self.plant, self.clock, lab.timeouts.command)
        self.camera = SimulatedSightings(self.floor, lab.robots, rng)
        self._stack = stack
        self._tasks = tasks

    async def start(self) -> None:
        """Start the bases and the base station."""
        self._looking = looking = await self.bus()
        self._healths = looking.latest(channels.HEALTH, "*")
        self._states = looking.latest(channels.BASE, "*")
        await self.start_station()
        room = await self.bus(Role.SIMULATOR, Role.BASE)
        wheels = {name: SimulatedWheels(self.floor, row) for row, name in enumerate(self.scenario.robots)}
        self._tasks.create_task(run_bases(room, wheels, self.clock, self.scenario.timeouts.command), name="bases")
        await asyncio.sleep(0)  # from now on the base station answers

    async def start_station(self) -> None:
        """Start a base station, with the scenario's state."""
        self._station_bus = await self.bus(Role.BASESTATION)
        self.station = Station(self._station_bus, self.scenario, None, [self.camera])
        self._station_bus.announce(Role.BASESTATION, "basestation")
        self._station_task = self._tasks.create_task(self.station.run(), name="base station")

    async def end_station(self) -> None:
        """End the base station."""
        self._station_task.cancel()
        await asyncio.wait({self._station_task})
        await self._station_bus.close()

    async def bus(self, *roles: Role) -> Bus:
        """A bus, as of another process; by default with every role."""
        bus = make_bus(self.network.link(), roles=roles or ALL_ROLES, clock=self.clock)
        return await self._stack.enter_async_context(bus)

    async def start_agent(self, name: str) -> None:
        """Start a robot's agent; the test checks how its task ends."""
        bus = await self.bus(Role.AGENT)
        agent = Agent(bus, self.scenario, name)
        bus.announce(Role.AGENT, name)
        self.agents[name] = asyncio.create_task(agent.run(), name=f"agent {name}")

    async def end_agents(self) -> None:
        """Cancel all agents and wait for them."""
        for task in self.agents.values():
            task.cancel()
        if self.agents:
            await asyncio.wait(self.agents.values())

    # ---- the base station

    async def order(self, verb: Verb[T], order: T) -> Reply:
        """Give an order to the base station, as an operator does, and assert that it is accepted."""
        reply = await self._looking.ask(verb, order)
        assert reply.accepted, reply.reason
        return reply

    async def refusal(self, verb: Verb[T], order: T) -> str:
        """Give an order to the base station, and assert that it is refused; returns the reason."""
        reply = await self._looking.ask(verb, order)
        assert not reply.accepted
        return reply.reason

    @property
    def kept(self) -> StateStore:
        """What the base station keeps."""
        return self.station.store

    def silence(self, channel: Channel[Any]) -> None:
        """Close the base station's publishers on a channel, and with them what was kept there."""
        start = f"{self._station_bus.realm}/{channel.word}"
        for thing in list(self._station_bus._open):
            if isinstance(thing, Publisher) and thing._key.startswith(start):
                thing.close()

    @property
    def seeing(self) -> bool:
        """Whether the cameras see."""
        return self.camera.seeing

    @seeing.setter
    def seeing(self, seeing: bool) -> None:
        self.camera.seeing = seeing

    # ---- observations

    async def until(self, condition: Callable[[], bool], limit: float, what: str) -> float:
        """Wait until a condition holds; returns the (virtual) time that it took [s]."""
        loop = asyncio.get_running_loop()
        began = loop.time()
        while not condition():
            assert loop.time() - began < limit, f"{what}: not within {limit:g} s; {self.healths}"
            await asyncio.sleep(0.01)
        return loop.time() - began

    @property
    def healths(self) -> dict[str, Health]:
        """The newest health of each agent."""
        newest = {name: received.message for name, received in self._healths.values().items()}
        return {name: health for name, health in newest.items() if health.role == "agent"}

    def holds(self, name: str, reason: str) -> bool:
        """Whether an agent reports that it does not drive for this reason."""
        health = self.healths.get(name)
        return health is not None and any(reason in given for given in health.reasons)

    def dead_man(self, name: str) -> bool:
        """Whether a base reports that it has no fresh command."""
        state = self._states.values().get(name)
        return state is not None and state.message.dead_man

    def commanded(self, name: str) -> tuple[float, float]:
        """The current command of a robot's wheels: v [m/s], omega [rad/s]."""
        v, omega = self.floor.commands[self.scenario.robots.index(name)].tolist()
        return v, omega

    @property
    def driving(self) -> set[str]:
        """The robots whose wheels are commanded to turn."""
        return {name for name in self.scenario.robots if self.commanded(name) != (0.0, 0.0)}

    @property
    def circle(self) -> Circle:
        """The circle to follow."""
        return self.kept.state.circle

    def radius_error(self, name: str) -> float:
        """True distance from the circle [m]."""
        x, y, _ = self.plant.pose[self.scenario.robots.index(name)].tolist()
        c = self.circle
        return abs(math.hypot(x - c.x, y - c.y) - c.radius)

    def speed(self, name: str) -> float:
        """True speed [m/s]."""
        return float(self.plant.twist[self.scenario.robots.index(name), 0])

    def turning(self, name: str) -> float:
        """True angular speed around the circle's centre, of a robot on it: positive counter-clockwise [rad/s]."""
        x, y, theta = self.plant.pose[self.scenario.robots.index(name)].tolist()
        x, y = x - self.circle.x, y - self.circle.y
        return self.speed(name) * (x * math.sin(theta) - y * math.cos(theta)) / (x * x + y * y)

    def spacing_error(self, names: list[str] | None = None) -> float:
        """Largest |gap - 2 pi / N| around the circle [rad]."""
        poses = dict(zip(self.scenario.robots, self.plant.pose.tolist(), strict=True))
        places = {name: (poses[name][0], poses[name][1]) for name in names or self.scenario.robots}
        return ring.spacing_error(ring.angles_round(places, self.circle))


@asynccontextmanager
async def memory_fleet(lab: Scenario, *, seed: int = 1, agents: bool = True) -> AsyncIterator[MemoryFleet]:
    """A running fleet; all of it is stopped at the end of the block."""
    async with AsyncExitStack() as stack, asyncio.TaskGroup() as tasks:
        fleet = MemoryFleet(lab, seed, stack, tasks)
        await fleet.start()
        try:
            if agents:
                for name in lab.robots:
                    await fleet.start_agent(name)
            yield fleet
        finally:
            await fleet.end_agents()
            for task in tasks._tasks.copy():
                task.cancel()
