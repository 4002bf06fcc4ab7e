"""Runs the behaviour that the base station keeps for this robot, and changes it live."""

from __future__ import annotations

import asyncio
import functools
import logging
from collections.abc import Callable
from typing import Any

from agents.control_loop import ControlLoop
from agents.robot import CalledBehaviour, Connection, Robot
from agents.tasks.control import Listener, Sender
from muro_zenoh import channels
from muro_zenoh.behaviours import table
from muro_zenoh.behaviours.interface import Behaviour, Intent, Need, Seen, Vehicle, hold
from muro_zenoh.behaviours.table import OwnBehaviour
from muro_zenoh.config import RobotSettings, make_behaviour
from muro_zenoh.errors import MuroError
from muro_zenoh.messages import Behaviour as BehaviourOrder
from muro_zenoh.planning.destination import Destination
from muro_zenoh.transport import Bus

log = logging.getLogger(__name__)

_LEAVE_TIMEOUT = 1.0
"""How long a behaviour that is cancelled is waited for [s]; the robot is stationary meanwhile."""

_EVERYTHING = frozenset(Need) - {Need.GOALS}


class BehaviourRunner:
    """The behaviour that runs.

    One that cannot be loaded, refuses its parameters, or raises an error of this project or a ValueError leaves the
    robot stationary, with the reason. One that raises anything else takes the agent down, and the supervisor starts it
    again. One that ignores its cancellation, or leaves a task behind, is revoked: nothing that it asks for is done.

    Args:
        bus: the bus.
        vehicle: the robot.
        settings: its section of the fleet file.
        loop: the control loop.
        listener: what others say.
        sender: sends the messages.

    Attributes:
        name: of the behaviour that runs; empty before the first order.
    """

    def __init__(
        self,
        bus: Bus,
        vehicle: Vehicle,
        settings: RobotSettings,
        loop: ControlLoop,
        listener: Listener,
        sender: Sender,
    ) -> None:
        self.name = ""
        self._vehicle = vehicle
        self._settings = settings
        self._loop = loop
        self._listener = listener
        self._sender = sender
        self._clock = bus.clock
        self._orders = bus.latest(channels.BEHAVIOUR, vehicle.name)
        self._built_in: Behaviour | None = None
        self._robot: Robot | None = None
        self._task: asyncio.Task[None] | None = None
        self._failed = False
        self._crash: asyncio.Future[None] | None = None
        self._connection = Connection(
            seen=lambda: loop.seen,
            want=self._want,
            behave=loop.behave,
            estimates=lambda: bus.latest(channels.ESTIMATE, vehicle.name, own_only=True),
            now=bus.clock.now,
        )

    async def run(self) -> None:
        """Start the behaviour that is ordered; at another order end it and start the next."""
        self._crash = asyncio.get_running_loop().create_future()
        orders = asyncio.ensure_future(self._take_orders())
        try:
            await asyncio.wait({orders, self._crash}, return_when=asyncio.FIRST_COMPLETED)
            await (orders if orders.done() else self._crash)
        finally:
            orders.cancel()
            await self._end()

    def go_to(self, goal: Destination, seen: Seen) -> str:
        """Hand a goal to the behaviour that runs.

        Args:
            goal: where to go.
            seen: what there is to see.

        Returns:
            Why it is not taken; empty when it is.
        """
        if self._built_in is None:
            return f"the behaviour {self.name} takes no goals" if self.name else "no behaviour yet"
        return self._built_in.go_to(goal, seen)

    # ---- orders

    async def _take_orders(self) -> None:
        current: tuple[str, object] = ("", None)
        revision = -1
        async for received in self._orders:
            order = received.message
            wanted = (order.behaviour, order.parameters)
            again = self._failed and order.revision > revision
            if wanted == current and not again:
                continue  # the base station repeats what it keeps
            current, revision = wanted, order.revision
            self._hold("the behaviour is changing")
            await self._end()
            self._start(order)

    def _start(self, order: BehaviourOrder) -> None:
        self.name, self._failed = order.behaviour, False
        log.info("behaviour %s %s", order.behaviour, order.parameters or "")
        try:
            found = table.find(order.behaviour)
            if isinstance(found, OwnBehaviour):
                self._start_own(found, order)
                return
            built_in = make_behaviour(found, order.parameters, self._vehicle, f"behaviour of {self._vehicle.name}")
        except (MuroError, ValueError) as error:
            self._fail(error)
            return
        self._listener.need(found.needs)
        self._built_in = built_in
        self._loop.behave(built_in)

    def _start_own(self, own: OwnBehaviour, order: BehaviourOrder) -> None:
        self._listener.need(_EVERYTHING)
        if not own.is_async:
            self._loop.behave(CalledBehaviour(own.function, self._robot_with(order), self._note_failure))
            return
        robot = self._robot = self._robot_with(order)(self._connection)
        self._task = asyncio.create_task(self._run(own.function, robot), name=order.behaviour)
        self._task.add_done_callback(self._on_end)

    def _robot_with(self, order: BehaviourOrder) -> Callable[[Connection], Robot]:
        return functools.partial(Robot, self._vehicle, self._settings, order.parameters)

    async def _run(self, function: Callable[[Robot], Any], robot: Robot) -> None:
        try:
            await function(robot)
        except* (MuroError, ValueError) as group:  # a behaviour of several tasks raises a group
            if not robot.revoked:
                self._fail(_first(group))
        else:
            if not robot.revoked:
                self._failed = True
                self._hold(f"behaviour {self.name} has ended")

    def _on_end(self, task: asyncio.Task[None]) -> None:
        error = None if task.cancelled() else task.exception()
        if error is not None and self._crash is not None and not self._crash.done():
            self._crash.set_exception(error)

    def _fail(self, error: Exception) -> None:
        self._loop.behave(None)
        self._hold(self._note_failure(error))

    def _note_failure(self, error: Exception) -> str:
        """Log it, so that the same order given again starts again; the reason for standing still."""
        self._failed = True
        log.error("behaviour %s failed: %s", self.name, error, exc_info=None if isinstance(error, MuroError) else error)
        return f"behaviour {self.name}: {error}"

    async def _end(self) -> None:
        """End what runs. Were its task awaited itself, its end could not be told from our own cancellation."""
        self._loop.behave(None)
        self._built_in = None
        if self._robot is not None:
            self._robot.revoke()
            self._robot = None
        task, self._task = self._task, None
        if task is None or task.done():
            return
        task.cancel()
        await asyncio.wait({task}, timeout=_LEAVE_TIMEOUT)
        if not task.done():
            log.error(
                "behaviour %s has not ended %g s after it was cancelled: let CancelledError pass; it is revoked",
                task.get_name(),
                _LEAVE_TIMEOUT,
            )

    def _want(self, intent: Intent) -> None:
        self._sender.send(self._loop.want(self._clock.now(), intent))

    def _hold(self, reason: str) -> None:
        self._want(hold(reason))


def _first(group: BaseExceptionGroup[Exception]) -> Exception:
    error: Exception | BaseExceptionGroup[Exception] = group
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error
