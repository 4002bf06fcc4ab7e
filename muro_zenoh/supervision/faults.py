"""Applies a scenario's faults to the processes of a run: signals to processes, and relays on links."""

from __future__ import annotations

import asyncio
import math
import signal
from collections.abc import Awaitable, Callable, Collection, Mapping
from contextlib import AsyncExitStack
from dataclasses import replace
from types import TracebackType

import msgspec

from muro_zenoh.config import Scenario
from muro_zenoh.config.faults import (
    OF_THE_ROOM,
    DelayFault,
    Fault,
    JitterFault,
    LinkFault,
    PartitionFault,
    Place,
    StallFault,
)
from muro_zenoh.errors import MuroError, OrderRefused
from muro_zenoh.orders.stop import until
from muro_zenoh.runtime.clock import Clock
from muro_zenoh.scoring.observed import FaultSeen
from muro_zenoh.supervision.child import Child
from muro_zenoh.supervision.fault_targets import befallen, check_fault, relayed
from muro_zenoh.supervision.relay import Conditions, Passage, Relay


class Links:
    """The relays of a run: one for each process whose link a fault befalls. An ``async with`` block.

    Args:
        scenario: the scenario.
        seed: of the jitter.
    """

    def __init__(self, scenario: Scenario, seed: int) -> None:
        self._scenario = scenario
        self._seed = seed
        self._router: tuple[str, int] | None = None
        self._relays = {name: Relay(seed + index) for index, name in enumerate(relayed(scenario))}
        self._stack = AsyncExitStack()

    @property
    def endpoints(self) -> Mapping[str, str]:
        """Where these processes connect, by name; all others connect to the router."""
        return {name: relay.endpoint for name, relay in self._relays.items()}

    def lead_to(self, endpoint: str) -> None:
        """Connect the processes to this router from now on.

        Args:
            endpoint: the router's: ``tcp/HOST:PORT``.
        """
        host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
        self._router = host, int(port)
        for relay in self._relays.values():
            relay.lead_to(*self._router)

    async def add(self, name: str) -> str | None:
        """Put a relay into the link of a process that has none.

        Args:
            name: of the process.

        Returns:
            Where it has to connect from now on; None when it has a relay.

        Raises:
            OrderRefused: no relay can lead to the router.
        """
        if name in self._relays:
            return None
        if self._router is None:
            raise OrderRefused("the router of this run is not at an endpoint tcp/HOST:PORT that a relay could lead to")
        relay = Relay(self._seed + len(self._relays))
        relay.lead_to(*self._router)
        await self._stack.enter_async_context(relay)
        self._relays[name] = relay
        return relay.endpoint

    def befall(self, faults: Collection[Fault]) -> None:
        """Set the state of every link.

        Args:
            faults: those that last now.
        """
        links = [(fault, befallen(fault, self._scenario)) for fault in faults if isinstance(fault, LinkFault)]
        for name, relay in self._relays.items():
            here = [fault for fault, names in links if name in names]
            relay.set(conditions(here, "in"), conditions(here, "out"))

    async def __aenter__(self) -> Links:
        for relay in self._relays.values():
            await self._stack.enter_async_context(relay)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._stack.aclose()


def conditions(faults: Collection[LinkFault], direction: str) -> Conditions:
    """The state of a process's link in one direction.

    Args:
        faults: those of this link.
        direction: ``in`` or ``out``, as the process sees it.
    """
    delay, jitter, passage = 0.0, 0.0, Passage.OPEN
    for fault in faults:
        # What goes out of the router comes in to the process.
        seen = {"in": "out", "out": "in"}.get(direction) if fault.place is Place.ROUTER else direction
        if fault.direction not in ("both", seen):
            continue
        if isinstance(fault, DelayFault):
            delay += fault.delay
        elif isinstance(fault, JitterFault):
            jitter += fault.jitter
        elif isinstance(fault, StallFault):
            passage = max(passage, Passage.STALLED)
        elif isinstance(fault, PartitionFault):
            passage = max(passage, Passage.PARTITIONED)
    return Conditions(delay, jitter, passage)


