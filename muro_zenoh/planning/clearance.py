"""How far a planned path stays from a wall; in closed form, and so exact on arcs and straights."""

from __future__ import annotations

import math

from muro_zenoh.geometry import Pose2
from muro_zenoh.planning.path import STRAIGHT, Arc, Path
from muro_zenoh.walls import Wall


def clearance(path: Path, wall: Wall, enough: float = math.inf) -> float:
    """The distance between a path and a wall [m]; 0 when they cross.

    Args:
        path: the path.
        wall: the wall.
        enough: any larger distance is returned as this [m]: pieces that cannot come so near are not looked at.
    """
    dx, dy = wall.x_end - wall.x, wall.y_end - wall.y
    size = math.hypot(dx, dy)
    c, s, along = dx / size, dy / size, math.atan2(dy, dx)
    least = enough
    for knot, (length, curvature) in zip(path.knots, (*path.segments, (0.0, 0.0)), strict=True):
        # From here on in the wall's frame: it is from (0, 0) to (size, 0).
        px, py = knot.x - wall.x, knot.y - wall.y
        here = Pose2(c * px + s * py, c * py - s * px, knot.theta - along)
        # Where both are nearest, one of them ends, or the path runs along the wall.
        away = math.hypot(here.x - min(max(here.x, 0.0), size), here.y)
        least = min(least, away)
        if away - length >= least:
            continue
        straight = abs(curvature) < STRAIGHT
        between = _of_straight(here, length, size) if straight else _of_arc(here, length, curvature, size)
        if between <= 0.0:
            return 0.0
        least = min(least, between)
    return least


def _of_straight(start: Pose2, length: float, size: float) -> float:
    """The least distance between a straight and a wall, which begin and end far apart [m]; 0 when they cross.

    Args:
        start: of the straight [wall].
        length: of the straight [m].
        size: the wall's length [m].
    """
    c, s = math.cos(start.theta), math.sin(start.theta)
    if start.y * s < 0.0 and abs(start.y) <= length * abs(s) and 0.0 <= start.x - start.y * c / s <= size:
        return 0.0
    least = math.inf
    for end in (0.0, size):
        part = c * (end - start.x) - s * start.y
        if 0.0 <= part <= length:
            least = min(least, abs(s * (end - start.x) + c * start.y))
    return least


def _of_arc(start: Pose2, length: float, curvature: float, size: float) -> float:
    """The same for an arc.

    Args:
        start: of the arc [wall].
        length: of the arc [m].
        curvature: of the arc [1/m], to the left positive.
        size: the wall's length [m].
    """
    arc = Arc.of(start, length, curvature)
    if abs(arc.y) <= arc.radius:
        half = math.sqrt(arc.radius * arc.radius - arc.y * arc.y)
        for dx in (-half, half):
            if 0.0 <= arc.x + dx <= size and arc.holds(math.atan2(-arc.y, dx)):
                return 0.0
    least = math.inf
    for end in (0.0, size):
        near = abs(math.hypot(end - arc.x, arc.y) - arc.radius)
        if near < least and arc.holds(math.atan2(-arc.y, end - arc.x)):
            least = near
    if 0.0 <= arc.x <= size:
        for side in (-1.0, 1.0):
            near = abs(arc.y + side * arc.radius)
            if near < least and arc.holds(side * 0.5 * math.pi):
                least = near
    return least
