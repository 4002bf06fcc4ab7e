"""The nearest point of an intersection of half-planes: the quadratic programme of two variables, solved exactly."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

_TINY = 1e-12


class HalfPlane(NamedTuple):
    """The points with ``nx x + ny y <= limit``; (``nx``, ``ny``) has length 1 and points outwards."""

    nx: float
    ny: float
    limit: float


def nearest(x: float, y: float, rows: Iterable[HalfPlane]) -> tuple[float, float] | None:
    """The point nearest to (x, y) that is in all half-planes; None when they have no point in common.

    One half-plane after the other: when it cuts off the best point so far, the new one is on its border, at the place
    nearest to (x, y) that the earlier ones leave of it. Exact; linear in the rows where few of them matter.

    Args:
        x: of the point.
        y: of the point.
        rows: the half-planes.

    Source: the incremental algorithm for linear programmes in few variables, Seidel, Discrete and Computational
    Geometry 6, 1991; it holds for any convex cost.
    """
    best_x, best_y = x, y
    earlier: list[HalfPlane] = []
    for row in rows:
        nx, ny, limit = row
        if nx * best_x + ny * best_y > limit + _TINY:
            # the border: foot + along (-ny, nx), with the foot nearest to (x, y)
            off = limit - nx * x - ny * y
            foot_x, foot_y = x + off * nx, y + off * ny
            least, most = -math.inf, math.inf
            for ax, ay, bound in earlier:
                slope = ay * nx - ax * ny
                room = bound - ax * foot_x - ay * foot_y
                if slope > _TINY:
                    most = min(most, room / slope)
                elif slope < -_TINY:
                    least = max(least, room / slope)
                elif room < -1e-9:
                    return None
            if least > most + 1e-9:
                return None
            along = min(max(0.0, least), max(least, most))
            best_x, best_y = foot_x - along * ny, foot_y + along * nx
        earlier.append(row)
    return best_x, best_y
