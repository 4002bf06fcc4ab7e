"""Deploy over the floor: each robot drives to the centroid of its Voronoi cell, round after round (Lloyd)."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
from muro_zenoh.geometry import Circle
from muro_zenoh.planning.coverage import Density, Peaks, Point, Round, cell, lloyd_goal, next_round
from muro_zenoh.planning.destination import Destination
from muro_zenoh.planning.itinerary import Itinerary
from muro_zenoh.quantities import Duration, Length, Positive, check_quantities
from muro_zenoh.wording import counted

_REST = 0.01
"""A stationary robot is slower than this [m/s] ..."""

_REST_TURNING = 0.1
"""... and turns slower than this [rad/s]."""

_OUTSIDE = 1.0
"""A robot further than this outside the arena is ignored [m]."""

_SHOW_PERIOD = 1.0

_WENT_BACK = 1.0
"""Snapshots whose stamps go back by more than this begin a new sequence [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """Parameters of deployment.

    Args:
        ride: how to drive.
        hold_time: the next round begins when all robots have been stationary for this time [s].
        stay_within: a robot within this distance of its cell's centroid does not move [m].
        peaks: density: rows ``[x, y, width, height]`` [m, world] of Gaussian peaks; none for a uniform density.
        floor: density far from every peak.

    Raises:
        ParameterError: a number outside its limits, or a malformed row of peaks.
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
        """The density over the floor; None for uniform.

        Raises:
            ParameterError: a malformed row of peaks.
        """
        for index, row in enumerate(self.peaks):
            if len(row) != 4:
                raise ParameterError(f"peaks[{index}]", got=f"{len(row)} numbers", expected="x, y, width, height")
        rows = tuple((x, y, width, height) for x, y, width, height in self.peaks)
        return Peaks(rows, self.floor) if rows else None


class Coverage(Behaviour):
    """Drive to the centroid of this robot's own cell, in rounds that begin for all robots together.

    Every robot decides from the same snapshots and their stamps, so a round begins for all of them at once. Decided by
    each robot's own clock and estimate, the first to start would make all others wait for it.

    Args:
        parameters: parameters of the deployment.
        vehicle: this robot.
    """

    def __init__(self, parameters: Parameters, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._parameters = parameters
        self._density = parameters.density()
        self._inside = vehicle.arena.shrunk(vehicle.wall_distance)
        self._near = vehicle.arena.shrunk(-_OUTSIDE)
        self._ride = GoalRide(parameters.ride.settings(vehicle), Itinerary(), "waiting for the other robots")
        self._epoch = -1
        self._stamp = self._shown_at = -math.inf
        self._round = Round()
        self._rested: dict[str, _Mean] = {}

    def step(self, seen: Seen) -> Intent:
        """Begin a round when it is due, and drive to the centroid.

        Args:
            seen: all robots, and this robot's state.
        """
        shown = None
        if seen.snapshot is None:
            self._round = Round()
        else:
            shown = self._look(seen.snapshot, seen)
        return self._ride.step(seen)._replace(cell=shown)

    def _look(self, snapshot: Snapshot, seen: Seen) -> ShownCell | None:
        now = snapshot.stamp
        # The clock of a restarted base station may be behind; a stamp far ahead was from another writer.
        if snapshot.epoch != self._epoch or now < self._stamp - _WENT_BACK:
            self._epoch, self._round = snapshot.epoch, Round()
            self._stamp = self._shown_at = -math.inf
        if now <= self._stamp:
            return None
        self._stamp = now
        places, rest = self._covering(snapshot, seen.stopped)
        before, self._round = self._round, next_round(now, rest, self._round, self._parameters.hold_time)
        if self._round.rest_since is None or self._round.rest_since != before.rest_since:
            self._rested = {}
        # With single fixes, noise would keep restarting a robot that is just within stay_within: use the mean.
        self._rested = {name: self._rested.get(name, _Mean()).plus(place) for name, place in places.items()}
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
        """The positions of the robots that take part, and whether all of them are stationary."""
        places: dict[str, Point] = {}
        rest = True
        for robot in snapshot.robots:
            if is_visible(robot) and robot.name not in stopped and self._near.holds(robot.x, robot.y):
                places[robot.name] = (robot.x, robot.y)
                rest = rest and abs(robot.v) < _REST and abs(robot.omega) < _REST_TURNING
        return places, rest


class _Mean(NamedTuple):
    """A mean position: sums of the coordinates [m, world], and the number of positions."""

    x: float = 0.0
    y: float = 0.0
    number: int = 0

    def plus(self, place: Point) -> _Mean:
        """The mean with one more position."""
        return _Mean(self.x + place[0], self.y + place[1], self.number + 1)

    @property
    def place(self) -> Point:
        """The mean [m, world]."""
        return self.x / self.number, self.y / self.number


def fits(parameters: Parameters, circle: Circle, fleet: Sequence[Vehicle]) -> None:
    """Refuse a ride that a robot is too slow for, and walls.

    Args:
        parameters: parameters of the deployment.
        circle: not used.
        fleet: the robots.

    Raises:
        ParameterError: ``v_min`` is above a robot's ``v_max``; or there are walls inside the arena.
    """
    if walls := fleet[0].walls:
        raise ParameterError(
            "name",
            got=f"coverage in an arena with {counted(len(walls), 'wall')}",
            expected="an arena without [[wall]], because Voronoi cells go through walls",
            hint="Leave the walls out, or choose another behaviour.",
        )
    for vehicle in fleet:
        parameters.ride.settings(vehicle)


def expects(parameters: Parameters, vehicle: Vehicle) -> Expectation:
    """What its score sheet shows.

    Args:
        parameters: parameters of the deployment.
        vehicle: a robot; its arena is the floor.
    """
    return Expectation(
        v_min=parameters.ride.profile.v_min,
        deployment=Deployment(vehicle.arena, parameters.density(), parameters.hold_time),
    )


BEHAVIOUR = BehaviourKind(
    Parameters,
    Coverage,
    "deploy over the floor: each robot drives to the centroid of its Voronoi cell",
    needs=frozenset({Need.SNAPSHOT}),
    expects=expects,
    fits=fits,
)
