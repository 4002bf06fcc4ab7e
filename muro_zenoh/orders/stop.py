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
from muro_zenoh.messages import MOST_NAMES, Reply, Resume, Stop, StopOrder
from muro_zenoh.orders.receipt import RobotWatch, StopReceipt, StopStatus
from muro_zenoh.transport import Bus

log = logging.getLogger(__name__)

_REPEATS: Final = 6
_REPEAT_PERIOD: Final = 0.1
"""A stop is sent at once, and again for half a second: a robot may be connecting just now [s]."""

REPEATED_FOR: Final = _REPEATS * _REPEAT_PERIOD
"""The time until a stop that has arrived is certain to be repeated no more [s]."""

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


async def stop_robots(bus: Bus, names: tuple[str, ...]) -> StopResult:
    """Stop robots: directly, base station or not, and by the base station, which keeps the order.

    Repeated until the first word that it has arrived anywhere, since the operator's own link may be down, and for half
    a second from there. Not until everybody has confirmed it: that would undo the resume of one robot while another is
    silent. Any number of these may run at once, and one may be cancelled at any time: its order is sent before it first
    waits.

    Args:
        bus: the bus.
        names: which; none for all.
    """
    loop = asyncio.get_running_loop()
    end = loop.time() + REPEATED_FOR + _CONFIRMATION_TIMEOUT
    with closing(_Stopping(bus, names)) as stopping:
        stopping.send()
        repeats = 0
        while True:
            await asyncio.sleep(_REPEAT_PERIOD)
            repeats += stopping.has_arrived()
            if repeats == _REPEATS or loop.time() >= end:
                break
            stopping.send()
        await until(stopping.is_settled, end - loop.time())
        return stopping.result()


class _Stopping:
    """Sends a stop, and watches what the robots and the base station do."""

    def __init__(self, bus: Bus, names: tuple[str, ...]) -> None:
        self._bus = bus
        self._names = names
        self._sent = bus.clock.now()
        self._orders = bus.publisher(channels.STOP, keep=False)
        self._asking = self._begin_asking()
        self._arrived = False
        self._stop_state = bus.latest(channels.STOP)
        self._health = bus.latest(channels.HEALTH, "*")
        self._odometry = bus.every(channels.ODOMETRY, "*", depth=4096)
        self._snapshot = bus.latest(channels.ALL_POSITIONS)
        self._roster = bus.roster()
        self._robots: defaultdict[str, RobotWatch] = defaultdict(lambda: RobotWatch(self._sent))
        self._addressed = set(names)
        self._known: set[str] = set()

    def close(self) -> None:
        """Listen and ask no more."""
        for box in (self._stop_state, self._health, self._odometry, self._snapshot, self._roster, self._orders):
            box.close()
        self._asking.cancel()

    def send(self) -> None:
        """Send the stop. It is the whole state: a robot that was stopped before stays stopped. Any revision stops.

        The base station is asked besides, and asked again when nobody answered.
        """
        known = self._stop_state.get()
        before = known.message if known is not None else StopOrder(all=False)
        names = tuple(sorted({*before.names, *self._names}))
        everybody = before.all or not self._names or len(names) > MOST_NAMES
        self._orders.put(StopOrder(all=everybody, names=names[:MOST_NAMES], revision=before.revision))
        if self._asking.done() and self._asking.result() is None:
            self._asking = self._begin_asking()

    def has_arrived(self) -> bool:
        """Whether there was a word that the stop has arrived: a robot has latched it, or the base station answered."""
        latched = any(receipt.latched is not None for receipt in self._receipts().values())
        self._arrived |= latched or self._reply() is not None
        return self._arrived

    def is_settled(self) -> bool:
        """Whether every robot has stopped, and the base station has answered, or nobody has in time."""
        stopped = all(receipt.status is StopStatus.STOPPED for receipt in self._receipts().values())
        return stopped and self._asking.done()

    def result(self) -> StopResult:
        """What came of it by now, with the robots whose agents are or were alive, or that the cameras have seen."""
        return StopResult(self._sent, self._reply(), self._receipts(), tuple(sorted(self._known)))

    def _begin_asking(self) -> asyncio.Task[Reply | None]:
        return asyncio.create_task(self._ask(), name="ask for a stop")

    async def _ask(self) -> Reply | None:
        try:
            return await self._bus.ask(channels.STOP_ORDER, Stop(names=self._names))
        except MuroError:
            return None
        except Exception:  # whatever it is: the robots are sent the stop all the same
            log.exception("the base station cannot be asked to keep a stop")
            return None

    def _reply(self) -> Reply | None:
        return self._asking.result() if self._asking.done() else None

    def _receipts(self) -> dict[str, StopReceipt]:
        """What is known by now, by the robot's name."""
        alive = self._roster.of("agent")
        self._known.update(alive)  # one that disappears meanwhile has not confirmed, either
        if (seen := self._snapshot.get()) is not None:  # ... nor has a frozen one that disappeared before
            self._known.update(robot.name for robot in seen.message.robots)
        if not self._names:
            self._addressed |= self._known
        for odometry in self._odometry.drain():
            self._robots[odometry.name].take_odometry(odometry)
        now = self._bus.clock.now()
        found = {}
        for name in sorted(self._addressed):
            robot = self._robots[name]
            if (health := self._health.get(name)) is not None:
                robot.take_health(health)
            found[name] = robot.receipt(now, alive=name in alive, known=name in self._known)
        return found


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
