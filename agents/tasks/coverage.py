"""Coverage: all positions in, a goal out; Dubins and path tracking do the rest."""

from __future__ import annotations

import asyncio
import math

from agents.robot import Robot
from agents.tasks.dubins import DubinsParameters, drive_to_goals
from muro_zenoh import channels
from muro_zenoh.config.sections import NotNegative, Positive
from muro_zenoh.messages import Estimate
from muro_zenoh.planning.coverage import Density, Peaks, Point, cell, lloyd_goal

_STALE = channels.ALL_POSITIONS.stale_after or 0.0
_REST = 0.01
"""A robot slower than this stands [m/s]."""

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
        tasks.create_task(drive_to_goals(robot, parameters), name="dubins")


async def _cover(robot: Robot, parameters: CoverageParameters, density: Density | None) -> None:
    floor = robot.arena
    bounds = floor.shrunk(robot.settings.radius)
    moved_at = shown_at = robot.now
    async for estimate in robot.estimates():
        now = robot.now
        if robot.snapshot_age > _STALE:
            moved_at = now
            continue
        sites, rest = _sites(robot, estimate)
        if not rest:
            moved_at = now
        due = now - moved_at >= parameters.hold_time
        if not due and now - shown_at < _SHOW_PERIOD:
            continue
        shown_at = now
        x, y = lloyd_goal(0, sites, floor, density)
        robot.show_cell(cell(0, sites, floor), x, y)
        if due:
            moved_at = now
            if math.hypot(x - estimate.x, y - estimate.y) > parameters.stay_within:
                robot.goal(*bounds.nearest(x, y))


def _sites(robot: Robot, estimate: Estimate) -> tuple[list[Point], bool]:
    """Who covers, oneself first, and whether all of them stand."""
    stopped = robot.stopped
    sites = [(estimate.x, estimate.y)]
    rest = abs(estimate.v) < _REST
    for other in robot.neighbours:
        if other.state in ("tracking", "disagrees") and other.name not in stopped:
            sites.append((other.x, other.y))
            rest = rest and abs(other.v) < _REST
    return sites, rest


def _row(peak: tuple[float, ...]) -> tuple[float, float, float, float]:
    if len(peak) != 4:
        raise ValueError(f"behaviour.peaks: got {len(peak)} numbers, expected rows of x, y, width, height")
    x, y, width, height = peak
    return x, y, width, height
