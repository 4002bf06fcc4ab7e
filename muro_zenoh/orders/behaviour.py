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
"""A robot that cannot run a behaviour has reported so by then [s]; when all have obeyed, that is known sooner."""


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
    # Both before the order, so that no report is missed.
    with closing(bus.every(channels.HEALTH, "*", depth=256)) as reports, closing(bus.roster()) as roster:
        reply = await bus.ask(channels.SET_BEHAVIOUR, order)
        refusals: dict[str, str] = {}
        if not reply.accepted:
            return BehaviourResult(reply, refusals)
        failed, obeyed = f"behaviour {order.behaviour}:", set[str]()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_REFUSAL_TIMEOUT):
                async for report in reports:
                    health = report.message
                    # An older report, which is kept, may be about the failure of an earlier order.
                    if health.role != "agent" or health.behaviour_revision < reply.revision:
                        continue
                    obeyed.add(report.name)
                    if health.failure.startswith(failed):
                        refusals.setdefault(report.name, health.failure)
                    alive = roster.of("agent")
                    addressed = alive.intersection(order.names) if order.names else alive
                    # A built-in one is refused at once; a user's own may fail in a moment.
                    if ":" not in order.behaviour and addressed and addressed <= obeyed:
                        break
        return BehaviourResult(reply, refusals)
