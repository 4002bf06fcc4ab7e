"""A change of behaviour: asked of the base station, and refused by robots that cannot run it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Mapping
from contextlib import closing
from typing import Final, NamedTuple

from muro_zenoh import channels
from muro_zenoh.messages import Reply, SetBehaviour
from muro_zenoh.transport import Bus

_REFUSAL_TIMEOUT: Final = 1.5
"""A robot that cannot run a behaviour has reported so by then [s]."""


class BehaviourResult(NamedTuple):
    """What came of a change of behaviour.

    Attributes:
        reply: the base station's.
        refusals: why robots cannot run it, by name.
    """

    reply: Reply
    refusals: Mapping[str, str]


async def set_behaviour(bus: Bus, order: SetBehaviour) -> BehaviourResult:
    """Change the behaviour of robots.

    Args:
        bus: the bus.
        order: which behaviour, and of which robots.

    Raises:
        NoReply: the base station did not answer in time.
    """
    with closing(bus.every(channels.HEALTH, "*", depth=256)) as reports:  # before the order, so that none is missed
        reply = await bus.ask(channels.SET_BEHAVIOUR, order)
        refusals: dict[str, str] = {}
        if not reply.accepted:
            return BehaviourResult(reply, refusals)
        failed = f"behaviour {order.behaviour}:"
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_REFUSAL_TIMEOUT):
                async for report in reports:
                    health = report.message
                    # An older report, which is kept, may be about the failure of an earlier order.
                    if health.behaviour_revision >= reply.revision and health.failure.startswith(failed):
                        refusals.setdefault(report.name, health.failure)
        return BehaviourResult(reply, refusals)
