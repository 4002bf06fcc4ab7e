"""The line between two robots, from the snapshot that both received."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

Point = tuple[float, float]


class Line(NamedTuple):
    """A half-plane that a robot's centre stays in, because of ``other``: (``nx``, ``ny``) times its position is at most
    ``bound`` [m, world]."""

    nx: float
    ny: float
    bound: float
    other: str


class Stretch(NamedTuple):
    """Where a robot is and where it comes to rest when it brakes: from (``x``, ``y``) to (``x_end``, ``y_end``) [m,
    world], with its velocity ``vx``, ``vy`` [m/s] and ``keep``, its radius and half the margin [m]."""

    x: float
    y: float
    x_end: float
    y_end: float
    vx: float
    vy: float
    keep: float


LEAST_NEED: Final = 0.1
"""A robot that does not approach gets as much of the free floor as one that approaches with this speed [m/s]."""


def nearest_points(a: Stretch, b: Stretch) -> tuple[Point, Point]:
    """The nearest points of two stretches, of a and of b; where they cross, their starts.

    Args:
        a: one.
        b: the other.
    """
    a_x, a_y, a_x_end, a_y_end, _, _, _ = a
    b_x, b_y, b_x_end, b_y_end, _, _, _ = b
    ax, ay, bx, by = a_x_end - a_x, a_y_end - a_y, b_x_end - b_x, b_y_end - b_y
    best, found = math.inf, ((a_x, a_y), (b_x, b_y))
    cross = ax * by - ay * bx
    if cross != 0.0:
        s = ((b_x - a_x) * by - (b_y - a_y) * bx) / cross
        t = ((b_x - a_x) * ay - (b_y - a_y) * ax) / cross
        if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
            return found
    elif ax == ay == bx == by == 0.0:  # both stand
        return found
    size = bx * bx + by * by
    for x, y in ((a_x, a_y), (a_x_end, a_y_end)) if ax or ay else ((a_x, a_y),):
        px, py = b_x, b_y
        if size:
            part = ((x - b_x) * bx + (y - b_y) * by) / size
            part = 0.0 if part < 0.0 else 1.0 if part > 1.0 else part
            px, py = b_x + part * bx, b_y + part * by
        away = (px - x) * (px - x) + (py - y) * (py - y)
        if away < best:
            best, found = away, ((x, y), (px, py))
    size = ax * ax + ay * ay
    for x, y in ((b_x, b_y), (b_x_end, b_y_end)) if size else ():
        part = ((x - a_x) * ax + (y - a_y) * ay) / size
        part = 0.0 if part < 0.0 else 1.0 if part > 1.0 else part
        px, py = a_x + part * ax, a_y + part * ay
        away = (px - x) * (px - x) + (py - y) * (py - y)
        if away < best:
            best, found = away, ((px, py), (x, y))
    return found


def nearest_on(x0: float, y0: float, dx: float, dy: float, x: float, y: float) -> Point:
    """The point of a segment that is nearest to a position.

    Args:
        x0: the segment's start [m].
        y0: the same.
        dx: from its start to its end [m].
        dy: the same.
        x: the position [m].
        y: the same.
    """
    size = dx * dx + dy * dy
    if size == 0.0:
        return x0, y0
    s = ((x - x0) * dx + (y - y0) * dy) / size
    s = 0.0 if s < 0.0 else 1.0 if s > 1.0 else s
    return x0 + s * dx, y0 + s * dy


def line_between(mine: Stretch, theirs: Stretch, other: str) -> Line:
    """My side of the line between two robots that keep apart.

    It is square to the shortest connection of the two stretches and divides what is free of it in proportion to the
    speeds with which they approach: a follower gets what is free behind the one ahead, two that meet get a half each.
    When the stretches are closer than allowed, the lack is divided in halves.

    Args:
        mine: my stretch, from the common snapshot.
        theirs: the other's, from the same snapshot.
        other: its name.
    """
    (ax, ay), (bx, by) = nearest_points(mine, theirs)
    gap = math.hypot(bx - ax, by - ay)
    if gap > 1e-9:
        nx, ny = (bx - ax) / gap, (by - ay) / gap
    else:
        gap = 0.0
        away = math.hypot(bx - mine.x, by - mine.y) or 1.0
        nx, ny = (bx - mine.x) / away, (by - mine.y) / away
        if nx == ny == 0.0:
            nx = 1.0
    free = gap - mine.keep - theirs.keep
    share = 0.5
    if free > 0.0:
        need = LEAST_NEED + max(0.0, nx * mine.vx + ny * mine.vy)
        share = need / (need + LEAST_NEED + max(0.0, -nx * theirs.vx - ny * theirs.vy))
    return Line(nx, ny, nx * ax + ny * ay + share * free, other)
