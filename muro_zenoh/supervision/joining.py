"""A run on a router where processes of its fleet are running already."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from typing import Any, Final, NamedTuple

from muro_zenoh import channels
from muro_zenoh.behaviours.table import DEFAULT
from muro_zenoh.channels import Role
from muro_zenoh.config import Scenario
from muro_zenoh.errors import MuroError, OrderRefused
from muro_zenoh.messages import Message, SetBehaviour, SetCircle
from muro_zenoh.transport import Bus

log = logging.getLogger(__name__)

_LOOK: Final = 1.0
"""Who is alive is known within this time [s]."""

_ANSWER: Final = 2.0


class There(NamedTuple):
    """What is running already.

    Attributes:
        processes: the processes of the run that need not be started, by their names in it.
        robots: the robots that drive on when the run is over, because their agents are not its own.
    """

    processes: frozenset[str] = frozenset()
    robots: tuple[str, ...] = ()

    @property
    def basestation(self) -> bool:
        """Whether the base station is."""
        return Role.BASESTATION in self.processes


NOBODY: Final = There()


async def look(bus: Bus, robots: tuple[str, ...]) -> There:
    """See what is running.

    Args:
        bus: the bus.
        robots: the names of the robots of the run.
    """
    roster = bus.roster()
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(_LOOK):
            await roster.until(lambda known: set(robots) <= known.of(Role.AGENT) and bool(known.of(Role.BASESTATION)))
    agents = tuple(name for name in robots if name in roster.of(Role.AGENT))
    processes = set(agents)
    if roster.of(Role.BASESTATION):
        processes.add(str(Role.BASESTATION))
    if roster.of(Role.SIMULATOR) or roster.of(Role.BASE):  # beside real bases it would be a second one of each robot
        processes.add(str(Role.SIMULATOR))
    roster.close()
    return There(frozenset(processes), agents)


async def order(bus: Bus, scenario: Scenario) -> None:
    """Order the scenario's circle and behaviours of a base station that keeps others.

    Args:
        bus: the bus of the process that holds the robots.
        scenario: the scenario.

    Raises:
        OrderRefused: the base station refuses one: it has other robots, or another arena.
        NoReply: it does not answer.
    """
    circle = scenario.circle
    asked = SetCircle(x=circle.x, y=circle.y, radius=circle.radius, clockwise=circle.clockwise)
    await _ask(bus, channels.SET_CIRCLE, asked)
    for name in scenario.robots:
        behaviour = scenario.behaviour_of(name)
        wanted = SetBehaviour(behaviour=behaviour.name, parameters=behaviour.parameters, names=(name,))
        await _ask(bus, channels.SET_BEHAVIOUR, wanted)


async def leave(bus: Bus, robots: tuple[str, ...]) -> None:
    """Let robots stand still whose agents go on running.

    Args:
        bus: the bus of the process that holds them.
        robots: their names.
    """
    if not robots:
        return
    try:
        await _ask(bus, channels.SET_BEHAVIOUR, SetBehaviour(behaviour=DEFAULT, names=robots))
    except MuroError as error:
        log.error("%s may drive on: %s", " ".join(robots), error)


async def _ask(bus: Bus, verb: channels.Verb[Any], message: Message) -> None:
    reply = await bus.ask(verb, message, timeout=_ANSWER)
    if not reply.accepted:
        raise OrderRefused(reply.reason)
