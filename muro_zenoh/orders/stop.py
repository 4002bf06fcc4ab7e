"""Stop and resume: sent, and confirmed by each robot."""

from __future__ import annotations

import asyncio
import logging
from collections import defaultdict
from collections.abc import Callable
from contextlib import ExitStack, closing
from typing import Final, NamedTuple

from muro_zenoh import channels
from muro_zenoh.errors import MuroError, NoReply
from muro_zenoh.messages import MOST_NAMES, Health, Reply, Resume, Stop, StopOrder
from muro_zenoh.orders.receipt import RobotWatch, StopReceipt, StopStatus
from muro_zenoh.transport import Bus, Received

log = logging.getLogger(__name__)

_REPEAT_PERIOD: Final = 0.1
REPEATED_FOR: Final = 0.6
"""A stop is sent at once, and again for so long after it has arrived: a robot may be connecting just now [s]."""

_CONFIRMATION_TIMEOUT: Final = 2.5
"""Agents report at once when they latch a stop, and once a second besides [s]."""

_STOP_STATE_TIMEOUT: Final = 1.5
"""The base station repeats the stop state twice a second [s]."""


class StopResult(NamedTuple):
    """What came of a stop.

    Attributes:
        sent: when it was sent [s since 1970].
        reply: the base station's; None when it did not answer.
        robots: the receipt of each robot that was named, or of each that is known when none was: by its agent, or by
            the base station's snapshot.
        known: the robots that are known.
    """

    sent: float
    reply: Reply | None
    robots: dict[str, StopReceipt]
    known: tuple[str, ...] = ()

    @property
    def confirmed(self) -> bool:
        """Whether every robot has latched the stop and stands still; without any robot, whether the base station keeps
        the order."""
        if not self.robots:
            return self.reply is not None and self.reply.accepted
        return all(receipt.status is StopStatus.STOPPED for receipt in self.robots.values())


class ResumeResult(NamedTuple):
    """What came of lifting a stop.

    Attributes:
        reply: the base station's.
        answered: when that came [s since 1970].
        still_stopped: the robots that report so.
    """

    reply: Reply
    answered: float
    still_stopped: tuple[str, ...] = ()


def send_stop(bus: Bus, names: tuple[str, ...]) -> None:
    """Send a stop straight to the robots, once and now. :func:`stop_robots` repeats it, and asks the base station.

    Args:
        bus: the bus.
        names: which; none for all.
    """
    with closing(bus.publisher(channels.STOP, keep=False)) as orders:
        orders.put(StopOrder(all=not names, names=names))


async def stop_robots(bus: Bus, names: tuple[str, ...], arrived: Callable[[], None] | None = None) -> StopResult:
    """Stop robots: directly, base station or not, and by the base station, which keeps the order.

    Repeated until the first word that it has arrived anywhere, since the operator's own link may be down, and for
    :data:`REPEATED_FOR` from there. Not until everybody has confirmed it: that would undo the resume of one robot while
    another is silent. Any number of these may run at once. One that has arrived may be cancelled without losing it.

    Args:
        bus: the bus.
        names: which; none for all.
        arrived: called at the first word.
    """
    loop = asyncio.get_running_loop()
    end = loop.time() + REPEATED_FOR + _CONFIRMATION_TIMEOUT
    last, has_arrived = end, False
    with closing(_Stopping(bus, names)) as stopping:
        stopping.send()
        while True:
            looked = loop.time()
            await asyncio.sleep(_REPEAT_PERIOD)
            if stopping.look() and not has_arrived:
                # From the last look without it: this process may have stood still since.
                last, has_arrived = min(end, looked + REPEATED_FOR), True
                if arrived is not None:
                    arrived()
            if loop.time() > last - 0.5 * _REPEAT_PERIOD:
                break
            stopping.send()

        def settled() -> bool:
            stopping.look()
            return stopping.settled

        await until(settled, end - loop.time())
        return stopping.result()


