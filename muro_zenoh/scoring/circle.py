"""How well robots follow a circle and spread on it: radius error, spacing error, settling time. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from muro_zenoh.control import ring
from muro_zenoh.geometry import Circle
from muro_zenoh.scoring.observed import SAMPLE_PERIOD, Sample

RADIUS_BAND: Final = 0.03
"""Maximum distance of a settled robot from the circle [m]."""

SPACING_BAND: Final = 0.10
"""Maximum spacing error of a settled fleet [rad]."""

SETTLED_FOR: Final = 5.0
"""A fleet has settled once it has stayed within the bands for this time [s]."""

_GAP: Final = 5.0 * SAMPLE_PERIOD
"""A larger gap between samples ends a stay within the bands [s]."""


def radius_error(position: tuple[float, float], circle: Circle) -> float:
    """Distance of a position from a circle's line [m].

    Args:
        position: x, y [m, world].
        circle: the circle.
    """
    return abs(math.hypot(position[0] - circle.x, position[1] - circle.y) - circle.radius)


def spacing_error(positions: Mapping[str, tuple[float, float]], circle: Circle) -> float:
    """The largest |gap - 2 pi / N| between neighbours around a circle's centre [rad]; 0 for fewer than two robots.

    The same for both directions of travel.

    Args:
        positions: x, y [m, world] by robot.
        circle: the circle; only its centre is used.
    """
    return ring.spacing_error(ring.angles_round(positions, circle))


def gaps_ahead(positions: Mapping[str, tuple[float, float]], circle: Circle) -> dict[str, float]:
    """The gap from each robot to the next in the direction of travel [rad]; 2 pi for a single robot.

    Args:
        positions: x, y [m, world] by robot.
        circle: its centre, and its direction of travel.
    """
    return ring.gaps_ahead(ring.angles_round(positions, circle), circle.clockwise)


def within_bands(sample: Sample, robots: int, *, spread: bool) -> bool:
    """Whether every robot's true position is known and near the circle and, optionally, all are evenly spaced.

    Args:
        sample: the fleet at one moment.
        robots: number of robots.
        spread: whether to check the spacing.
    """
    if len(sample.positions) < robots:
        return False
    if any(radius_error(position, sample.circle) > RADIUS_BAND for position in sample.positions.values()):
        return False
    return not spread or spacing_error(sample.positions, sample.circle) <= SPACING_BAND


def settle_time(moments: Sequence[tuple[float, bool]], settled_for: float = SETTLED_FOR) -> float | None:
    """The first time from which the fleet stayed within the bands for long enough [s]; None when there is none.

    Args:
        moments: time [s] and whether the fleet was within the bands then, in order. A gap of half a second ends a stay.
        settled_for: the required time within the bands [s].
    """
    since = last = math.nan
    for t, within in moments:
        if not within:
            since = math.nan
        elif not t - last <= _GAP or math.isnan(since):
            since = t
        last = t
        # Tolerance for rounding: times are multiples of the period.
        if within and t - since >= settled_for - 1e-6:
            return since
    return None
