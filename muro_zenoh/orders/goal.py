"""A goal: an order to one robot, which answers it."""

from __future__ import annotations

from contextlib import ExitStack, closing
from typing import Final

from muro_zenoh import channels
from muro_zenoh.errors import NoReply
from muro_zenoh.messages import Goal, Reply
from muro_zenoh.orders.stop import until
from muro_zenoh.transport import Bus

_ALIVE_TIMEOUT: Final = 1.5
"""Which robots are alive, and what the base station keeps of them, is known within this time [s]."""

_ANSWER_TIMEOUT: Final = 2.0


async def send_goal(bus: Bus, name: str, goal: Goal) -> Reply:
    """Send a robot to a goal.

    Args:
        bus: the bus.
        name: which robot.
        goal: where to.

    Returns:
        The robot's answer.

    Raises:
        NoReply: the robot is not alive, or did not answer.
    """
    with ExitStack() as stack:
        roster = stack.enter_context(closing(bus.roster()))
        behaviours = stack.enter_context(closing(bus.latest(channels.BEHAVIOUR, name)))
        health = stack.enter_context(closing(bus.latest(channels.HEALTH, name)))
        await until(lambda: name in roster.of("agent"), _ALIVE_TIMEOUT)
        if name not in roster.of("agent"):
            alive = ", ".join(sorted(roster.of("agent"))) or "none"
            raise NoReply(f"{name} is not alive; the robots that are: {alive}")
        try:
            return await bus.ask(channels.GOAL_ORDER, goal, name=name, timeout=_ANSWER_TIMEOUT)
        except NoReply as error:
            kept, report = behaviours.get(), health.get()
            runs = f"runs the behaviour {kept.message.behaviour}" if kept is not None else "has no behaviour yet"
            if report is not None and report.message.reasons:
                runs += f" and stands still ({', '.join(report.message.reasons)})"
            raise NoReply(f"{error} {name} is alive, {runs}.") from None
