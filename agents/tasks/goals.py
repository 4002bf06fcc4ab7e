"""The goals of one robot: those of its settings, one after the other, and those that an operator sends."""

from __future__ import annotations

import logging

from agents.robot import Robot
from muro_zenoh import channels
from muro_zenoh.config import Section
from muro_zenoh.errors import ConfigError, PlanningError
from muro_zenoh.geometry import Pose2
from muro_zenoh.messages import Ack, Goal
from muro_zenoh.planning.arena import require_goal_inside
from muro_zenoh.quantities import Number
from muro_zenoh.transport import Received

log = logging.getLogger(__name__)


class GoalParameters(Section, frozen=True, kw_only=True):
    """Parameters of the behaviours that go to goals.

    Attributes:
        goals: rows ``[x, y]`` or ``[x, y, theta]`` [m, world; rad], gone to one after the other.
        pause: time to stand at a goal before the next one of the list [s].
    """

    goals: tuple[tuple[Number, ...], ...] = ()
    pause: float = 1.0


class Goals:
    """What is the goal now, and what comes next.

    A goal that an operator (or coverage) sends replaces the one that is being gone to and ends the list. It is answered
    on ``muro/ack/<name>``: refused with the reason at once when it lies outside the arena, else by whoever drives, with
    :meth:`set_out` or :meth:`give_up`. A goal that is refused changes nothing: what was done before goes on.

    Args:
        robot: the robot.
        parameters: the list.
        idle: what to say while there is no goal; none for the state of the list.

    Raises:
        ConfigError: a row of the list that is no goal.

    Attributes:
        current: the goal now, or None.
        reached: how many were reached.
    """

    def __init__(self, robot: Robot, parameters: GoalParameters, idle: str = "") -> None:
        self.current: Goal | None = None
        self.reached = 0
        self._robot = robot
        self._idle = idle
        self._pause = parameters.pause
        self._next_at = 0.0
        self._list = tuple(_goal(row, index) for index, row in enumerate(parameters.goals))
        self._before: tuple[Goal | None, tuple[Goal, ...]] | None = None
        self._given_up = ""
        self._inbox = robot.goals()
        self._acks = robot.acks()

    def close(self) -> None:
        """Listen no more."""
        self._inbox.close()
        self._acks.close()

    def look(self) -> bool:
        """Take what has come in; whether there is a new goal."""
        new = False
        for received in self._inbox.drain():
            new |= self._take(received)
        if self.current is None and self._list and self._robot.now >= self._next_at:
            self.current, *rest = self._list
            self._list = tuple(rest)
            new = True
        return new

    def set_out(self) -> None:
        """The goal can be reached, and the robot goes there."""
        if self._before is not None and self.current is not None:
            self._answer(self.current, True, "")
        self._before = None

    def arrived(self) -> None:
        """The goal was reached."""
        self.set_out()
        self.current = None
        self.reached += 1
        self._given_up = ""
        self._next_at = self._robot.now + self._pause

    def give_up(self, reason: str) -> None:
        """The goal cannot be reached; the operator is told why.

        An order that was not set out for leaves the goal before it in place.

        Args:
            reason: why.
        """
        goal = self.current
        if goal is None:
            return
        self._answer(goal, False, reason)
        log.warning("goal (%.2f, %.2f) given up: %s", goal.x, goal.y, reason)
        if self._before is not None:
            (self.current, self._list), self._before = self._before, None
            return
        self.current = None
        self._given_up = f"goal ({goal.x:g}, {goal.y:g}) given up: {reason}"
        self._next_at = self._robot.now + self._pause

    @property
    def waiting(self) -> str:
        """Why there is nothing to do."""
        if self._given_up:
            return self._given_up
        if self._idle:
            return self._idle
        if self._list:
            return f"at goal {self.reached}, waiting before the next"
        return "all goals reached" if self.reached else "no goal"

    def _take(self, received: Received[Goal]) -> bool:
        goal, current = received.message, self.current
        try:
            require_goal_inside(Pose2(goal.x, goal.y, 0.0), self._robot.arena, self._robot.settings.radius)
        except PlanningError as error:
            self._answer(goal, False, str(error))
            return False
        if current is not None and (goal.x, goal.y, goal.theta) == (current.x, current.y, current.theta):
            if self._before is None:  # said again by somebody who has not heard the answer
                self._answer(goal, True, "")
            else:
                self.current = goal
            self._list = ()
            return False
        if self._before is None:
            self._before = current, self._list
        else:  # two at once: the newer one counts
            assert current is not None
            self._answer(current, False, "a newer goal came with it")
        self.current, self._list, self._given_up = goal, (), ""
        return True

    def _answer(self, goal: Goal, accepted: bool, reason: str) -> None:
        self._acks.put(
            Ack(
                channel=channels.GOAL.word,
                order_epoch=goal.epoch,
                order_seq=goal.seq,
                accepted=accepted,
                reason=reason,
            )
        )


def _goal(row: tuple[float, ...], index: int) -> Goal:
    if len(row) not in (2, 3):
        raise ConfigError(f"behaviour.goals[{index}]", got=f"{len(row)} numbers", expected="x, y or x, y, theta")
    return Goal(x=row[0], y=row[1], theta=row[2] if len(row) == 3 else None)
