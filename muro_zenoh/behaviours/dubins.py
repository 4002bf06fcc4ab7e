"""Drive to each goal along a Dubins curve, like a car: slow on arcs, fast on straights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from muro_zenoh.behaviours.interface import Behaviour, BehaviourKind, Expectation, Intent, Need, Seen, Vehicle, hold
from muro_zenoh.control.path_tracking import TrackingGains
from muro_zenoh.control.ride import Ride, RideSettings, is_at, ride_on, set_out
from muro_zenoh.control.speed_profile import SpeedProfile
from muro_zenoh.errors import ParameterError, PlanningError
from muro_zenoh.geometry import Circle
from muro_zenoh.planning.destination import Destination, require_inside
from muro_zenoh.planning.itinerary import Itinerary
from muro_zenoh.quantities import Duration, Length, check_quantities


@dataclass(frozen=True, slots=True, kw_only=True)
class RideParameters:
    """How a robot drives along Dubins curves.

    Args:
        profile: the speed along paths.
        gains: gains of the path tracking.
        turning_radius: radius of the arcs [m]; reduced by up to half where the arena requires it.
        replan_beyond: a new path is planned when the robot is further than this from the path [m].
    """

    profile: SpeedProfile = SpeedProfile()
    gains: TrackingGains = TrackingGains()
    turning_radius: Length = 0.3
    replan_beyond: Length = 0.15

    def __post_init__(self) -> None:
        check_quantities(self)

    def settings(self, vehicle: Vehicle) -> RideSettings:
        """The settings for one robot.

        Args:
            vehicle: the robot, with its limits, arena and lag.

        Raises:
            ParameterError: ``v_min`` is above the robot's ``v_max``.
        """
        if self.profile.v_min > vehicle.v_max:
            raise ParameterError(
                "v_min",
                got=f"{self.profile.v_min:g} [m/s]",
                expected=f"at most the v_max of robot {vehicle.name}, {vehicle.v_max:g} m/s",
            )
        # The rest of the turning rate is reserved for tracking corrections.
        profile = replace(
            self.profile,
            omega_max=min(self.profile.omega_max, 0.8 * vehicle.omega_max),
            reaction=max(self.profile.reaction, vehicle.lag),
        )
        return RideSettings(
            profile,
            self.gains,
            self.turning_radius,
            vehicle.arena,
            vehicle.wall_distance,
            self.replan_beyond,
            walls=vehicle.walls,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalList:
    """Goals that are known from the start.

    Args:
        goals: rows ``[x, y]`` or ``[x, y, theta]`` [m, world; rad], visited in order.
        pause: how long to stay at a goal before the next one [s].

    Raises:
        ParameterError: a malformed row, or a pause below 0.
    """

    goals: tuple[tuple[float, ...], ...] = ()
    pause: Duration = 1.0

    def __post_init__(self) -> None:
        check_quantities(self)
        for index, row in enumerate(self.goals):
            if len(row) not in (2, 3):
                raise ParameterError(f"goals[{index}]", got=f"{len(row)} numbers", expected="x, y or x, y, theta")
            if not all(map(math.isfinite, row)):
                raise ParameterError(f"goals[{index}]", got=repr(row), expected="finite numbers")

    def itinerary(self) -> Itinerary:
        """A new itinerary of these goals."""
        return Itinerary([Destination(*row) for row in self.goals], self.pause)

    def require_inside(self, fleet: Sequence[Vehicle]) -> None:
        """Refuse goals that a robot cannot reach.

        Args:
            fleet: the robots.

        Raises:
            ParameterError: a goal is outside the arena, or too near its border or a wall.
        """
        for vehicle in fleet:
            for index, (x, y, *_) in enumerate(self.goals):
                require_inside(f"goals[{index}]", x, y, vehicle.arena, vehicle.wall_distance, vehicle.walls)


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """Parameters of driving along Dubins curves.

    Args:
        ride: how to drive.
        targets: the goals.
    """

    ride: RideParameters = RideParameters()
    targets: GoalList = GoalList()


class GoalRide(Behaviour):
    """Plan a Dubins path to each goal inside the arena, and drive along it.

    Args:
        settings: how to drive.
        itinerary: the goals.
        idle: the hold reason while there is no goal; empty for the state of the itinerary.
    """

    def __init__(self, settings: RideSettings, itinerary: Itinerary, idle: str = "") -> None:
        self._settings = settings
        self._itinerary = itinerary
        self._idle = idle
        self._ride: Ride | None = None
        self._planned: Ride | None = None  # planned by go_to, not yet shown
        self._v = 0.0
        self._before = math.nan

    def go_to(self, goal: Destination, seen: Seen) -> str:
        """Plan a path to a goal, and accept the goal if there is one.

        Args:
            goal: where to go.
            seen: the robot's state.

        Returns:
            Why there is no path; empty when the goal is accepted.
        """
        if goal == self._itinerary.current and self._ride is not None:  # repeated: keep driving
            self._itinerary.replace(goal)
            return ""
        ride: Ride | None = None
        if not is_at(seen.state.pose, goal, self._settings.profile.tolerance):
            try:
                ride = set_out(seen.state.pose, goal, self._v, self._settings)
            except PlanningError as error:
                return str(error)
        self._itinerary.replace(goal)
        self._ride = self._planned = ride
        return ""

    def step(self, seen: Seen) -> Intent:
        """Plan when there is a new goal, and drive along the path.

        Args:
            seen: the robot's state, now and predicted.
        """
        dt = seen.now - self._before if self._before < seen.now else 0.0
        self._before = seen.now
        if not seen.may_drive:
            self._v = 0.0  # the ride restarts from standstill
            if self._ride is not None:
                self._ride = self._ride._replace(progress=self._ride.progress._replace(v=0.0))
        if self._itinerary.begin_next(seen.now):
            self._ride = None
        goal = self._itinerary.current
        if goal is None:
            return self._wait()
        pose = seen.state.pose
        planned, self._planned = self._planned, None
        if self._ride is None:
            if is_at(pose, goal, self._settings.profile.tolerance):
                return self._arrive(seen.now)
            try:
                self._ride = planned = set_out(pose, goal, self._v, self._settings)
            except PlanningError as error:
                self._itinerary.give_up(seen.now, str(error))
                return self._wait()
        move = ride_on(self._ride, seen.ahead.pose, dt, self._settings)
        self._ride, self._v = (move.ride if move.state == "on" else None), move.twist.v
        if move.state == "arrived":
            return self._arrive(seen.now)
        return Intent(
            move.twist,
            path=planned.path if planned is not None else None,
            path_has_heading=goal.theta is not None,
            target=(goal.x, goal.y),
        )

    def _arrive(self, now: float) -> Intent:
        self._ride = None
        self._itinerary.arrive(now)
        return self._wait()

    def _wait(self) -> Intent:
        return hold(self._itinerary.given_up or self._idle or self._itinerary.waiting)


def make(parameters: Parameters, vehicle: Vehicle) -> GoalRide:
    """The behaviour of one robot.

    Args:
        parameters: how to drive, and the goals.
        vehicle: the robot, with its limits and arena.

    Raises:
        ParameterError: the parameters do not fit the robot.
    """
    return GoalRide(parameters.ride.settings(vehicle), parameters.targets.itinerary())


def fits(parameters: Parameters, circle: Circle, fleet: Sequence[Vehicle]) -> None:
    """Refuse goals outside the arena, and a ride that a robot is too slow for.

    Args:
        parameters: how to drive, and the goals.
        circle: not used.
        fleet: the robots.

    Raises:
        ParameterError: ``v_min`` is above a robot's ``v_max``; or a goal is outside the arena, or too near its border.
    """
    for vehicle in fleet:
        parameters.ride.settings(vehicle)
    parameters.targets.require_inside(fleet)


BEHAVIOUR = BehaviourKind(
    Parameters,
    make,
    "drive to each goal along a Dubins curve",
    needs=frozenset({Need.GOALS}),
    expects=lambda parameters, vehicle: Expectation(v_min=parameters.ride.profile.v_min),
    fits=fits,
)
