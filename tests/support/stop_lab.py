"""A lab for stops, in memory and virtual time: agents that latch and report them, a base station, and an operator."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

from basestation.fleet.state_store import StateStore
from basestation.localization.sightings import Sightings
from basestation.station import Station
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import parse_scenario
from muro_zenoh.messages import Health, Odometry, StopOrder
from muro_zenoh.orders.receipt import StopStatus
from muro_zenoh.orders.stop import StopResult
from muro_zenoh.runtime.virtual_time import VirtualClock, run_virtually
from muro_zenoh.safety.stop import StopLatch
from muro_zenoh.transport import Bus, Every, MemoryNetwork, Publisher, make_bus
from muro_zenoh.transport.memory_faults import Cut

LAB = parse_scenario({"robots": 3, "behaviour": {"name": "circle"}}, "lab.toml", name="lab")


@dataclass
class Agent:
    """Latches stops and reports them, as far as it is let."""

    name: str
    bus: Bus
    deaf: bool = False
    """It is alive, and reads nothing: frozen."""
    speed: float = 0.0
    """Of its wheels, which brake when it has latched a stop [m/s]."""
    reports: Publisher[Health] = field(init=False)
    latch: StopLatch = StopLatch()
    names: frozenset[str] = frozenset()
    """The robots that the orders name that it received."""

    def __post_init__(self) -> None:
        self.reports = self.bus.publisher(channels.HEALTH, self.name)
        self.bus.announce(Role.AGENT, self.name)
        self.report()
        self.task = asyncio.create_task(self._run(), name=f"agent {self.name}")
        self.wheels = asyncio.create_task(self._turn(), name=f"base {self.name}")

    async def _turn(self) -> None:
        odometry, x = self.bus.publisher(channels.ODOMETRY, self.name), 0.0
        while True:
            odometry.put(Odometry(x=x, y=0.0, theta=0.0, v=self.speed, omega=0.0))
            await asyncio.sleep(0.04)
            if self.latch.stopped:
                self.speed = max(0.0, self.speed - 0.04)  # 1 m/s^2
            x += 0.04 * self.speed

    def report(self, **changed: Any) -> None:
        """Publish its health."""
        latch = self.latch
        said = {
            "stop_latched": latch.stopped,
            "stop_all": latch.all_robots,
            "stop_names": tuple(sorted(self.names)),
            "stop_revision": max(latch.revision, 0),
            **changed,
        }
        self.reports.put(Health(role="agent", state="x", **said))

    async def _run(self) -> None:
        async for received in self.bus.every(channels.STOP):
            if self.deaf:
                continue
            order, before = received.message, (self.latch, self.names)
            self.latch = self.latch.receive(self.name, all_robots=order.all, names=order.names, revision=order.revision)
            newer = self.latch.revision > before[0].revision
            self.names = frozenset(order.names) if newer else self.names.union(order.names)
            if (self.latch, self.names) != before:
                self.report()


class Camera:
    """Gives sightings that were made beforehand, and then no more."""

    def __init__(self, sightings: tuple[Sightings, ...]) -> None:
        self._sightings = sightings

    async def __aiter__(self) -> AsyncIterator[Sightings]:
        for each in self._sightings:
            yield each
        await asyncio.Event().wait()


@dataclass
class Lab:
    """A network with an operator's bus, and another one that sees what the operator sends."""

    stack: AsyncExitStack
    network: MemoryNetwork
    clock: VirtualClock
    operator: Bus
    observer: Bus

    async def join(self, *roles: Role) -> Bus:
        bus = make_bus(self.network.link(), roles=roles or channels.ALL_ROLES, clock=self.clock)
        return await self.stack.enter_async_context(bus)

    async def agents(self, *names: str, deaf: str = "") -> dict[str, Agent]:
        there = {name: Agent(name, await self.join(Role.AGENT, Role.BASE), name == deaf) for name in names}
        self.stack.callback(lambda: [task.cancel() for agent in there.values() for task in (agent.task, agent.wheels)])
        await asyncio.sleep(0)
        return there

    async def base_station(self, *sightings: Sightings) -> StateStore:
        """One that has listened to the robots, publishes, and has seen this."""
        bus = await self.join(Role.BASESTATION)
        station = Station(bus, LAB, None, [Camera(sightings)])
        bus.announce(Role.BASESTATION, "basestation")
        task = asyncio.create_task(station.run())

        async def end() -> None:
            task.cancel()
            await asyncio.wait({task})

        self.stack.push_async_callback(end)
        await asyncio.sleep(2.0)
        return station.store


@asynccontextmanager
async def lab() -> AsyncIterator[Lab]:
    network, clock = MemoryNetwork(), VirtualClock()
    async with AsyncExitStack() as stack:
        operator = await stack.enter_async_context(make_bus(network.link(), roles=[Role.OPERATOR], clock=clock))
        observer = await stack.enter_async_context(make_bus(network.link(), clock=clock))
        yield Lab(stack, network, clock, operator, observer)


Test = Callable[[Lab], Coroutine[Any, Any, None]]


def virtual(test: Test) -> Callable[[], None]:
    """A test in virtual time, on a lab of its own."""

    async def within_lab() -> None:
        async with lab() as there:
            await test(there)

    def run() -> None:
        run_virtually(within_lab())

    run.__name__, run.__doc__ = test.__name__, test.__doc__
    return run


def statuses(result: StopResult) -> dict[str, StopStatus]:
    """What is known of each robot."""
    return {name: receipt.status for name, receipt in result.robots.items()}


def sent_by(sent: Every[StopOrder], operator: Bus) -> list[StopOrder]:
    """The stops that an operator sent, and not the base station."""
    return [order.message for order in sent.drain() if order.message.epoch == operator.epoch]


@asynccontextmanager
async def cut_off(operator: Bus, direction: str = "both") -> AsyncIterator[None]:
    """While an operator's own link is down."""
    cut = Cut()
    operator._link.begin(cut, direction)  # type: ignore[attr-defined]
    yield
    operator._link.end(cut, direction)  # type: ignore[attr-defined]
