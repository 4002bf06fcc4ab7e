"""Stop and resume: sent, and confirmed by each robot."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import click

from muro_zenoh import channels
from muro_zenoh.errors import MuroError, NoReply
from muro_zenoh.messages import Reply, Resume, Stop, StopOrder
from muro_zenoh.transport import Bus

_REPEATS = 6
_REPEAT_PERIOD = 0.1
"""A stop is sent at once, and again for half a second: a robot may be connecting just now [s]."""

_CONFIRMED_WITHIN = 2.5
"""Agents report at once when they latch a stop, and once a second besides [s]."""

_STOP_HEARD_WITHIN = 1.5
"""The base station repeats the stop state twice a second [s]."""


async def send_stop(bus: Bus, names: tuple[str, ...]) -> int:
    """Stop robots.

    Args:
        bus: the bus.
        names: which; none for everybody.

    Returns:
        The exit code.
    """
    heard = bus.latest(channels.STOP)
    health = bus.latest(channels.HEALTH, "*")
    roster = bus.roster()
    orders = bus.publisher(channels.STOP)
    asking = asyncio.create_task(bus.ask(channels.STOP_ORDER, Stop(names=names)))
    try:
        for _ in range(_REPEATS):
            # It is the whole state: whoever was stopped before stays so. A stop is obeyed at any revision.
            known = heard.get()
            before = known.message if known is not None else StopOrder(all=False)
            orders.put(
                StopOrder(
                    all=before.all or not names, names=tuple(sorted({*before.names, *names})), revision=before.revision
                )
            )
            await asyncio.sleep(_REPEAT_PERIOD)

        def missing() -> list[str]:
            alive = roster.of("agent")
            meant = sorted(set(names) if names else alive)
            return [n for n in meant if n not in alive or not (h := health.get(n)) or not h.message.stop_latched]

        await until(lambda: not missing(), _CONFIRMED_WITHIN)
        try:
            reply: Reply | None = await asking
        except MuroError:
            reply = None
    finally:
        asking.cancel()
    alive = roster.of("agent")
    unconfirmed = missing()
    click.echo(
        "base station: " + answer_of(reply, "did not answer, so nobody keeps this order but the robots themselves")
    )
    for name in sorted(set(names) or alive):
        if name not in alive:
            click.echo(f"{name}: is not alive")
        else:
            click.echo(f"{name}: " + ("DOES NOT CONFIRM" if name in unconfirmed else "has stopped"))
    if not alive:
        click.echo("no robot is alive")
        return 0 if reply is not None and reply.accepted and not names else 1
    return 1 if unconfirmed else 0


async def send_resume(bus: Bus, names: tuple[str, ...]) -> int:
    """Lift a stop.

    Args:
        bus: the bus.
        names: whose; none for everybody's.

    Returns:
        The exit code.
    """
    heard = bus.latest(channels.STOP)
    health = bus.latest(channels.HEALTH, "*")
    roster = bus.roster()
    await until(lambda: heard.get() is not None and bool(roster.of("basestation")), _STOP_HEARD_WITHIN)
    known = heard.get()
    if known is None or not roster.of("basestation"):
        raise NoReply(
            f"the base station is silent (waited {_STOP_HEARD_WITHIN:g} s for its stop state), and only it can lift a "
            "stop. Is `muro basestation` running, and on this router?"
        )
    reply = await bus.ask(channels.RESUME, Resume(revision=known.message.revision, names=names))
    click.echo(f"base station: {answer_of(reply)}")
    if not reply.accepted:
        return 1

    def still() -> list[str]:
        alive = roster.of("agent")
        meant = sorted(set(names) & alive if names else alive)
        return [n for n in meant if not (h := health.get(n)) or h.message.stop_latched]

    await until(lambda: not still(), _CONFIRMED_WITHIN)
    for name in still():
        click.echo(f"{name}: still says that it is stopped")
    return 1 if still() else 0


def answer_of(reply: Reply | None, silent: str = "") -> str:
    """The base station's answer in words.

    Args:
        reply: the answer; None when there was none.
        silent: what to say then.
    """
    if reply is None:
        return silent
    return f"accepted, revision {reply.revision}" if reply.accepted else f"refused: {reply.reason}"


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
