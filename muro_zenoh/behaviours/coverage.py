"""Deploy over the floor: each robot to the centroid of its Voronoi cell, round after round (Lloyd)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from muro_zenoh.behaviours.dubins import GoalRide, RideParameters
from muro_zenoh.behaviours.interface import (
    Behaviour,
    BehaviourKind,
    Deployment,
    Expectation,
    Intent,
    Need,
    Seen,
    ShownCell,
    Snapshot,
    Vehicle,
    is_visible,
)
from muro_zenoh.errors import ParameterError
from muro_zenoh.planning.coverage import Density, Peaks, Point, Round, cell, lloyd_goal, next_round
from muro_zenoh.planning.destination import Destination
from muro_zenoh.planning.itinerary import Itinerary
from muro_zenoh.quantities import Duration, Length, Positive, check_quantities

_REST = 0.01
"""A robot slower than this [m/s] ..."""

_REST_TURNING = 0.1
"""... that turns slower than this [rad/s] is at rest."""

_OUTSIDE = 1.0
"""A robot farther than this outside the arena is ignored [m]."""

_SHOW_PERIOD = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """Parameters of deployment.

    Args:
        ride: how to drive.
        hold_time: the next round begins when all robots have been at rest for this time [s].
        stay_within: a robot this near its cell's centroid stays where it is [m].
        peaks: density: rows ``[x, y, width, height]`` [m, world] of Gaussian peaks; none for all places alike.
        floor: density far from every peak.

    Raises:
        ParameterError: a number outside its limits, or a row of peaks that is none.
    """

    ride: RideParameters = RideParameters()
    hold_time: Duration = 1.0
    stay_within: Length = 0.02
    peaks: tuple[tuple[float, ...], ...] = ()
    floor: Positive = 0.05

    def __post_init__(self) -> None:
        check_quantities(self)
        self.density()

    def density(self) -> Density | None:
        """How much each place matters; None for all alike.

        Raises:
            ParameterError: a row of peaks that is none.
        """
        for index, row in enumerate(self.peaks):
            if len(row) != 4:
                raise ParameterError(f"peaks[{index}]", got=f"{len(row)} numbers", expected="x, y, width, height")
        rows = tuple((x, y, width, height) for x, y, width, height in self.peaks)
        return Peaks(rows, self.floor) if rows else None


class Coverage(Behaviour):
    """Go to the centroid of this robot's own cell, again and again, in rounds that all robots see alike.

    Every robot judges the same snapshots by their own stamps, so a round begins for all of them at once: judged by each
    robot's clock and estimate, the first to go would make the others wait for it.

    Args:
        parameters: of the deployment.
        vehicle: this robot.
    """

    def __init__(self, parameters: Parameters, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._parameters = parameters
        self._density = parameters.density()
        self._inside = vehicle.arena.shrunk(vehicle.radius)
        self._ride = GoalRide(parameters.ride.settings(vehicle), Itinerary(), "at rest, until all are")
        self._epoch = -1
        self._stamp = self._shown_at = -math.inf
        self._round = Round()
        self._rested: dict[str, _Mean] = {}

    def step(self, seen: Seen) -> Intent:
        """Look whether a round begins, and drive on to the centroid.

        Args:
            seen: all robots, and where this one is.
        """
        shown = None
        if seen.snapshot is None:
            self._round = Round()
        else:
            shown = self._look(seen.snapshot, seen)
        return self._ride.step(seen)._replace(cell=shown)

    def _look(self, snapshot: Snapshot, seen: Seen) -> ShownCell | None:
        now = snapshot.stamp
        if snapshot.epoch != self._epoch:  # a base station that starts again may have a clock that is behind
            self._epoch, self._round = snapshot.epoch, Round()
            self._stamp = self._shown_at = -math.inf
        if now <= self._stamp:
            return None
        self._stamp = now
        places, rest = self._covering(snapshot, seen.stopped)
        before, self._round = self._round, next_round(now, rest, self._round, self._parameters.hold_time)
        if self._round.rest_since is None or self._round.rest_since != before.rest_since:
            self._rested = {}
        # The noise of one fix would make a robot at the edge of stay_within go in one round or another, for ever.
        self._rested = {name: self._rested.get(name, _Mean()).with_(place) for name, place in places.items()}
        mine = self._rested.get(self._vehicle.name)
        if mine is None or not (self._round.due or now - self._shown_at >= _SHOW_PERIOD):
            return None
        self._shown_at = now
        others = (mean.place for name, mean in self._rested.items() if name != self._vehicle.name)
        sites = [mine.place, *others]
        x, y = lloyd_goal(0, sites, self._vehicle.arena, self._density)
        if self._round.due and math.dist((x, y), sites[0]) > self._parameters.stay_within:
            self._ride.go_to(Destination(*self._inside.nearest(x, y)), seen)
        return ShownCell(cell(0, sites, self._vehicle.arena), x, y)

    def _covering(self, snapshot: Snapshot, stopped: frozenset[str]) -> tuple[dict[str, Point], bool]:
        """Where the robots are that take part, and whether all of them are at rest."""
        near = self._vehicle.arena.shrunk(-_OUTSIDE)
        places: dict[str, Point] = {}
        rest = True
        for robot in snapshot.robots:
            if is_visible(robot) and robot.name not in stopped and near.holds(robot.x, robot.y):
                places[robot.name] = (robot.x, robot.y)
                rest = rest and abs(robot.v) < _REST and abs(robot.omega) < _REST_TURNING
        return places, rest


class _Mean(NamedTuple):
    """The mean of places: their sums [m, world], and how many there are."""

    x: float = 0.0
    y: float = 0.0
    number: int = 0

    def with_(self, place: Point) -> _Mean:
        """With one more."""
        return _Mean(self.x + place[0], self.y + place[1], self.number + 1)

    @property
    def place(self) -> Point:
        """The mean [m, world]."""
        return self.x / self.number, self.y / self.number


def expects(parameters: Parameters) -> Expectation:
    """What its score sheet shows.

    Args:
        parameters: of the deployment.
    """
    return Expectation(
        v_min=parameters.ride.profile.v_min, deployment=Deployment(parameters.density(), parameters.hold_time)
    )


BEHAVIOUR = BehaviourKind(
    Parameters,
    Coverage,
    "deploy over the floor, each robot to the centroid of its Voronoi cell",
    needs=frozenset({Need.SNAPSHOT}),
    expects=expects,
)
