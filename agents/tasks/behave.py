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
        that crashes takes the agent down: the robot stops, and the supervisor starts it anew.
        """
        running: asyncio.Task[None] | None = None
        current: tuple[str, object] = ("", None)
        async with asyncio.TaskGroup() as tasks:
            async for order in self._orders:
                wanted = (order.message.behaviour, order.message.parameters)
                if wanted == current:
                    continue  # the base station repeats what it keeps
                current = wanted
                if running is not None:
                    await _cancel(running)
                self._robot.hold("the behaviour is changing")
                running = tasks.create_task(self._run(order.message), name=order.message.behaviour)

    async def _run(self, order: Behaviour) -> None:
        self.name = order.behaviour
        self._robot.parameters = order.parameters
        log.info("behaviour %s %s", order.behaviour, order.parameters or "")
        try:
            await load_behaviour(order.behaviour)(self._robot)
        except* (MuroError, ValueError) as group:  # a behaviour of several tasks raises a group
            error = _first(group)
            log.error("%s", error)
            self._robot.hold(f"behaviour {order.behaviour}: {error}")
        else:
            self._robot.hold(f"behaviour {order.behaviour} has ended")


def _first(group: BaseExceptionGroup[Exception]) -> Exception:
    error: Exception | BaseExceptionGroup[Exception] = group
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error


async def _cancel(task: asyncio.Task[None]) -> None:
    """Cancel a task and wait for its end. Were it awaited itself, its end could not be told from our own cancellation,
    which must not be lost."""
    task.cancel()
    await asyncio.wait({task})
