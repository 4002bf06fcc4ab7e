"""Stop and resume: sent, and confirmed by each robot."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from enum import Enum
from typing import Final, NamedTuple

from muro_zenoh import channels
from muro_zenoh.errors import MuroError, NoReply
from muro_zenoh.messages import Reply, Resume, Stop, StopOrder
from muro_zenoh.transport import Bus

_REPEATS: Final = 6
_REPEAT_PERIOD: Final = 0.1
"""A stop is sent at once, and again for half a second: a robot may be connecting just now [s]."""

_CONFIRMATION_TIMEOUT: Final = 2.5
"""Agents report at once when they latch a stop, and once a second besides [s]."""

_STOP_STATE_TIMEOUT: Final = 1.5
"""The base station repeats the stop state twice a second [s]."""


class StopStatus(Enum):
    """What is known of a robot that was ordered to stop."""

    STOPPED = "stopped"
    UNCONFIRMED = "unconfirmed"
    NOT_ALIVE = "not alive"


class StopResult(NamedTuple):
    """What came of a stop.

    Attributes:
        reply: the base station's; None when it did not answer.
        robots: the status of each robot that was named, or of each that is known when none was: by its agent, or by
            the base station's snapshot.
    """

    reply: Reply | None
    robots: dict[str, StopStatus]

    @property
    def confirmed(self) -> bool:
        """Whether every robot has stopped; without any robot, whether the base station keeps the order."""
        if not self.robots:
            return self.reply is not None and self.reply.accepted
        return all(status is StopStatus.STOPPED for status in self.robots.values())


class ResumeResult(NamedTuple):
    """What came of lifting a stop: the base station's ``reply``, and the robots that are ``still_stopped``."""

    reply: Reply
    still_stopped: tuple[str, ...] = ()


async def stop_robots(bus: Bus, names: tuple[str, ...]) -> StopResult:
    """Stop robots: directly, base station or not, and by the base station, which keeps the order.

    Args:
        bus: the bus.
        names: which; none for all.
    """
    stop_state = bus.latest(channels.STOP)
    health = bus.latest(channels.HEALTH, "*")
    snapshot = bus.latest(channels.ALL_POSITIONS)
    roster = bus.roster()
    orders = bus.publisher(channels.STOP)
    asking = asyncio.create_task(bus.ask(channels.STOP_ORDER, Stop(names=names)))

    addressed = set(names)

    def status() -> dict[str, StopStatus]:
        alive = roster.of("agent")
        if not names:
            addressed.update(alive)  # one that disappears meanwhile has not confirmed, either
            if (seen := snapshot.get()) is not None:  # ... nor has a frozen one that disappeared before
                addressed.update(robot.name for robot in seen.message.robots)
        found = {}
        for name in sorted(addressed):
            report = health.get(name)
            if name not in alive:
                found[name] = StopStatus.NOT_ALIVE
            elif report is not None and report.message.stop_latched:
                found[name] = StopStatus.STOPPED
            else:
                found[name] = StopStatus.UNCONFIRMED
        return found

    try:
        for _ in range(_REPEATS):
            # It is the whole state: a robot that was stopped before stays stopped. Any revision stops.
            known = stop_state.get()
            before = known.message if known is not None else StopOrder(all=False)
            orders.put(
                StopOrder(
                    all=before.all or not names, names=tuple(sorted({*before.names, *names})), revision=before.revision
                )
            )
            await asyncio.sleep(_REPEAT_PERIOD)
            status()  # who is alive now
        await until(lambda: all(s is StopStatus.STOPPED for s in status().values()), _CONFIRMATION_TIMEOUT)
        try:
            reply: Reply | None = await asking
        except MuroError:
            reply = None
    finally:
        asking.cancel()
    return StopResult(reply, status())


async def resume_robots(bus: Bus, names: tuple[str, ...]) -> ResumeResult:
    """Lift a stop.

    Args:
        bus: the bus.
        names: of which robots; none for all.

    Raises:
        NoReply: the base station is silent.
    """
    stop_state = bus.latest(channels.STOP)
    health = bus.latest(channels.HEALTH, "*")
    roster = bus.roster()
    await until(lambda: stop_state.get() is not None and bool(roster.of("basestation")), _STOP_STATE_TIMEOUT)
    known = stop_state.get()
    if known is None or not roster.of("basestation"):
        raise NoReply(
            f"the base station is silent (waited {_STOP_STATE_TIMEOUT:g} s for its stop state), and only it can lift a "
            "stop. Is `muro basestation` running, and on this router?"
        )
    reply = await bus.ask(channels.RESUME, Resume(revision=known.message.revision, names=names))
    if not reply.accepted:
        return ResumeResult(reply)

    def still_stopped() -> tuple[str, ...]:
        alive = roster.of("agent")
        addressed = sorted(set(names) & alive if names else alive)
        return tuple(n for n in addressed if not (report := health.get(n)) or report.message.stop_latched)

    await until(lambda: not still_stopped(), _CONFIRMATION_TIMEOUT)
    return ResumeResult(reply, still_stopped())


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
