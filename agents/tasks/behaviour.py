"""Runs the behaviour that is ordered for this robot, and changes it live."""

from __future__ import annotations

import asyncio
import functools
import logging
from collections.abc import Callable
from typing import Any

from agents.called_behaviour import CalledBehaviour
from agents.control_loop import ControlLoop
from agents.failure import FAILURES, failure_of
from agents.robot import Connection, Robot
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
"""How long a cancelled behaviour may take to end [s]; the robot is stationary meanwhile."""

_EVERYTHING = frozenset(Need) - {Need.GOALS, Need.HAND}


class BehaviourRunner:
    """Runs one behaviour at a time.

    A behaviour that cannot be loaded, refuses its parameters, raises an exception, asks for what is not a twist, or
    ends by itself leaves the robot stationary, with the reason, until a behaviour is ordered, the same or another. A
    user's behaviour is revoked when it is over: calls by a task that it leaves behind, or that ignores its
    cancellation, have no effect.

    Args:
        bus: the bus.
        vehicle: the robot.
        settings: its section of the fleet file.
        loop: the control loop.
        listener: receives what the behaviour needs.
        sender: sends the messages.

    Attributes:
        name: name of the running behaviour; empty before the first order.
        outcome: ``failed`` or ``ended`` once it has done so by itself; empty while it runs.
        failure: the reason of the outcome, in one line; empty while it runs.
        revision: of the newest order that was obeyed: the running behaviour's, or of one that asks for the same again.
        begun: the first behaviour was ordered.
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
        self.outcome = ""
        self.failure = ""
        self.revision = 0
        self.begun = asyncio.Event()
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
        self._connection = Connection(
            seen=lambda: loop.seen,
            want=self._want,
            behave=lambda ride: loop.behave(ride, self._fail_in_step),
            estimates=lambda: bus.latest(channels.ESTIMATE, vehicle.name, own_only=True),
            now=bus.clock.now,
        )

    async def run(self) -> None:
        """Start each behaviour that is ordered, after ending the one before."""
        try:
            await self._take_orders()
        finally:
            await self._end()

    def go_to(self, goal: Destination, seen: Seen) -> str:
        """Pass a goal to the running behaviour.

        Args:
            goal: where to go.
            seen: the current observations.

        Returns:
            Why the goal is refused; empty when it is accepted.
        """
        if self._built_in is None:
            if self.failure:
                return self.failure
            return f"the behaviour {self.name} takes no goals" if self.name else "no behaviour yet"
        return self._built_in.go_to(goal, seen)

    # ---- orders

    async def _take_orders(self) -> None:
        current: tuple[str, object] = ("", None)
        async for received in self._orders:
            order = received.message
            wanted = (order.behaviour, order.parameters)
            again = bool(self.outcome) and order.revision != self.revision
            if wanted == current and not again:
                self.revision = order.revision
                continue  # the base station repeats the kept state
            current = wanted
            self._loop.behave(None)
            self._hold("the behaviour is changing")
            await self._end()
            self._start(order)
            self.begun.set()

    def _start(self, order: BehaviourOrder) -> None:
        self.name, self.outcome, self.failure, self.revision = order.behaviour, "", "", order.revision
        log.info("behaviour %s %s", order.behaviour, order.parameters or "")
        try:
            found = table.find(order.behaviour)
            if isinstance(found, OwnBehaviour):
                self._start_own(found, order)
                return
            built_in = make_behaviour(found, order.parameters, self._vehicle, f"behaviour of {self._vehicle.name}")
        except FAILURES as error:
            # An exception of a user's module or function is the cause of our own error.
            self._hold(self._fail(error, error.__cause__ if isinstance(error, MuroError) else error))
            return
        self._listener.need(found.needs)
        self._built_in = built_in
        self._loop.behave(built_in, self._fail_in_step)

    def _start_own(self, own: OwnBehaviour, order: BehaviourOrder) -> None:
        self._listener.need(_EVERYTHING)
        make_robot = functools.partial(Robot, self._vehicle, self._settings, order.parameters)
        if not own.is_async:
            self._loop.behave(CalledBehaviour(own.function, make_robot), functools.partial(self._fail_in, own.function))
            return
        robot = self._robot = make_robot(self._connection)
        self._task = asyncio.create_task(self._run(own.function, robot), name=f"behaviour {order.behaviour}")

    async def _run(self, function: Callable[[Robot], Any], robot: Robot) -> None:
        try:
            await function(robot)
        except asyncio.CancelledError:
            if robot.revoked:
                raise  # cancelled by _end
            reason = self._end_early("it was cancelled by itself")
        except FAILURES as error:
            if robot.revoked:
                log.warning("behaviour %s failed while it ended", self.name, exc_info=error)
                return
            reason = self._fail_in(function, error)
        else:
            if robot.revoked:
                return
            reason = self._end_early("its function has returned")
        robot.revoke()  # a task that it has left behind may still call
        self._loop.behave(None)
        self._hold(reason)

    # ---- failures, and functions that return

    def _fail_in(self, function: Callable[..., Any], error: BaseException) -> str:
        return self._fail(error, error, function)

    def _fail_in_step(self, error: BaseException) -> str:
        """A built-in behaviour has failed, or a ride that a user's own has set out on and may be waiting for."""
        self._built_in = None
        if self._robot is not None:
            self._robot.revoke()
        if self._task is not None:
            self._task.cancel()
        return self._fail(error, error)

    def _fail(
        self, error: BaseException, shown: BaseException | None, function: Callable[..., Any] | None = None
    ) -> str:
        """Log a failure, with the traceback of ``shown``; return the reason to hold."""
        self.outcome, self.failure = "failed", f"behaviour {self.name}: {failure_of(error, function)}"
        log.error("%s", self.failure, exc_info=shown)
        return self.failure

    def _end_early(self, how: str) -> str:
        self.outcome, self.failure = "ended", f"behaviour {self.name} has ended: {how}"
        log.warning("%s", self.failure)
        return self.failure

    async def _end(self) -> None:
        """End the running behaviour. Awaiting its task directly would make its cancellation look like our own."""
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
                "%s has not ended %g s after it was cancelled, and is revoked: do not suppress CancelledError",
                task.get_name(),
                _LEAVE_TIMEOUT,
            )

    def _want(self, intent: Intent) -> None:
        self._sender.send(self._loop.want(self._clock.now(), intent))

    def _hold(self, reason: str) -> None:
        self._want(hold(reason))
