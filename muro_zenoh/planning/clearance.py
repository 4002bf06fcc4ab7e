"""How far a planned path stays from a wall; exact on arcs and straights."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

from muro_zenoh.arcs import advance
from muro_zenoh.geometry import Pose2
from muro_zenoh.planning.path import STRAIGHT, Path, Segment
from muro_zenoh.walls import Wall

_HALVINGS = 40


def clearance(path: Path, wall: Wall) -> float:
    """The distance between a path and a wall [m]; 0 when they cross.

    Args:
        path: the path.
        wall: the wall.
    """
    # Where both are nearest, one of them ends, or the path runs along the wall.
    least = wall.distance(path.start.x, path.start.y)
    for knot, segment in zip(path.knots, path.segments, strict=False):
        stretches = itertools.pairwise(_turning_points(knot, segment, wall))
        for first, last in stretches:
            if _crosses(knot, segment.curvature, first, last, wall):
                return 0.0
            there = _at(knot, segment.curvature, last)
            least = min(least, wall.distance(there.x, there.y))
    for x, y in ((wall.x, wall.y), (wall.x_end, wall.y_end)):
        there = path.pose_at(path.project(x, y))
        least = min(least, math.hypot(there.x - x, there.y - y))
    return float(least)


def _turning_points(knot: Pose2, segment: Segment, wall: Wall) -> Iterator[float]:
    """The ends of a piece, and where it runs along the wall [m]: between two of these it only nears it, or only leaves
    it."""
    length, curvature = segment
    points = [0.0, length]
    if abs(curvature) >= STRAIGHT:
        along = math.atan2(wall.y_end - wall.y, wall.x_end - wall.x)
        half_turn = math.pi / abs(curvature)
        part = (math.copysign(1.0, curvature) * (along - knot.theta)) % math.pi / abs(curvature)
        while part < length:
            points.append(part)
            part += half_turn
    return iter(sorted(points))


def _crosses(knot: Pose2, curvature: float, first: float, last: float, wall: Wall) -> bool:
    """Whether a stretch of a piece, which only nears the wall's line or only leaves it, crosses the wall."""
    before, after = (_beside(_at(knot, curvature, part), wall) for part in (first, last))
    if before * after > 0.0:
        return False
    for _ in range(_HALVINGS):
        middle = 0.5 * (first + last)
        beside = _beside(_at(knot, curvature, middle), wall)
        if before * beside > 0.0:
            first, before = middle, beside
        else:
            last = middle
    there = _at(knot, curvature, last)
    return bool(wall.distance(there.x, there.y) < 1e-9)


def _beside(pose: Pose2, wall: Wall) -> float:
    """On which side of the wall's line a pose is; proportional to its distance from it."""
    return (wall.x_end - wall.x) * (pose.y - wall.y) - (wall.y_end - wall.y) * (pose.x - wall.x)


def _at(knot: Pose2, curvature: float, part: float) -> Pose2:
    return advance(knot, part, part * curvature, 1.0)