_RESTART_TIMEOUT = 5.0

Room = Callable[[Fault], Awaitable[None]]
"""Lets a fault happen in the simulated room; raises a MuroError when it cannot."""


class Faults:
    """The faults of a run: those of its scenario, and those that an operator orders while it lasts.

    Args:
        scenario: the scenario.
        links: the relays.
        children: the current children by name, the router's among them.
        clock: for the times of the report.
        notify: called with a line for the operator when a fault begins and ends.
        room: lets the faults happen that the simulator applies.
        changed: called when one begins or ends.
    """

    def __init__(
        self,
        scenario: Scenario,
        links: Links,
        children: Callable[[], Mapping[str, Child]],
        clock: Clock,
        notify: Callable[[str], None],
        room: Room | None = None,
        changed: Callable[[], None] = lambda: None,
    ) -> None:
        self._room = room
        self._changed = changed
        self._begin = 0.0
        self._ordered: dict[int, Fault] = {}
        self._under_way: set[asyncio.Task[None]] = set()
        self._scenario = scenario
        self._links = links
        self._children = children
        self._clock = clock
        self._notify = notify
        self._seen = [FaultSeen(fault.kind, fault.target) for fault in scenario.faults]
        self._lasting: dict[int, Fault] = {}

    @property
    def seen(self) -> tuple[FaultSeen, ...]:
        """What has become of each fault so far."""
        return tuple(self._seen)

    @property
    def lasting(self) -> tuple[str, ...]:
        """The faults that last now, for the operator."""
        return tuple(described(fault) for fault in self._lasting.values())

    async def run(self, begin: float) -> None:
        """Let each fault begin and end at its time, until the last one has.

        Args:
            begin: when the run began, in the loop's time [s].
        """
        self._begin = begin
        async with asyncio.TaskGroup() as tasks:
            for number, fault in enumerate(self._scenario.faults):
                tasks.create_task(self._befall(number, fault, begin), name=f"fault {number}")

    async def close(self) -> None:
        """Let no fault that was ordered begin or end any more; the run is over."""
        for task in self._under_way:
            task.cancel()
        if self._under_way:
            await asyncio.wait(self._under_way)

    @property
    def elapsed(self) -> float:
        """Time since the run began [s]."""
        return asyncio.get_running_loop().time() - self._begin

    @property
    def ordered(self) -> tuple[Fault, ...]:
        """What an operator has ordered so far, as rows of the scenario."""
        return tuple(self._ordered.values())

    async def let_happen(self, fault: Fault) -> str:
        """Let a fault happen that an operator orders.

        Args:
            fault: which; its ``at`` is now.

        Returns:
            What had to be done for it besides; empty for nothing.

        Raises:
            ConfigError: it cannot befall a process on this machine.
            OrderRefused: it cannot happen now.
        """
        check_fault(fault, self._scenario, "fault")
        missing = [name for name in befallen(fault, self._scenario) if name not in self._children()]
        if fault.kind not in OF_THE_ROOM and missing:
            raise OrderRefused(f"{fault.kind} {fault.target}: this run has no process {missing[0]}")
        if self._room is not None and fault.kind in OF_THE_ROOM:
            await self._room(fault)
        note = ""
        if isinstance(fault, LinkFault) and (note := await self._put_relays(fault)):
            fault = msgspec.structs.replace(fault, at=round(self.elapsed, 2))
        number = len(self._seen)
        self._seen.append(FaultSeen(fault.kind, fault.target))
        self._ordered[number] = fault
        task = asyncio.create_task(self._befall(number, fault, self._begin, done=True), name=f"fault {number}")
        self._under_way.add(task)
        task.add_done_callback(self._under_way.discard)
        return note

    async def _put_relays(self, fault: Fault) -> str:
        """An agent that connects to the router itself is started anew, so that it connects to a relay. To do that to
        the base station, or to all, would be another fault than the one that is ordered."""
        if fault.place is not Place.AGENT and not set(befallen(fault, self._scenario)) <= set(self._links.endpoints):
            raise OrderRefused(
                f"{fault.kind} {fault.target}: got a link without a relay, expected that of an agent, or one that the "
                "scenario has a fault for"
            )
        restarted: dict[Child, int | None] = {}
        for child in self._befallen(fault):
            endpoint = await self._links.add(child.spec.name)
            if endpoint is not None:
                child.spec = replace(child.spec, command=(*child.spec.command, "--connect", endpoint))
                restarted[child] = child.pid
                child.terminate()
        await until(lambda: all(c.ready.is_set() and c.pid != pid for c, pid in restarted.items()), _RESTART_TIMEOUT)
        names = ", ".join(child.spec.name for child in restarted)
        return f"{names} was started anew, to put a relay into its link" if restarted else ""

    async def _befall(self, number: int, fault: Fault, begin: float, *, done: bool = False) -> None:
        loop = asyncio.get_running_loop()
        await asyncio.sleep(begin + fault.at - loop.time())
        note = await self._try_in_room(fault) if fault.kind in OF_THE_ROOM and not done else ""
        note = note or self._start(number, fault)
        # After the deed, which takes less than a millisecond: nothing that came later is put down to it.
        self._seen[number] = FaultSeen(fault.kind, fault.target, loop.time() - begin, None, self._clock.now(), note)
        self._notify(f"fault: {described(fault)}{note and f': {note}'}")
        self._changed()
        if fault.end < math.inf:
            await asyncio.sleep(begin + fault.end - loop.time())
            self._end(number, fault)
            self._seen[number] = self._seen[number]._replace(end=loop.time() - begin)
            self._notify(f"fault over: {described(fault)}")
            self._changed()

    async def _try_in_room(self, fault: Fault) -> str:
        """Let a fault of the scenario happen in the room; returns why it did not."""
        try:
            if self._room is not None:
                await self._room(fault)
        except MuroError as error:
            return str(error)
        return ""

    def _start(self, number: int, fault: Fault) -> str:
        """Let a fault begin; returns why it had no effect."""
        self._lasting[number] = fault
        if isinstance(fault, LinkFault):
            self._links.befall(self._lasting.values())
            return ""
        if fault.kind in OF_THE_ROOM:
            return ""
        missing = []
        for child in self._befallen(fault):
            if child.pid is None:
                missing.append(child.spec.name)
            if fault.kind == "freeze":
                child.signal(signal.SIGSTOP)
                continue
            if fault.end < math.inf:
                child.may_restart.clear()
            child.kill() if fault.kind == "crash" else child.terminate()
        if fault.kind != "freeze" and fault.end == math.inf:
            del self._lasting[number]  # the supervisor starts it anew
        return f"{', '.join(missing)} was not running" if missing else ""

    def _end(self, number: int, fault: Fault) -> None:
        self._lasting.pop(number, None)
        if isinstance(fault, LinkFault):
            self._links.befall(self._lasting.values())
            return
        if fault.kind in OF_THE_ROOM:
            return
        for child in self._befallen(fault):
            if fault.kind == "freeze":
                child.signal(signal.SIGCONT)
            else:
                child.may_restart.set()

    def _befallen(self, fault: Fault) -> list[Child]:
        children = self._children()
        return [children[name] for name in befallen(fault, self._scenario)]


def described(fault: Fault) -> str:
    """A fault in a few words: its kind, its numbers and its target.

    Args:
        fault: the fault.
    """
    number = {"delay": "delay", "jitter": "jitter"}.get(fault.kind)
    words = [fault.kind]
    if number is not None:
        words.append(f"{1e3 * getattr(fault, number):g} ms")
    if isinstance(fault, LinkFault) and fault.direction != "both":
        words.append(fault.direction)
    return " ".join([*words, fault.target])
