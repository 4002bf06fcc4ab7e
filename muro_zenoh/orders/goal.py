"""A goal: sent to a robot, and answered by it."""

from __future__ import annotations

import asyncio
from typing import Final

from muro_zenoh import channels
from muro_zenoh.errors import NoReply
from muro_zenoh.messages import Ack, Goal
from muro_zenoh.orders.stop import until
from muro_zenoh.transport import Bus, Every

_ALIVE_TIMEOUT: Final = 1.5
"""Which robots are alive, and what the base station keeps of them, is known within this time [s]."""

_TRIES: Final = 4
_ANSWER_TIMEOUT: Final = 0.5
"""Without an answer in this time a goal is sent again: a robot may be connecting just now [s]."""


async def send_goal(bus: Bus, name: str, goal: Goal) -> Ack:
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
    roster = bus.roster()
    behaviours = bus.latest(channels.BEHAVIOUR, name)
    health = bus.latest(channels.HEALTH, name)
    answers = bus.every(channels.ACK, name)
    goals = bus.publisher(channels.GOAL, name)
    await until(lambda: name in roster.of("agent") and behaviours.get() is not None, _ALIVE_TIMEOUT)
    if name not in roster.of("agent"):
        alive = ", ".join(sorted(roster.of("agent"))) or "none"
        raise NoReply(f"{name} is not alive; the robots that are: {alive}")
    sent: set[tuple[int, int]] = set()
    for _ in range(_TRIES):
        put = goals.put(goal)
        sent.add((put.epoch, put.seq))
        answer = await _answer(answers, sent)
        if answer is not None:
            return answer
    kept, report = behaviours.get(), health.get()
    runs = f"runs the behaviour {kept.message.behaviour}" if kept is not None else "has no behaviour yet"
    if report is not None and report.message.reasons:
        runs += f" and stands still ({', '.join(report.message.reasons)})"
    raise NoReply(
        f"{name} did not answer (waited {_TRIES * _ANSWER_TIMEOUT:g} s): it is alive, {runs}. "
        f"The behaviours dubins and steer take goals: muro set behaviour dubins --robot {name}"
    )


async def _answer(answers: Every[Ack], sent: set[tuple[int, int]]) -> Ack | None:
    """The answer to one of the goals sent, or None when it does not come in time."""
    try:
        async with asyncio.timeout(_ANSWER_TIMEOUT):
            async for received in answers:
                ack = received.message
                if ack.channel == channels.GOAL.word and (ack.order_epoch, ack.order_seq) in sent:
                    return ack
    except TimeoutError:
        pass
    return None
