"""A goal: sent to a robot, and answered by it."""

from __future__ import annotations

import asyncio

import click

from muro_zenoh import channels
from muro_zenoh.cli.stopping import until
from muro_zenoh.errors import NoReply
from muro_zenoh.messages import Ack, Goal
from muro_zenoh.transport import Bus, Every

_HEARD_WITHIN = 1.5
"""Who is alive, and what the base station keeps of it, is known within so long [s]."""

_TRIES = 4
_ANSWERED_WITHIN = 0.5
"""A goal is sent again after so long without an answer: a robot may be connecting just now [s]."""


async def send_goal(bus: Bus, name: str, x: float, y: float, theta: float | None) -> int:
    """Send a robot to a goal.

    Args:
        bus: the bus.
        name: which robot.
        x: the goal [m, world].
        y: the goal [m, world].
        theta: the heading to arrive with [rad]; None when it does not matter.

    Returns:
        The exit code.

    Raises:
        NoReply: the robot is not alive, or did not answer.
    """
    roster = bus.roster()
    behaviours = bus.latest(channels.BEHAVIOUR, name)
    health = bus.latest(channels.HEALTH, name)
    answers = bus.every(channels.ACK, name)
    goals = bus.publisher(channels.GOAL, name)
    await until(lambda: name in roster.of("agent") and behaviours.get() is not None, _HEARD_WITHIN)
    if name not in roster.of("agent"):
        alive = ", ".join(sorted(roster.of("agent"))) or "none"
        raise NoReply(f"{name} is not alive; the robots that are: {alive}")
    sent: set[tuple[int, int]] = set()
    for _ in range(_TRIES):
        goal = goals.put(Goal(x=x, y=y, theta=theta))
        sent.add((goal.epoch, goal.seq))
        answer = await _answer(answers, sent)
        if answer is not None:
            click.echo(f"{name}: " + ("accepted" if answer.accepted else f"refused: {answer.reason}"))
            return 0 if answer.accepted else 1
    kept, said = behaviours.get(), health.get()
    runs = f"runs the behaviour {kept.message.behaviour}" if kept is not None else "has no behaviour yet"
    if said is not None and said.message.reasons:
        runs += f" and stands ({', '.join(said.message.reasons)})"
    raise NoReply(
        f"{name} did not answer (waited {_TRIES * _ANSWERED_WITHIN:g} s): it is alive, {runs}. "
        f"The behaviours dubins and steer take goals: muro set behaviour dubins --robot {name}"
    )


async def _answer(answers: Every[Ack], sent: set[tuple[int, int]]) -> Ack | None:
    """The answer to one of the goals sent, or None when it does not come in time."""
    try:
        async with asyncio.timeout(_ANSWERED_WITHIN):
            async for received in answers:
                ack = received.message
                if ack.channel == channels.GOAL.word and (ack.order_epoch, ack.order_seq) in sent:
                    return ack
    except TimeoutError:
        pass
    return None
