"""Orders to this robot: a stop, and a goal."""

from __future__ import annotations

import asyncio
import contextlib

from agents.control_loop import ControlLoop
from agents.tasks.behaviour import BehaviourRunner
from agents.tasks.control import Sender, Signals
from muro_zenoh import channels
from muro_zenoh.messages import Goal, Reply
from muro_zenoh.planning.destination import Destination
from muro_zenoh.transport import Bus

_FIRST_POSE_TIMEOUT = 0.7
"""A goal for a robot that has had no pose yet waits this long for the first [s]."""


async def obey_stops(bus: Bus, loop: ControlLoop, sender: Sender, signals: Signals) -> None:
    """Take every stop order, and command zero at once when it stops this robot.

    Args:
        bus: the bus.
        loop: the control loop, which holds the latch.
        sender: sends the command.
        signals: what the health report is woken by.
    """
    async for order in bus.every(channels.STOP, depth=16):
        sender.send(loop.take_stop(bus.clock.now(), order.message))
        if loop.changed:
            signals.changed.set()


def answer_goals(bus: Bus, name: str, loop: ControlLoop, runner: BehaviourRunner, signals: Signals) -> None:
    """Answer every goal that is sent to this robot: taken, or why not.

    Args:
        bus: the bus.
        name: the robot's name.
        loop: for what there is to see.
        runner: the behaviour that takes goals, or does not.
        signals: for the first pose: an agent that has just started is waited for.
    """

    async def answer(goal: Goal) -> Reply:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_FIRST_POSE_TIMEOUT):
                await signals.located.wait()
        seen = loop.seen
        if seen is None:
            return Reply(accepted=False, reason=f"{name} has no pose yet, so it cannot plan")
        refused = runner.go_to(Destination(goal.x, goal.y, goal.theta), seen)
        return Reply(accepted=not refused, reason=refused)

    bus.answer(channels.GOAL_ORDER, answer, name=name)
