"""Holding robots: a lease that is taken, renewed each second, and given back."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Final

from muro_zenoh import channels
from muro_zenoh.errors import MuroError, NoReply, OrderRefused
from muro_zenoh.messages import TakeLease
from muro_zenoh.transport import Bus

_RENEWAL_PERIOD: Final = 1.0
"""A lease ends three seconds after its last renewal [s]."""

_RETRY_PERIOD: Final = 0.1
_RELEASE_TIMEOUT: Final = 0.5


@asynccontextmanager
async def holding(
    bus: Bus, program: str, names: tuple[str, ...], *, lost: Callable[[str], None], patience: float | None = 0.0
) -> AsyncIterator[None]:
    """Hold robots within a block: orders and velocities of others are refused.

    Args:
        bus: the bus; the lease is its process's.
        program: what holds them, such as ``muro run``.
        names: which robots; none for all.
        lost: called with the reason, once, when somebody else has them: after a time without a base station.
        patience: how long to wait for a base station that is starting [s]; None to go on at once, and to hold the
            robots when it answers.

    Raises:
        OrderRefused: somebody else holds one of them; the text says who, since when.
        NoReply: there is no base station.
    """
    order = TakeLease(program=program, operator=bus.operator, names=names)
    if patience is not None:
        await _take(bus, order, patience)
    renewing = asyncio.create_task(_renew(bus, order, lost, waiting=patience is None), name="renew the lease")
    try:
        yield
    finally:
        renewing.cancel()
        await asyncio.wait({renewing})
        with contextlib.suppress(MuroError):  # it ends by itself
            release = TakeLease(program=program, operator=bus.operator, names=names, release=True)
            await bus.ask(channels.TAKE_LEASE, release, timeout=_RELEASE_TIMEOUT)


async def _take(bus: Bus, order: TakeLease, patience: float) -> None:
    loop = asyncio.get_running_loop()
    end = loop.time() + patience
    while True:
        try:
            reply = await bus.ask(channels.TAKE_LEASE, order)
        except NoReply:
            if loop.time() >= end:
                raise
            await asyncio.sleep(_RETRY_PERIOD)
            continue
        if not reply.accepted:
            raise OrderRefused(reply.reason)
        return


async def _renew(bus: Bus, order: TakeLease, lost: Callable[[str], None], *, waiting: bool) -> None:
    has_it = True  # or, while it waits, expects to have it
    while True:
        await asyncio.sleep(_RETRY_PERIOD if waiting else _RENEWAL_PERIOD)
        with contextlib.suppress(MuroError):  # the base station may be restarting
            reply = await bus.ask(channels.TAKE_LEASE, order)
            waiting = False
            if has_it and not reply.accepted:
                lost(reply.reason)
            has_it = reply.accepted
