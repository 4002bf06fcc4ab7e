"""Drive to each goal by point-forward steering, turning while driving, without a planned path."""

from __future__ import annotations

from dataclasses import dataclass

from muro_zenoh.behaviours.dubins import GoalList
from muro_zenoh.behaviours.interface import Behaviour, BehaviourKind, Intent, Need, Seen, Vehicle, hold
from muro_zenoh.control.point_forward import GoToGoal
from muro_zenoh.errors import ParameterError
from muro_zenoh.geometry import STILL
from muro_zenoh.planning.destination import Destination, require_inside
from muro_zenoh.planning.itinerary import Itinerary


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """Parameters of point-forward steering. A goal's heading is ignored.

    Args:
        steering: the law.
        targets: the goals.
    """

    steering: GoToGoal = GoToGoal()
    targets: GoalList = GoalList()


class Steering(Behaviour):
    """Steer the point ahead of the axle to each goal.

    Args:
        law: the steering law.
        itinerary: the goals.
        vehicle: the robot; its arena and radius are used.
    """

    def __init__(self, law: GoToGoal, itinerary: Itinerary, vehicle: Vehicle) -> None:
        self._law = law
        self._itinerary = itinerary
        self._vehicle = vehicle

    def go_to(self, goal: Destination, seen: Seen) -> str:
        """Accept any goal inside the arena that is clear of its walls; the separation filter leads the way round them.

        Args:
            goal: where to go.
            seen: not used.

        Returns:
            Why the goal is refused; empty when it is accepted.
        """
        try:
            vehicle = self._vehicle
            require_inside("goal", goal.x, goal.y, vehicle.arena, vehicle.wall_distance, vehicle.walls)
        except ParameterError as error:
            return str(error)
        self._itinerary.replace(goal)
        return ""

    def step(self, seen: Seen) -> Intent:
        """Steer to the current goal.

        Args:
            seen: the robot's predicted state.
        """
        self._itinerary.begin_next(seen.now)
        goal = self._itinerary.current
        if goal is None:
            return hold(self._itinerary.waiting)
        twist = self._law.twist(seen.ahead.pose, goal.x, goal.y)
        if twist == STILL:
            self._itinerary.arrive(seen.now)
            return hold(self._itinerary.waiting)
        return Intent(twist, target=(goal.x, goal.y))


def make(parameters: Parameters, vehicle: Vehicle) -> Steering:
    """The behaviour of one robot.

    Args:
        parameters: the law, and the goals.
        vehicle: the robot; its arena and radius are used.
    """
    return Steering(parameters.steering, parameters.targets.itinerary(), vehicle)


BEHAVIOUR = BehaviourKind(
    Parameters,
    make,
    "drive to each goal by point-forward steering",
    needs=frozenset({Need.GOALS}),
    fits=lambda parameters, circle, fleet: parameters.targets.require_inside(fleet),
)
