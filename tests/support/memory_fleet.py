"""A fleet in memory, with the words of tests: what they wait for, order and expect."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any, TypeVar

from agents.base.simulated import Floor
from basestation.fleet.state_store import StateStore
from muro_zenoh import channels
from muro_zenoh.channels import Channel, Role, Verb
from muro_zenoh.checking.fleet import VirtualFleet
from muro_zenoh.config import Scenario, parse_scenario
from muro_zenoh.control import ring
from muro_zenoh.geometry import Circle
from muro_zenoh.messages import Health, Message, Reply
from muro_zenoh.simulation.plant import Plant
from muro_zenoh.transport import Bus, Publisher

T = TypeVar("T", bound=Message)


def scenario(robots: int, behaviour: str, clockwise: bool = False, **parameters: object) -> Scenario:
    """A scenario for a fleet in memory."""
    table = {
        "robots": robots,
        "circle": {"clockwise": clockwise},
        "behaviour": {"name": behaviour, **parameters},
    }
    return parse_scenario(table, "lab.toml", name="lab")


class MemoryFleet(VirtualFleet):
    """The fleet. Made by :func:`memory_fleet`."""

    def __init__(self, lab: Scenario, seed: int) -> None:
        super().__init__(lab, seed)
        self._looking = self.open_bus()
        self._healths = self._looking.latest(channels.HEALTH, "*")
        self._states = self._looking.latest(channels.BASE, "*")

    async def bus(self, *roles: Role) -> Bus:
        """A bus, as of another process; by default with every role."""
        return self.open_bus(*roles)

    async def start_station(self) -> None:
        """Start a base station, with the scenario's state."""
        self.processes["basestation"].start()

    async def end_station(self) -> None:
        """End the base station."""
        process = self.processes["basestation"]
        process.end()
        assert process.task is not None
        await asyncio.wait({process.task})

    async def start_agent(self, name: str) -> None:
        """Start a robot's agent; the test checks how its task ends."""
        self.processes[f"{name}/agent"].start()

    @property
    def agents(self) -> dict[str, asyncio.Task[None]]:
        """The tasks of the agents, by name."""
        tasks = {name: self.processes[f"{name}/agent"].task for name in self.scenario.robots}
        return {name: task for name, task in tasks.items() if task is not None}

    @property
    def plant(self) -> Plant:
        """The robots."""
        return self.world.plant

    @property
    def floor(self) -> Floor:
        """What their wheels are commanded."""
        return self.world

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
        bus = self.processes["basestation"].bus
        start = f"{bus.realm}/{channel.word}"
        for thing in list(bus._open):
            if isinstance(thing, Publisher) and thing._key.startswith(start):
                thing.close()

    @property
    def seeing(self) -> bool:
        """Whether the cameras see."""
        return not any(self.view.blind.values())

    @seeing.setter
    def seeing(self, seeing: bool) -> None:
        self.view.blind.clear()
        if not seeing:
            self.view.blind.update(self.cameras.keys())

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
    """A running fleet; all of it is ended after the block."""
    async with MemoryFleet(lab, seed) as fleet:
        await fleet.start(agents=agents)
        yield fleet
    for _, name, error in fleet.ends:
        if error is not None and not name.endswith("/agent"):
            raise error
