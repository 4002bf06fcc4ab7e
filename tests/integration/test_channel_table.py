"""The table of channels compared with a fleet: writers, readers and rates."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterator
from contextlib import AsyncExitStack
from typing import Any

import pytest

from agents.agent import Agent
from agents.simulator import Room, film
from basestation.station import Station
from basestation.tasks.vision import cameras_on_bus
from muro_zenoh import channels
from muro_zenoh.channels import CHANNELS, Channel, Party, Priority, Role
from muro_zenoh.config import parse_scenario
from muro_zenoh.messages import Goal, SetBehaviour
from muro_zenoh.orders.goal import send_goal
from muro_zenoh.orders.stop import resume_robots, stop_robots
from muro_zenoh.runtime.virtual_time import InlineExecutor, VirtualClock, run_virtually
from muro_zenoh.scoring.collector import Collector
from muro_zenoh.transport import Bus, MemoryNetwork, make_bus
from muro_zenoh.transport.link import Closable, FileSample, LinkPublisher
from muro_zenoh.transport.memory_link import MemoryLink

LAB = parse_scenario(
    {"robots": 2, "camera": {"north": {"width": 640, "height": 480}}, "behaviour": {"name": "pursuit"}},
    "lab.toml",
    name="lab",
)
PERIODIC = [c for c in CHANNELS if c.rate is not None and c is not channels.CELL]
"""The channels that a fleet in pursuit writes continuously."""

SETTLED, MEASURED = 3.0, 4.0
"""Virtual time before, and of, the measurement of rates [s]."""

PROCESSES = {
    "simulator": (Role.SIMULATOR, Role.BASE),
    "camera": (Role.CAMERA,),
    "basestation": (Role.BASESTATION,),
    "r1": (Role.AGENT,),
    "r2": (Role.AGENT,),
    "operator": (Role.OPERATOR,),
}


class RecordingLink(MemoryLink):
    """Records what is actually written and read through it."""

    def __init__(self, network: MemoryNetwork) -> None:
        super().__init__(network, frozenset(), {})
        self.written: Counter[str] = Counter()
        self.read: set[str] = set()

    def publisher(self, key: str, *, encoding: str, priority: Priority, keep: bool) -> Any:
        return _Recording(super().publisher(key, encoding=encoding, priority=priority, keep=keep), key, self.written)

    def subscribe(self, key_expr: str, file: FileSample, *, encoding: str, keep: bool) -> Closable:
        self.read.add(key_expr.split("/")[1])
        return super().subscribe(key_expr, file, encoding=encoding, keep=keep)


class _Recording:
    def __init__(self, inner: LinkPublisher, key: str, written: Counter[str]) -> None:
        self._inner, self._key, self._written = inner, key, written

    def put(self, payload: bytes) -> None:
        self._written[self._key] += 1
        self._inner.put(payload)

    def close(self) -> None:
        self._inner.close()


class Fleet:
    """The record of a fleet: in pursuit, on a circle, by hand, to a goal and in coverage, then stopped and resumed."""

    def __init__(self) -> None:
        self.links: dict[str, RecordingLink] = {}
        self.rates: dict[str, float] = {}

    async def run(self) -> None:
        network, clock = MemoryNetwork(), VirtualClock()
        async with AsyncExitStack() as stack:
            buses: dict[str, Bus] = {}
            for name, roles in PROCESSES.items():
                link = self.links[name] = RecordingLink(network)
                buses[name] = await stack.enter_async_context(make_bus(link, roles=roles, clock=clock))
                buses[name].announce(roles[0], name)
            operator, station = buses["operator"], buses["basestation"]
            mains = [
                Room(buses["simulator"], LAB, seed=3, executor=InlineExecutor(), cameras=()).run(),
                film(buses["camera"], LAB, "north", 3, InlineExecutor()),
                Station(station, LAB, None, cameras_on_bus(station, LAB, InlineExecutor())).run(),
                *(Agent(buses[name], LAB, name).run() for name in LAB.robots),
                Collector(operator, LAB).run(),
            ]
            tasks = [asyncio.create_task(main) for main in mains]
            try:
                await asyncio.sleep(SETTLED)
                before = self._written()
                await asyncio.sleep(MEASURED)
                self.rates = {key: (n - before[key]) / MEASURED for key, n in self._written().items()}
                for name, behaviour in (("r1", "circle"), ("r1", "manual"), ("r1", "dubins"), ("r2", "coverage")):
                    order = SetBehaviour(behaviour=behaviour, names=(name,))
                    assert (await operator.ask(channels.SET_BEHAVIOUR, order)).accepted
                    await asyncio.sleep(1.0)
                assert (await send_goal(operator, "r1", Goal(x=0.5, y=0.0))).accepted
                await asyncio.sleep(1.0)
                await stop_robots(operator, ())
                await resume_robots(operator, ())
                assert not any(task.done() for task in tasks), tasks
            finally:
                for task in tasks:
                    task.cancel()
                await asyncio.wait(tasks)

    def _written(self) -> Counter[str]:
        return sum((link.written for link in self.links.values()), Counter[str]())

    def writing(self, role: Role) -> set[str]:
        """The channels that the processes with a role write."""
        return {key.split("/")[1] for link in self._of(role) for key in link.written}

    def reading(self, role: Role) -> set[str]:
        """The channels that the processes with a role read."""
        return {word for link in self._of(role) for word in link.read}

    def _of(self, role: Role) -> Iterator[RecordingLink]:
        return (self.links[name] for name, roles in PROCESSES.items() if role in roles)


@pytest.fixture(scope="module")
def fleet() -> Fleet:
    fleet = Fleet()
    run_virtually(fleet.run())
    return fleet


def table(end: str, *roles: Role) -> set[str]:
    """The channels that have one of the roles at an end."""
    parties: dict[str, tuple[Party, ...]] = {c.word: getattr(c, end) for c in CHANNELS}
    return {word for word, there in parties.items() if {party.role for party in there} & set(roles)}


@pytest.mark.parametrize("process", ["simulator", "camera", "basestation", "r1"])
def test_a_process_writes_and_reads_what_the_table_says(fleet: Fleet, process: str) -> None:
    roles = PROCESSES[process]
    assert fleet.writing(roles[0]) == table("writers", *roles)
    assert fleet.reading(roles[0]) == table("readers", *roles)


def test_operators_tools_use_only_their_own_channels(fleet: Fleet) -> None:
    assert fleet.writing(Role.OPERATOR) == {"stop"}
    assert {"health", "truth", "circle", "stop"} <= fleet.reading(Role.OPERATOR) <= table("readers", Role.OPERATOR)


@pytest.mark.parametrize("channel", PERIODIC, ids=lambda c: c.word)
def test_the_rates_are_those_of_the_table(fleet: Fleet, channel: Channel[Any]) -> None:
    rates = {key: rate for key, rate in fleet.rates.items() if key.split("/")[1] == channel.word}
    assert rates
    for key, rate in rates.items():
        assert rate == pytest.approx(channel.rate, rel=0.1, abs=0.3), key
