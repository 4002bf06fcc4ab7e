"""How well robots follow a circle and spread round it: radius error, spacing error, settling time. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from muro_zenoh.control import ring
from muro_zenoh.geometry import Circle
from muro_zenoh.scoring.observed import SAMPLE_PERIOD, Sample

RADIUS_BAND: Final = 0.03
"""A settled robot is at most this far from the circle [m]."""

SPACING_BAND: Final = 0.10
"""A settled fleet's spacing error is at most this [rad]."""

SETTLED_FOR: Final = 5.0
"""A fleet has settled once it has stayed within the bands for this long [s]."""

_GAP: Final = 5.0 * SAMPLE_PERIOD
"""Samples further apart than this do not belong to one stay within the bands [s]."""


def radius_error(position: tuple[float, float], circle: Circle) -> float:
    """Distance of a position from a circle's line [m].

    Args:
        position: x, y [m, world].
        circle: the circle.
    """
    return abs(math.hypot(position[0] - circle.x, position[1] - circle.y) - circle.radius)


def spacing_error(positions: Mapping[str, tuple[float, float]], circle: Circle) -> float:
    """The largest |gap - 2 pi / N| between neighbours round a circle's centre [rad]; 0 for fewer than two robots.

    The same for both directions of travel.

    Args:
        positions: x, y [m, world] by robot.
        circle: the circle whose centre is meant.
    """
    return ring.spacing_error(ring.angles_round(positions, circle))


def gaps_ahead(positions: Mapping[str, tuple[float, float]], circle: Circle) -> dict[str, float]:
    """The gap from each robot to the next in the direction of travel [rad]; a whole turn for a robot alone.

    Args:
        positions: x, y [m, world] by robot.
        circle: its centre, and its direction of travel.
    """
    return ring.gaps_ahead(ring.angles_round(positions, circle), circle.clockwise)


def within_bands(sample: Sample, robots: int, *, spread: bool) -> bool:
    """Whether every robot's truth is known, near the circle and, if asked for, evenly spaced.

    Args:
        sample: the fleet at one moment.
        robots: how many robots there are.
        spread: whether the spacing counts, too.
    """
    if len(sample.positions) < robots:
        return False
    if any(radius_error(position, sample.circle) > RADIUS_BAND for position in sample.positions.values()):
        return False
    return not spread or spacing_error(sample.positions, sample.circle) <= SPACING_BAND


def settle_time(moments: Sequence[tuple[float, bool]], settled_for: float = SETTLED_FOR) -> float | None:
    """The first time from which on the fleet stayed within the bands long enough [s]; None when there is none.

    Args:
        moments: time [s] and whether the fleet was within the bands then, in order. A gap of half a second ends a stay.
        settled_for: how long is long enough [s].
    """
    since = last = math.nan
    for t, within in moments:
        if not within:
            since = math.nan
        elif not t - last <= _GAP or math.isnan(since):
            since = t
        last = t
        # Times are multiples of the period, in floats.
        if within and t - since >= settled_for - 1e-6:
            return since
    return None
