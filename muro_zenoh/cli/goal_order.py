"""A goal: an order to one robot, which answers it."""

from __future__ import annotations

import click

from muro_zenoh import channels
from muro_zenoh.cli.stopping import until
from muro_zenoh.errors import NoReply
from muro_zenoh.messages import Goal
from muro_zenoh.transport import Bus

_HEARD_WITHIN = 1.5
"""Within this time it is known who is alive, and what the base station and a robot say of it [s]."""


async def send_goal(bus: Bus, name: str, x: float, y: float, theta: float | None) -> int:
    """Send a robot to a goal.

    Args:
        bus: the bus.
        name: which robot.
        x: the goal [m, world].
        y: the goal [m, world].
        theta: the heading to arrive with [rad]; None when it does not matter.

    Returns:
        The exit code: 0 when the robot accepts, 1 when it refuses.

    Raises:
        NoReply: the robot is not alive, or did not answer.
    """
    roster = bus.roster()
    await until(lambda: name in roster.of(channels.Role.AGENT), _HEARD_WITHIN)
    alive = roster.of(channels.Role.AGENT)
    if name not in alive:
        raise NoReply(f"{name} is not alive; the robots that are: {', '.join(sorted(alive)) or 'none'}")
    try:
        reply = await bus.ask(channels.GOAL_ORDER, Goal(x=x, y=y, theta=theta), name=name)
    except NoReply as error:
        raise NoReply(f"{error} It is alive, {await _state_of(bus, name)}") from None
    click.echo(f"{name}: " + ("accepted" if reply.accepted else f"refused: {reply.reason}"))
    return 0 if reply.accepted else 1


async def _state_of(bus: Bus, name: str) -> str:
    """What a robot runs, and why it stands, in words."""
    behaviours = bus.latest(channels.BEHAVIOUR, name)
    healths = bus.latest(channels.HEALTH, name)
    await until(lambda: behaviours.get() is not None and healths.get() is not None, _HEARD_WITHIN)
    behaviour, health = behaviours.get(), healths.get()
    runs = "has no behaviour yet" if behaviour is None else f"runs the behaviour {behaviour.message.behaviour}"
    if health is None:
        return f"{runs} and says nothing of its health"
    reasons = ", ".join(health.message.reasons)
    return f"{runs} and stands still ({reasons})" if reasons else runs
