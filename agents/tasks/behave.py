"""Runs the behaviour that the base station keeps for this robot, and changes it live."""

from __future__ import annotations

import asyncio
import logging

from agents.behaviours import load_behaviour
from agents.robot import Robot
from muro_zenoh.errors import MuroError
from muro_zenoh.messages import Behaviour
from muro_zenoh.transport import Latest

log = logging.getLogger(__name__)

_LEAVES_WITHIN = 1.0
"""A behaviour that is cancelled is waited for so long [s]; the robot stands meanwhile."""


class Behave:
    """The behaviour that runs.

    Args:
        robot: the robot.
        orders: the kept channel of its behaviour.

    Attributes:
        name: of the behaviour that runs; empty before the first order.
    """

    def __init__(self, robot: Robot, orders: Latest[Behaviour]) -> None:
        self.name = ""
        self._robot = robot
        self._orders = orders

    async def run(self) -> None:
        """Start the behaviour that is ordered; at another order cancel it and start the next.

        A behaviour that cannot be loaded, or refuses its parameters, leaves the robot standing with the reason. One
        that crashes takes the agent down: the robot stops, and the supervisor starts it anew. One that does not leave
        when it is cancelled, or leaves a task behind, has no say any more.
        """
        running: asyncio.Task[None] | None = None
        lent = self._robot
        current: tuple[str, object] = ("", None)
        async with asyncio.TaskGroup() as tasks:
            async for order in self._orders:
                wanted = (order.message.behaviour, order.message.parameters)
                if wanted == current:
                    continue  # the base station repeats what it keeps
                current = wanted
                self._robot.hold("the behaviour is changing")
                if running is not None:
                    lent.give_back()
                    await _cancel(running)
                lent = self._robot.lend()
                running = tasks.create_task(self._run(lent, order.message), name=order.message.behaviour)

    async def _run(self, robot: Robot, order: Behaviour) -> None:
        self.name = order.behaviour
        robot.parameters = order.parameters
        log.info("behaviour %s %s", order.behaviour, order.parameters or "")
        try:
            await load_behaviour(order.behaviour)(robot)
        except* (MuroError, ValueError) as group:  # a behaviour of several tasks raises a group
            error = _first(group)
            log.error("%s", error)
            robot.hold(f"behaviour {order.behaviour}: {error}")
        else:
            robot.hold(f"behaviour {order.behaviour} has ended")
        finally:
            robot.give_back()


def _first(group: BaseExceptionGroup[Exception]) -> Exception:
    error: Exception | BaseExceptionGroup[Exception] = group
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error


async def _cancel(task: asyncio.Task[None]) -> None:
    """Cancel a task and wait for its end. Were it awaited itself, its end could not be told from our own cancellation,
    which must not be lost."""
    task.cancel()
    await asyncio.wait({task}, timeout=_LEAVES_WITHIN)
    if not task.done():
        log.error(
            "behaviour %s has not left %g s after it was cancelled: let CancelledError pass; it has no say any more",
            task.get_name(),
            _LEAVES_WITHIN,
        )
