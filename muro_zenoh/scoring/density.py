"""How well the time that robots spend along a circle matches an importance. Pure."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Final

from muro_zenoh.control.importance import Importance
from muro_zenoh.geometry import TWO_PI, Circle

BINS: Final = 36
"""Number of parts of the circle in which the time spent is compared with the importance."""


def density_error(positions: Sequence[tuple[float, float]], circle: Circle, importance: Importance) -> float | None:
    """Total variation distance between the time spent along a circle and an importance [-], 0 to 1.

    Half the sum over :data:`BINS` equal parts of \\|share of the positions there - share of the importance there\\|;
    None without positions.

    Args:
        positions: x, y [m, world] of all robots, sampled evenly in time.
        circle: the circle; only its centre is used.
        importance: the desired density.
    """
    if not positions:
        return None
    counts = [0] * BINS
    for x, y in positions:
        angle = math.atan2(y - circle.y, x - circle.x) % TWO_PI
        counts[int(angle / TWO_PI * BINS) % BINS] += 1
    edges = [importance.mass(TWO_PI * k / BINS) for k in range(BINS + 1)]
    return 0.5 * sum(
        abs(count / len(positions) - (high - low) / TWO_PI)
        for count, (low, high) in zip(counts, itertools.pairwise(edges), strict=True)
    )
