"""The ring of a cyclic pursuit: which robots are on it, in which order, and how far apart.

Recomputed from the whole snapshot at each step. The previous order is the only state; it is passed in and returned.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from muro_zenoh.geometry import TWO_PI, Circle, ccw_gap

HYSTERESIS: Final = 0.05
"""Two neighbours swap in the order only when the one ahead has fallen behind the other by this angle [rad]."""


class RingRobot(NamedTuple):
    """A robot as pursuit sees it.

    Args:
        x: position [m, world].
        y: position [m, world].
        theta: heading [rad].
        v: speed [m/s].
        age: age of these values [s].
    """

    x: float
    y: float
    theta: float
    v: float
    age: float


def ring_angles(ring: Mapping[str, RingRobot], circle: Circle) -> dict[str, float]:
    """The angles now [rad] of the robots on the ring: those with ``|rho - r| <= r / 2``.

    Each angle is advanced by the robot's tangential speed times its age; otherwise old positions bias the common speed.

    Args:
        ring: the robots that take part, without stale, lost and stopped ones.
        circle: the circle.
    """
    angles: dict[str, float] = {}
    for name, robot in ring.items():
        px, py = robot.x - circle.x, robot.y - circle.y
        rho = math.hypot(px, py)
        if abs(rho - circle.radius) <= 0.5 * circle.radius:
            phi = math.atan2(py, px)
            angles[name] = phi + robot.v * math.sin(robot.theta - phi) / rho * robot.age
    return angles


def angles_round(places: Mapping[str, tuple[float, float]], circle: Circle) -> dict[str, float]:
    """The angles of robots seen from a circle's centre [rad].

    Args:
        places: x, y [m, world] by robot.
        circle: the circle.
    """
    return {name: math.atan2(y - circle.y, x - circle.x) for name, (x, y) in places.items()}


def unroll(angles: Mapping[str, float], clockwise: bool) -> dict[str, float]:
    """The ring cut open at its widest gap: the angle travelled to each robot [rad], in the order of travel.

    With the cut there, two close robots are never on opposite sides of it: "just behind" means a slightly smaller
    angle, not one larger by a whole turn. Ties are broken by name.

    Args:
        angles: the robots on the ring: name to angle seen from the centre [rad], any turn.
        clockwise: the direction of travel.
    """
    sigma = -1.0 if clockwise else 1.0
    rows = sorted((ccw_gap(0.0, sigma * angle), name) for name, angle in angles.items())
    widest, first = -1.0, 0
    for k, (angle, _) in enumerate(rows):
        gap = angle - rows[k - 1][0] + (TWO_PI if k == 0 else 0.0)
        if gap > widest:
            widest, first = gap, k
    start = rows[first][0] if rows else 0.0
    unrolled = {name: angle - start for angle, name in rows[first:]}
    unrolled.update((name, angle - start + TWO_PI) for angle, name in rows[:first])
    return unrolled


def order_ring(travelled: Mapping[str, float], previous: Sequence[str]) -> tuple[str, ...]:
    """The names in the direction of travel, beginning behind the widest gap.

    Neighbours keep their previous order until one is :data:`HYSTERESIS` ahead of the other; otherwise noise on two
    robots side by side would flip a gap between 0 and 2 pi. New robots are inserted by their angle.

    Args:
        travelled: the ring, from :func:`unroll` [rad].
        previous: the order of the previous step; empty at first. Names that have left are ignored.

    Returns:
        Each name once.
    """
    ordered = tuple(travelled)
    if not previous or tuple(previous) == ordered:
        return ordered
    result = [name for name in previous if name in travelled]
    known = set(result)
    # Insertion sort that keeps inversions within the hysteresis: each exchange removes a real inversion, so it ends.
    for k in range(1, len(result)):
        while k > 0 and travelled[result[k - 1]] > travelled[result[k]] + HYSTERESIS:
            result[k - 1], result[k] = result[k], result[k - 1]
            k -= 1
    for name in ordered:
        if name not in known:
            place = len(result)
            while place > 0 and (travelled[result[place - 1]], result[place - 1]) > (travelled[name], name):
                place -= 1
            result.insert(place, name)
    return tuple(result)


def gaps(travelled: Mapping[str, float], order: Sequence[str]) -> dict[str, float]:
    """The angle from each robot to its successor [rad]: each in [0, 2 pi], 2 pi in total; 2 pi for a single robot.

    Args:
        travelled: the ring, from :func:`unroll` [rad].
        order: from :func:`order_ring` for the same ring.
    """
    result: dict[str, float] = {}
    reached = start = travelled[order[0]] if order else 0.0
    for name, successor in itertools.pairwise(order):
        # Two robots whose order contradicts their angles, within the hysteresis, count as side by side.
        ahead = max(reached, travelled[successor])
        result[name] = ahead - reached
        reached = ahead
    if order:
        result[order[-1]] = TWO_PI - (reached - start)
    return result


def gaps_ahead(angles: Mapping[str, float], clockwise: bool) -> dict[str, float]:
    """:func:`gaps` of robots as they are now, without a previous order.

    Args:
        angles: name to angle seen from the centre [rad], any turn.
        clockwise: the direction of travel.
    """
    travelled = unroll(angles, clockwise)
    return gaps(travelled, tuple(travelled))


def spacing_error(angles: Mapping[str, float]) -> float:
    """The largest ``|gap - 2 pi / N|`` of N robots [rad]; 0 for fewer than two. The same in both directions.

    Args:
        angles: name to angle seen from the centre [rad], any turn.
    """
    even = TWO_PI / max(len(angles), 1)
    return max((abs(gap - even) for gap in gaps_ahead(angles, False).values()), default=0.0)
