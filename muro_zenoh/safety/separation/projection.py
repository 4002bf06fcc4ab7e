"""The velocity nearest to a preferred one that satisfies half-planes, exactly, in plain floats.

The incremental linear programme of van den Berg, Guy, Lin and Manocha, Reciprocal n-body collision avoidance (2011),
section 5; when no velocity satisfies all rows, the one whose largest violation is least.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple


class Row(NamedTuple):
    """A half-plane of velocities: (``nx``, ``ny``), a unit vector, times the velocity is at most ``bound`` [m/s]."""

    nx: float
    ny: float
    bound: float


_SLACK = 1e-9


def nearest_velocity(rows: Sequence[Row], vx: float, vy: float, v_max: float) -> tuple[float, float]:
    """The velocity that is allowed and nearest to a preferred one.

    Args:
        rows: what is allowed.
        vx: the preferred velocity [m/s].
        vy: the same.
        v_max: largest speed [m/s].

    Returns:
        The velocity [m/s]; when the rows exclude each other, the one with the smallest largest violation.
    """
    speed = math.hypot(vx, vy)
    if speed > v_max:
        vx, vy = vx * v_max / speed, vy * v_max / speed
    x, y = vx, vy
    for k, row in enumerate(rows):
        if row.nx * x + row.ny * y > row.bound + _SLACK:
            found = _on_border(rows, k, vx, vy, v_max, toward=False)
            if found is None:
                return _least_violation(rows, k, x, y, v_max)
            x, y = found
    return x, y


def _on_border(
    rows: Sequence[Row], k: int, vx: float, vy: float, v_max: float, *, toward: bool
) -> tuple[float, float] | None:
    """The best velocity on the border of row k that rows 0 to k - 1 allow: nearest to a point, or furthest toward a
    direction; None when they allow none."""
    nx, ny, bound = rows[k]
    if abs(bound) > v_max:
        return None
    dx, dy = -ny, nx
    half = math.sqrt(v_max * v_max - bound * bound)
    low, high = -half, half
    for other in rows[:k]:
        rate = other.nx * dx + other.ny * dy
        room = other.bound - bound * (other.nx * nx + other.ny * ny)
        if abs(rate) < 1e-9:
            if room < -_SLACK:
                return None
        elif rate > 0.0:
            high = min(high, room / rate)
        else:
            low = max(low, room / rate)
        if low > high:
            return None
    along = dx * vx + dy * vy
    s = (high if along > 0.0 else low) if toward else min(max(along, low), high)
    return bound * nx + s * dx, bound * ny + s * dy


def _least_violation(rows: Sequence[Row], first: int, x: float, y: float, v_max: float) -> tuple[float, float]:
    """From row ``first`` on, reduce the largest violation."""
    worst = 0.0
    for k in range(first, len(rows)):
        row = rows[k]
        if row.nx * x + row.ny * y - row.bound <= worst + _SLACK:
            continue
        # Where the violation of row k exceeds that of an earlier row is a half-plane too.
        between: list[Row] = []
        for other in rows[:k]:
            mx, my = other.nx - row.nx, other.ny - row.ny
            size = math.hypot(mx, my)
            if size > 1e-9:
                between.append(Row(mx / size, my / size, (other.bound - row.bound) / size))
        found = _furthest(between, -row.nx, -row.ny, v_max)
        if found is not None:
            x, y = found
        worst = row.nx * x + row.ny * y - row.bound
    return x, y


def _furthest(rows: Sequence[Row], dx: float, dy: float, v_max: float) -> tuple[float, float] | None:
    x, y = dx * v_max, dy * v_max
    for k, row in enumerate(rows):
        if row.nx * x + row.ny * y > row.bound + _SLACK:
            found = _on_border(rows, k, dx, dy, v_max, toward=True)
            if found is None:
                return None
            x, y = found
    return x, y
