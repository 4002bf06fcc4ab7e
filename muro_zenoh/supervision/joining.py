"""A run on a router where processes of its fleet are running already."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from contextlib import closing
from typing import Any, Final, NamedTuple

from muro_zenoh import channels
from muro_zenoh.behaviours.table import DEFAULT
from muro_zenoh.channels import Role
from muro_zenoh.config import Scenario
from muro_zenoh.errors import MuroError, OrderRefused
from muro_zenoh.messages import Message, SetBehaviour, SetCircle
from muro_zenoh.transport import Bus, Roster

log = logging.getLogger(__name__)

_RESTART: Final = 2.0
"""How long to wait for processes that are missing [s]. They may be restarting; or the router was, and clients come back
to it within 2 s."""

_ANSWER: Final = 2.0
"""How long answers are awaited [s]."""


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

    Raises:
        NoReply: the router does not say who is alive. Nothing may be started then: it could be a second one.
    """

    def whole(known: Roster) -> bool:
        wheels = known.of(Role.SIMULATOR) or known.of(Role.BASE)
        return known.of(Role.AGENT).issuperset(robots) and bool(known.of(Role.BASESTATION)) and bool(wheels)

    with closing(bus.roster()) as roster:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_RESTART):
                await roster.until(whole)
        await roster.complete(timeout=_ANSWER)
        alive = set(roster.alive)
    roles = {role for role, _ in alive}
    agents = tuple(name for name in robots if (Role.AGENT, name) in alive)
    processes = set(agents)
    if Role.BASESTATION in roles:
        processes.add(str(Role.BASESTATION))
    if roles & {Role.SIMULATOR, Role.BASE}:  # beside real bases it would be a second one of each robot
        processes.add(str(Role.SIMULATOR))
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
