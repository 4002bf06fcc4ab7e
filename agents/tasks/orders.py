"""Orders to this robot: a stop, and a goal."""

from __future__ import annotations

import asyncio
import contextlib

from agents.control_loop import ControlLoop
from agents.master import Master
from agents.tasks.behaviour import BehaviourRunner
from agents.tasks.control import Sender, Signals
from muro_zenoh import channels
from muro_zenoh.messages import Goal, Reply
from muro_zenoh.planning.destination import Destination
from muro_zenoh.transport import Bus

_START_TIMEOUT = 0.7
"""How long a goal waits for the robot's first pose and its first behaviour [s]: its agent may have just started."""


async def obey_stops(bus: Bus, loop: ControlLoop, sender: Sender, signals: Signals) -> None:
    """Take every stop order, and command zero at once when it stops this robot.

    Args:
        bus: the bus.
        loop: the control loop, which holds the latch.
        sender: sends the command.
        signals: wakes the health report.
    """
    async for order in bus.every(channels.STOP, depth=16):
        now = bus.clock.now()
        sender.send(loop.take_stop(now, order.message, order.age(now)))
        if loop.changed:
            signals.changed.set()


def answer_goals(
    bus: Bus, name: str, loop: ControlLoop, runner: BehaviourRunner, master: Master, signals: Signals
) -> None:
    """Answer every goal for this robot: accepted, or refused with the reason. A stopped robot takes goals, and says so.

    Args:
        bus: the bus.
        name: the robot's name.
        loop: the control loop, which has the current observations.
        runner: passes the goals to the behaviour.
        master: whose orders count.
        signals: for the first pose.
    """

    async def answer(goal: Goal) -> Reply:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_START_TIMEOUT):
                await signals.located.wait()
                await runner.begun.wait()
        seen = loop.seen
        if seen is None:
            return Reply(accepted=False, reason=f"{name} has no pose yet, so it cannot plan")
        refused = master.refusal(goal) or runner.go_to(Destination(goal.x, goal.y, goal.theta), seen)
        return Reply(accepted=not refused, reason=refused or loop.latch.reason)

    bus.answer(channels.GOAL_ORDER, answer, name=name)
