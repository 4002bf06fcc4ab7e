"""Coverage: all positions in, a goal out; Dubins and path tracking do the rest."""

from __future__ import annotations

import asyncio
import math
from typing import NamedTuple

from agents.robot import Robot
from agents.tasks.dubins import DubinsParameters, drive_to_goals
from muro_zenoh import channels
from muro_zenoh.messages import FleetSnapshot
from muro_zenoh.planning.coverage import Density, Peaks, Point, Round, cell, lloyd_goal, next_round
from muro_zenoh.quantities import NotNegative, Positive

_STALE = channels.ALL_POSITIONS.stale_after or 0.0
_REST = 0.01
"""A robot slower than this [m/s] ..."""

_REST_TURNING = 0.1
"""... that turns slower than this [rad/s] stands."""

_OUTSIDE = 1.0
"""A robot farther outside the arena is not taken into account [m]."""

_SHOW_PERIOD = 1.0


class CoverageParameters(DubinsParameters, frozen=True, kw_only=True):
    """Parameters of the behaviour ``coverage``, besides those of ``dubins``.

    Attributes:
        hold_time: all robots have stood for so long when the next round begins [s].
        stay_within: a robot so near its cell's centroid stays where it is [m].
        peaks: density: rows ``[x, y, width, height]`` [m, world] of Gaussian peaks; none for all places alike.
        floor: density far from every peak.
    """

    hold_time: NotNegative = 1.0
    stay_within: Positive = 0.02
    peaks: tuple[tuple[float, ...], ...] = ()
    floor: Positive = 0.05

    def density(self) -> Density | None:
        """How much each place matters; None for all alike."""
        return Peaks(tuple(_row(peak) for peak in self.peaks), self.floor) if self.peaks else None


async def coverage(robot: Robot) -> None:
    """Deploy: to the centroid of the own cell, again and again (Lloyd), in rounds that all robots see alike."""
    parameters = robot.parameters_as(CoverageParameters)
    density = parameters.density()
    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(_cover(robot, parameters, density), name="coverage")
        tasks.create_task(drive_to_goals(robot, parameters, "at rest, until all are"), name="dubins")


async def _cover(robot: Robot, parameters: CoverageParameters, density: Density | None) -> None:
    """Await the newest snapshot; when by it all have stood for the hold time, go where the own cell's centroid is.

    Everybody judges the same snapshots by their own stamps, so a round begins for all of them at once: judged by each
    robot's clock and estimate, the first to go would make the others wait for it.
    """
    floor = robot.arena
    bounds = floor.shrunk(robot.settings.radius)
    epoch = -1
    told = shown_at = -math.inf
    turn = Round()
    stood: dict[str, Mean] = {}
    async for _ in robot.estimates():
        snapshot = robot.snapshot
        if snapshot is None or robot.snapshot_age > _STALE:
            turn = Round()
            continue
        now = snapshot.stamp
        if snapshot.epoch != epoch:  # a base station that starts again may have a clock that is behind
            epoch, told, shown_at, turn = snapshot.epoch, -math.inf, -math.inf, Round()
        if now <= told:
            continue
        told = now
        seen, rest = _covering(robot, snapshot)
        before, turn = turn, next_round(now, rest, turn, parameters.hold_time)
        if turn.rest_since is None or turn.rest_since != before.rest_since:
            stood = {}
        # The noise of one fix would make a robot at the edge of stay_within go in one round or another, for ever.
        stood = {name: stood.get(name, Mean()).with_(place) for name, place in seen.items()}
        if robot.name not in stood:
            continue
        sites = [stood[robot.name].place, *(mean.place for name, mean in stood.items() if name != robot.name)]
        if not (turn.due or now - shown_at >= _SHOW_PERIOD):
            continue
        shown_at = now
        x, y = lloyd_goal(0, sites, floor, density)
        robot.show_cell(cell(0, sites, floor), x, y)
        if turn.due and math.dist((x, y), sites[0]) > parameters.stay_within:
            robot.goal(*bounds.nearest(x, y))


class Mean(NamedTuple):
    """The mean of places: their sums [m, world], and how many."""

    x: float = 0.0
    y: float = 0.0
    many: int = 0

    def with_(self, place: Point) -> Mean:
        """With one more."""
        return Mean(self.x + place[0], self.y + place[1], self.many + 1)

    @property
    def place(self) -> Point:
        """The mean [m, world]."""
        return self.x / self.many, self.y / self.many


def _covering(robot: Robot, snapshot: FleetSnapshot) -> tuple[dict[str, Point], bool]:
    """Who covers, and where, and whether all of them stand. One far outside the arena covers nothing in it."""
    stopped = robot.stopped
    near = robot.arena.shrunk(-_OUTSIDE)
    places: dict[str, Point] = {}
    rest = True
    for one in snapshot.robots:
        if one.state in ("tracking", "disagrees") and one.name not in stopped and near.holds(one.x, one.y):
            places[one.name] = (one.x, one.y)
            rest = rest and abs(one.v) < _REST and abs(one.omega) < _REST_TURNING
    return places, rest


def _row(peak: tuple[float, ...]) -> tuple[float, float, float, float]:
    if len(peak) != 4:
        raise ValueError(f"behaviour.peaks: got {len(peak)} numbers, expected rows of x, y, width, height")
    x, y, width, height = peak
    return x, y, width, height
