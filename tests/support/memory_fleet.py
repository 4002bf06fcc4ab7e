"""A fleet on the in-memory bus: real agents and bases on simulated wheels, and a base station without cameras."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any

import numpy as np

from agents.agent import Agent
from agents.base.run import run_bases
from agents.base.simulated import Floor, SimulatedWheels
from basestation.fleet.state_store import StateStore
from basestation.fleet.table import FleetTable, Motion
from muro_zenoh import channels
from muro_zenoh.config import Scenario, parse_scenario
from muro_zenoh.geometry import Pose2
from muro_zenoh.messages import FleetSnapshot, Health, PoseFix, Reply
from muro_zenoh.simulation.plant import Plant, random_starts
from muro_zenoh.transport import Bus, MemoryNetwork, make_bus
from tests.support.virtual_time import VirtualClock

_FRAME = 0.05
_LATENCY = 0.05
_SIGMA = (0.001, 0.001, 0.005)
_COVARIANCE = (1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 2.5e-5)


def scenario(robots: int, behaviour: str, clockwise: bool = False, **parameters: object) -> Scenario:
    """A scenario with a camera named north, whose fixes come 50 ms late."""
    table = {
        "robots": robots,
        "camera": {"north": {"latency": _LATENCY}},
        "circle": {"clockwise": clockwise},
        "behaviour": {"name": behaviour, **parameters},
    }
    return parse_scenario(table, "lab.toml", name="lab")


class MemoryFleet:
    """The fleet. Made by :func:`memory_fleet`.

    Attributes:
        network: what they share.
        clock: everybody's.
        kept: the base station's state; after a change of it call :meth:`publish_kept`.
        plant: the robots.
        floor: what they are told.
        seeing: whether the cameras see.
        keeping: whether the kept state is repeated.
        agents: the tasks of the agents, by name.
    """

    def __init__(self, lab: Scenario, seed: int, stack: AsyncExitStack, tasks: asyncio.TaskGroup) -> None:
        self.scenario = lab
        self.network = MemoryNetwork()
        self.clock = VirtualClock()
        self.kept = StateStore(lab, None)
        self.seeing = True
        self.keeping = True
        self.agents: dict[str, asyncio.Task[None]] = {}
        self._rng = np.random.default_rng(seed)
        starts = random_starts(self._rng, len(lab.robots), lab.arena.bounds, np.full(len(lab.robots), 0.177))
        self.plant = Plant(starts, self._rng)
        self.floor = Floor(self.plant, self.clock)
        self._stack = stack
        self._tasks = tasks
        self._table = FleetTable()

    async def start(self) -> None:
        """Start the bases and the base station."""
        self._station = station = await self.bus()
        self._poses = {name: station.publisher(channels.POSE, name) for name in self.scenario.robots}
        self._snapshots = station.publisher(channels.ALL_POSITIONS)
        self._stops = station.publisher(channels.STOP)
        self._circles = station.publisher(channels.CIRCLE)
        self._behaviours = {name: station.publisher(channels.BEHAVIOUR, name) for name in self.scenario.robots}
        self._estimates = station.latest(channels.ESTIMATE, "*")
        self._healths = station.latest(channels.HEALTH, "*")
        self._states = station.latest(channels.BASE, "*")
        room = await self.bus()
        wheels = {name: SimulatedWheels(self.floor, row) for row, name in enumerate(self.scenario.robots)}
        self._tasks.create_task(run_bases(room, wheels, self.clock))
        self._tasks.create_task(self._see())
        self._tasks.create_task(self._keep())

    async def bus(self) -> Bus:
        """A bus, as a process of its own would have it."""
        return await self._stack.enter_async_context(make_bus(self.network.link(), clock=self.clock))

    async def start_agent(self, name: str) -> None:
        """Start a robot's agent; how its task ends is for the test to look at."""
        bus = await self.bus()
        agent = Agent(bus, self.scenario, name)
        bus.announce("agent", name)
        self.agents[name] = asyncio.create_task(agent.run(), name=f"agent {name}")

    async def end_agents(self) -> None:
        """Cancel all agents and wait for them."""
        for task in self.agents.values():
            task.cancel()
        if self.agents:
            await asyncio.wait(self.agents.values())

    # ---- orders

    def order(self, reply: Reply) -> None:
        """Take the answer to a change of the kept state, and publish it as the base station does."""
        assert reply.accepted, reply.reason
        self.publish_kept()

    def publish_kept(self) -> None:
        """Send the kept state."""
        self._stops.put(self.kept.stop)
        self._circles.put(self.kept.circle)
        for name, publisher in self._behaviours.items():
            publisher.put(self.kept.behaviour(name))

    # ---- what is seen

    async def until(self, condition: Callable[[], bool], limit: float, what: str) -> float:
        """Wait until a condition holds; the (virtual) time that it took [s]."""
        loop = asyncio.get_running_loop()
        began = loop.time()
        while not condition():
            assert loop.time() - began < limit, f"{what}: not within {limit:g} s; {self.healths}"
            await asyncio.sleep(0.01)
        return loop.time() - began

    @property
    def healths(self) -> dict[str, Health]:
        """The newest health of each."""
        return {name: received.message for name, received in self._healths.values().items()}

    def holds(self, name: str, reason: str) -> bool:
        """Whether an agent says that it stands for this reason."""
        health = self.healths.get(name)
        return health is not None and any(reason in given for given in health.reasons)

    def dead_man(self, name: str) -> bool:
        """Whether a base says that it has no fresh command."""
        state = self._states.values().get(name)
        return state is not None and state.message.dead_man

    def told(self, name: str) -> tuple[float, float]:
        """What the wheels of a robot are told now."""
        v, omega = self.floor.commands[self.scenario.robots.index(name)].tolist()
        return v, omega

    @property
    def driving(self) -> set[str]:
        """Whose wheels are told to turn."""
        return {name for name in self.scenario.robots if self.told(name) != (0.0, 0.0)}

    def radius_error(self, name: str) -> float:
        """True distance from the circle [m]."""
        x, y, _ = self.plant.pose[self.scenario.robots.index(name)].tolist()
        c = self.kept.circle
        return abs(math.hypot(x - c.x, y - c.y) - c.radius)

    def speed(self, name: str) -> float:
        """True speed [m/s]."""
        return float(self.plant.twist[self.scenario.robots.index(name), 0])

    def turning(self, name: str) -> float:
        """True angular speed round the circle's centre, of a robot on it: positive counter-clockwise [rad/s]."""
        x, y, theta = self.plant.pose[self.scenario.robots.index(name)].tolist()
        c = self.kept.circle
        x, y = x - c.x, y - c.y
        return self.speed(name) * (x * math.sin(theta) - y * math.cos(theta)) / (x * x + y * y)

    def spacing_error(self, names: list[str] | None = None) -> float:
        """Largest |gap - 2 pi / N| round the circle [rad]."""
        c = self.kept.circle
        rows = [self.scenario.robots.index(name) for name in names or self.scenario.robots]
        angles = sorted(math.atan2(self.plant.pose[i, 1] - c.y, self.plant.pose[i, 0] - c.x) for i in rows)
        gaps = [(b - a) % math.tau for a, b in zip(angles, [*angles[1:], angles[0]], strict=True)]
        return max(abs(gap - math.tau / len(rows)) for gap in gaps)

    # ---- the base station

    async def _see(self) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            due += _FRAME
            await asyncio.sleep(due - loop.time())
            captured = self.floor.catch_up()
            if self.seeing:
                loop.call_at(due + _LATENCY, self._locate, captured, self.plant.pose.copy())

    def _locate(self, captured: float, poses: Any) -> None:
        for name, pose in zip(self.scenario.robots, poses, strict=True):
            x, y, theta = (pose + self._rng.normal(0.0, _SIGMA)).tolist()
            fix = PoseFix(stamp=captured, x=x, y=y, theta=theta, covariance=_COVARIANCE, camera="north")
            self._poses[name].put(fix)
            self._table.fix(name, Pose2(x, y, theta), captured)
        for name, estimate in self._estimates.values().items():
            m = estimate.message
            self._table.estimate(name, Motion(m.pose, m.v, m.omega, estimate.arrival))
        self._snapshots.put(FleetSnapshot(robots=self._table.snapshot(self.clock.now())))

    async def _keep(self) -> None:
        while True:
            if self.keeping:
                self.publish_kept()
            await asyncio.sleep(0.5)


@asynccontextmanager
async def memory_fleet(lab: Scenario, *, seed: int = 1, agents: bool = True) -> AsyncIterator[MemoryFleet]:
    """A fleet that runs; all of it is gone at the end of the block."""
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
