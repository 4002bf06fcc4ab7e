"""Drive to each goal along a Dubins curve, like a car: slow in turns, quick on straights."""

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
from muro_zenoh.planning.destination import Destination
from muro_zenoh.planning.itinerary import Itinerary
from muro_zenoh.quantities import Duration, Length, check_quantities


@dataclass(frozen=True, slots=True, kw_only=True)
class RideParameters:
    """How a robot drives along Dubins curves.

    Args:
        profile: the speed along paths.
        gains: of the path tracking.
        turning_radius: of the arcs [m]; a tighter one, down to half, is taken where the arena asks for it.
        replan_beyond: farther than this from the path, a new one is planned [m].
    """

    profile: SpeedProfile = SpeedProfile()
    gains: TrackingGains = TrackingGains()
    turning_radius: Length = 0.3
    replan_beyond: Length = 0.15

    def __post_init__(self) -> None:
        check_quantities(self)

    def settings(self, vehicle: Vehicle) -> RideSettings:
        """The same, for one robot.

        Args:
            vehicle: whose limits, arena and lag these are.

        Raises:
            ParameterError: it cannot drive as slowly as its arcs ask for.
        """
        if self.profile.v_min > vehicle.v_max:
            raise ParameterError(
                "v_min",
                got=f"{self.profile.v_min:g} [m/s]",
                expected=f"at most the v_max of robot {vehicle.name}, {vehicle.v_max:g} m/s",
            )
        # Some of the turning is left for coming back to the path.
        profile = replace(
            self.profile,
            omega_max=min(self.profile.omega_max, 0.8 * vehicle.omega_max),
            reaction=max(self.profile.reaction, vehicle.lag),
        )
        return RideSettings(profile, self.gains, self.turning_radius, vehicle.arena, vehicle.radius, self.replan_beyond)


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalList:
    """Goals that are known from the start.

    Args:
        goals: rows ``[x, y]`` or ``[x, y, theta]`` [m, world; rad], gone to one after the other.
        pause: how long to stay at a goal before the next one of the list [s].

    Raises:
        ParameterError: a row that is no goal, or a pause below 0.
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
        """The goals, none of them reached."""
        return Itinerary([Destination(*row) for row in self.goals], self.pause)

    def require_inside(self, fleet: Sequence[Vehicle]) -> None:
        """Refuse goals that a robot cannot stand on.

        Args:
            fleet: the robots.

        Raises:
            ParameterError: a goal is outside the arena, or too near its border.
        """
        for vehicle in fleet:
            for index, (x, y, *_) in enumerate(self.goals):
                if not vehicle.arena.shrunk(vehicle.radius).holds(x, y):
                    raise ParameterError(
                        f"goals[{index}]",
                        got=f"({x:g}, {y:g})",
                        expected=f"a place at least the robot's radius, {vehicle.radius:g} m, inside the arena",
                    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """Parameters of driving along Dubins curves.

    Args:
        ride: how to drive.
        targets: where to.
    """

    ride: RideParameters = RideParameters()
    targets: GoalList = GoalList()


class GoalRide(Behaviour):
    """Plan a Dubins path to each goal inside the arena, and drive along it.

    Args:
        settings: how to drive.
        itinerary: where to.
        idle: what to say while there is no goal; empty for the state of the itinerary.
    """

    def __init__(self, settings: RideSettings, itinerary: Itinerary, idle: str = "") -> None:
        self._settings = settings
        self._itinerary = itinerary
        self._idle = idle
        self._ride: Ride | None = None
        self._planned: Ride | None = None  # by go_to, and not shown yet
        self._v = 0.0
        self._before = math.nan

    def go_to(self, goal: Destination, seen: Seen) -> str:
        """Plan a path to a goal and take it, unless there is none.

        Args:
            goal: where to go.
            seen: where the robot is.

        Returns:
            Why there is no path; empty when the goal is taken.
        """
        if goal == self._itinerary.current and self._ride is not None:  # repeated: it goes on
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
        """Plan when there is something new to plan, and drive on.

        Args:
            seen: where the robot is and will be.
        """
        dt = seen.now - self._before if self._before < seen.now else 0.0
        self._before = seen.now
        if not seen.may_drive:
            self._v = 0.0  # the ride starts again from standstill
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
            move.twist, path=planned.path if planned is not None else None, path_has_heading=goal.theta is not None
        )

    def _arrive(self, now: float) -> Intent:
        self._ride = None
        self._itinerary.arrive(now)
        return self._wait()

    def _wait(self) -> Intent:
        waiting = self._itinerary.waiting
        return hold(self._idle if self._idle and "given up" not in waiting else waiting)


def make(parameters: Parameters, vehicle: Vehicle) -> GoalRide:
    """The behaviour of one robot.

    Args:
        parameters: how to drive, and where to.
        vehicle: whose limits and arena it has.

    Raises:
        ParameterError: it cannot drive so.
    """
    return GoalRide(parameters.ride.settings(vehicle), parameters.targets.itinerary())


def fits(parameters: Parameters, circle: Circle, fleet: Sequence[Vehicle]) -> None:
    """Refuse goals outside the arena.

    Args:
        parameters: with the goals.
        circle: any.
        fleet: the robots.

    Raises:
        ParameterError: a goal is outside the arena, or too near its border.
    """
    parameters.targets.require_inside(fleet)


BEHAVIOUR = BehaviourKind(
    Parameters,
    make,
    "drive to each goal along a Dubins curve",
    needs=frozenset({Need.GOALS}),
    expects=lambda parameters: Expectation(goals=True, v_min=parameters.ride.profile.v_min),
    fits=fits,
)
