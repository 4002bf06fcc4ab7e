"""The ring of a cyclic pursuit: who is on it, in which order, how far apart.

Found anew from the whole snapshot at each step. Only the order of the step before is state; it goes in and comes out.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from muro_zenoh.geometry import TWO_PI, Circle, ccw_gap

HYSTERESIS: Final = 0.05
"""Two neighbours swap in the order only when the one ahead has fallen this far behind the other [rad]."""


class RingRobot(NamedTuple):
    """What pursuit knows of a robot.

    Args:
        x: place [m, world].
        y: place [m, world].
        theta: heading [rad].
        v: speed [m/s].
        age: how old these are [s].
    """

    x: float
    y: float
    theta: float
    v: float
    age: float


def ring_angles(ring: Mapping[str, RingRobot], circle: Circle) -> dict[str, float]:
    """The angles now [rad] of the robots on the ring: those with ``|rho - r| <= r / 2``.

    Each is moved on by its own tangential speed times its age: without that, old positions bias the common speed.

    Args:
        ring: the robots that count; stale, lost and stopped ones have been left out.
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


def unroll(angles: Mapping[str, float], clockwise: bool) -> tuple[tuple[str, ...], dict[str, float]]:
    """Names in the direction of travel from the far end of the widest gap on, and the way travelled to each [rad].

    Cut at the widest gap, two robots that are close are never on either side of the cut: "just behind" then means a
    small way less, instead of a whole turn more.

    Args:
        angles: the robots on the ring: name to angle seen from the centre [rad], any turn.
        clockwise: the direction of travel.
    """
    sigma = -1.0 if clockwise else 1.0
    rows = sorted((ccw_gap(0.0, sigma * angle), name) for name, angle in angles.items())
    ways, names = [way for way, _ in rows], [name for _, name in rows]
    widest, first = -1.0, 0
    for k in range(len(names)):
        gap = ways[k] - ways[k - 1] + (TWO_PI if k == 0 else 0.0)
        if gap > widest:
            widest, first = gap, k
    ordered = (*names[first:], *names[:first])
    start = ways[first] if names else 0.0
    unrolled = {name: ways[k] - start + (TWO_PI if k < first else 0.0) for k, name in enumerate(names)}
    return ordered, unrolled


def order_ring(angles: Mapping[str, float], previous: Sequence[str], clockwise: bool) -> tuple[str, ...]:
    """Who follows whom: the names in the direction of travel, beginning behind the widest gap.

    Neighbours keep the order that they had until one is :data:`HYSTERESIS` ahead of the other: else noise on two robots
    side by side would flip a gap between nothing and a whole turn. Newcomers are put where they are; equal angles go
    by name.

    Args:
        angles: the robots on the ring: name to angle seen from the centre [rad], any turn.
        previous: what this function returned at the step before; empty at first. Names that left are ignored.
        clockwise: the direction of travel.

    Returns:
        Each name once.
    """
    return order_unrolled(*unroll(angles, clockwise), previous)


def order_unrolled(ordered: tuple[str, ...], way: Mapping[str, float], previous: Sequence[str]) -> tuple[str, ...]:
    """:func:`order_ring` of what :func:`unroll` found.

    Args:
        ordered: the names by their angles.
        way: the way travelled to each [rad].
        previous: the order of the step before.
    """
    if not previous or tuple(previous) == ordered:
        return ordered
    result = [name for name in previous if name in way]
    known = set(result)
    # Insertion sort that leaves inversions within the hysteresis: each exchange undoes a real one, so it ends.
    for k in range(1, len(result)):
        while k > 0 and way[result[k - 1]] > way[result[k]] + HYSTERESIS:
            result[k - 1], result[k] = result[k], result[k - 1]
            k -= 1
    for name in ordered:
        if name not in known:
            place = len(result)
            while place > 0 and (way[result[place - 1]], result[place - 1]) > (way[name], name):
                place -= 1
            result.insert(place, name)
    return tuple(result)


def gaps(angles: Mapping[str, float], order: Sequence[str], clockwise: bool) -> dict[str, float]:
    """The angle from each robot to its successor [rad]: each in [0, 2 pi], 2 pi in all; alone, a whole turn.

    Args:
        angles: the robots on the ring: name to angle seen from the centre [rad], any turn.
        order: from :func:`order_ring` for the same angles.
        clockwise: the direction of travel.
    """
    return gaps_unrolled(unroll(angles, clockwise)[1], order)


def gaps_unrolled(way: Mapping[str, float], order: Sequence[str]) -> dict[str, float]:
    """:func:`gaps` of what :func:`unroll` found.

    Args:
        way: the way travelled to each [rad].
        order: the order of the same robots.
    """
    result: dict[str, float] = {}
    reached = way[order[0]] if order else 0.0
    start = reached
    for name, successor in itertools.pairwise(order):
        # Two whose order the hysteresis keeps up against their angles count as side by side.
        ahead = max(reached, way[successor])
        result[name] = ahead - reached
        reached = ahead
    if order:
        result[order[-1]] = TWO_PI - (reached - start)
    return result