class _Stopping:
    """Sends a stop, and watches what the robots and the base station do.

    Attributes:
        settled: whether every robot has stopped, and the base station has answered, or nobody has in time.
    """

    def __init__(self, bus: Bus, names: tuple[str, ...]) -> None:
        self._bus = bus
        self._names = names
        self._sent = bus.clock.now()
        self._robots: defaultdict[str, RobotWatch] = defaultdict(lambda: RobotWatch(self._sent))
        self._addressed = set(names)
        self._known: set[str] = set()
        self._receipts: dict[str, StopReceipt] = {}
        self._state: Received[StopOrder] | None = None
        with ExitStack() as stack:
            self._orders = stack.enter_context(closing(bus.publisher(channels.STOP, keep=False)))
            self._stop_state = stack.enter_context(closing(bus.latest(channels.STOP)))
            self._health = stack.enter_context(closing(bus.latest(channels.HEALTH, "*")))
            self._odometry = stack.enter_context(closing(bus.every(channels.ODOMETRY, "*", depth=4096)))
            self._snapshot = stack.enter_context(closing(bus.latest(channels.ALL_POSITIONS)))
            self._roster = stack.enter_context(closing(bus.roster()))
            self._open = stack.pop_all()
        self._asking = self._begin_asking()

    def close(self) -> None:
        """Listen and ask no more."""
        self._open.close()
        asking = self._asking
        if not asking.done():
            asking.cancel()
            return
        error = None if asking.cancelled() else asking.exception()
        if error is not None and not isinstance(error, MuroError):
            log.error("the base station cannot be asked to keep a stop: %r", error, exc_info=error)

    def send(self) -> None:
        """Send the stop. It is the whole state: a robot that was stopped before stays stopped. Any revision stops.

        The base station is asked besides, and asked again when nobody has answered.
        """
        heard = self._stop_state.get()
        if heard is not None and heard.message.epoch != self._bus.epoch:  # what this one sent says nothing
            self._state = heard
        if self._state is None or self._state.age(self._bus.clock.now()) > _STOP_STATE_TIMEOUT:
            before = StopOrder(all=False)  # whoever was stopped may be resumed since
        else:
            before = self._state.message
        names = tuple(sorted({*before.names, *self._names}))
        everybody = before.all or not self._names or len(names) > MOST_NAMES
        self._orders.put(StopOrder(all=everybody, names=names[:MOST_NAMES], revision=before.revision))
        if self._asking.done() and self._reply is None:
            self._asking = self._begin_asking()

    def look(self) -> bool:
        """Take what was received since the last look.

        Returns:
            Whether there is a word that the stop has arrived: of the base station, or of a robot that has received it.
        """
        alive = self._roster.of("agent")
        self._known.update(alive)  # one that disappears meanwhile has not confirmed, either
        if (seen := self._snapshot.get()) is not None:  # ... nor has a frozen one that disappeared before
            self._known.update(robot.name for robot in seen.message.robots)
        if not self._names:
            self._addressed |= self._known
        for odometry in self._odometry.drain():
            self._robots[odometry.name].take_odometry(odometry)
        now, healths = self._bus.clock.now(), self._health.values()
        for name in sorted(self._addressed):
            robot = self._robots[name]
            if name in healths:
                robot.take_health(healths[name])
            self._receipts[name] = robot.receipt(now, alive=name in alive, known=name in self._known)
        return self._reply is not None or any(self._is_received(health.message) for health in healths.values())

    @property
    def settled(self) -> bool:
        return self._asking.done() and all(r.status is StopStatus.STOPPED for r in self._receipts.values())

    def result(self) -> StopResult:
        """What came of it by the last look, with the robots whose agents are or were alive, or that the cameras have
        seen."""
        return StopResult(self._sent, self._reply, dict(sorted(self._receipts.items())), tuple(sorted(self._known)))

    def _is_received(self, health: Health) -> bool:
        """Whether an agent has received the stop. Each remembers the names in all orders; one that was stopped by name
        before says nothing of others."""
        return health.stop_all or bool(self._names and set(self._names) <= set(health.stop_names))

    @property
    def _reply(self) -> Reply | None:
        asking = self._asking
        answered = asking.done() and not asking.cancelled() and asking.exception() is None
        return asking.result() if answered else None

    def _begin_asking(self) -> asyncio.Task[Reply]:
        return asyncio.create_task(self._bus.ask(channels.STOP_ORDER, Stop(names=self._names)), name="ask for a stop")


async def resume_robots(
    bus: Bus, names: tuple[str, ...], revision: int | None = None, accepted: Callable[[], None] | None = None
) -> ResumeResult:
    """Lift a stop.

    Args:
        bus: the bus.
        names: of which robots; none for all.
        revision: of the stop that the operator saw; the base station refuses when there is a newer one. None for the
            newest that is received now.
        accepted: called as soon as the base station has lifted it, before the robots have said so.

    Raises:
        NoReply: the base station is silent.
    """
    with ExitStack() as stack:
        stop_state = stack.enter_context(closing(bus.latest(channels.STOP)))
        health = stack.enter_context(closing(bus.latest(channels.HEALTH, "*")))
        roster = stack.enter_context(closing(bus.roster()))
        await until(lambda: stop_state.get() is not None and bool(roster.of("basestation")), _STOP_STATE_TIMEOUT)
        known = stop_state.get()
        if known is None or not roster.of("basestation"):
            raise NoReply(
                f"the base station is silent (waited {_STOP_STATE_TIMEOUT:g} s for its stop state), and only it can "
                "lift a stop. Is `muro basestation` running, and on this router?"
            )
        seen = known.message.revision if revision is None else revision
        reply = await bus.ask(channels.RESUME, Resume(revision=seen, names=names))
        answered = bus.clock.now()
        if not reply.accepted:
            return ResumeResult(reply, answered)
        if accepted is not None:
            accepted()

        def still_stopped() -> tuple[str, ...]:
            alive = roster.of("agent")
            addressed = sorted(set(names) & alive if names else alive)
            return tuple(n for n in addressed if not (report := health.get(n)) or report.message.stop_latched)

        await until(lambda: not still_stopped(), _CONFIRMATION_TIMEOUT)
        return ResumeResult(reply, answered, still_stopped())


async def until(condition: Callable[[], bool], timeout: float) -> None:
    """Wait until a condition holds, or for ``timeout`` at most.

    Args:
        condition: what to wait for.
        timeout: how long [s].
    """
    loop = asyncio.get_running_loop()
    end = loop.time() + timeout
    while not condition() and loop.time() < end:  # noqa: ASYNC110 - several mailboxes at once
        await asyncio.sleep(0.02)
