"""Convex polygons: clipping, area, centroid, integrals over them."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from muro_zenoh.elementwise import Array
from muro_zenoh.planning.density import Density

Point: TypeAlias = tuple[float, float]
"""A point ``x, y`` [m, world]."""

Polygon: TypeAlias = tuple[Point, ...]
"""A convex polygon, its corners counter-clockwise [m, world]; empty when it has no area."""


def clip(polygon: Polygon, nx: float, ny: float, limit: float) -> Polygon:
    """The part of a convex polygon where ``nx x + ny y <= limit``.

    Args:
        polygon: the polygon.
        nx: the half-plane's outward normal, of any length.
        ny: the same.
        limit: its offset.
    """
    depths = [nx * x + ny * y - limit for x, y in polygon]
    if max(depths) <= 0.0:
        return polygon
    kept: list[Point] = []
    before, (bx, by) = depths[-1], polygon[-1]
    for depth, (x, y) in zip(depths, polygon, strict=True):
        if (depth < 0.0 < before) or (before < 0.0 < depth):
            part = before / (before - depth)
            kept.append((bx + part * (x - bx), by + part * (y - by)))
        if depth <= 0.0:
            kept.append((x, y))
        before, bx, by = depth, x, y
    return tuple(kept) if len(kept) > 2 else ()


def area(polygon: Polygon) -> float:
    """Area of a polygon [m^2].

    Args:
        polygon: its corners, counter-clockwise.
    """
    return moments(polygon)[0]


def centroid(polygon: Polygon, density: Density | None = None) -> Point:
    """The (density-weighted) centroid of a cell [m, world].

    Args:
        polygon: the cell, not empty.
        density: the density over the floor; None for uniform, which is exact.

    Raises:
        ValueError: an empty cell.
    """
    if not polygon:
        raise ValueError("centroid: got a cell without area, expected at least three corners")
    if density is None:
        mass, mx, my = moments(polygon)
        # The cell is almost empty: use the mean of its corners.
        if mass <= 1e-15:
            return sum(x for x, _ in polygon) / len(polygon), sum(y for _, y in polygon) / len(polygon)
        return mx / mass, my / mass
    x, y, weight = quadrature(polygon)
    weight = weight * density(x, y)
    total = float(weight.sum())
    return float((weight * x).sum()) / total, float((weight * y).sum()) / total


def moments(polygon: Polygon) -> tuple[float, float, float]:
    """Area [m^2] and first moments [m^3] of a polygon.

    Args:
        polygon: its corners, counter-clockwise.
    """
    # About the first corner, for accuracy with small cells far from the origin.
    if len(polygon) < 3:
        return 0.0, 0.0, 0.0
    x0, y0 = polygon[0]
    total = mx = my = 0.0
    ax, ay = polygon[1][0] - x0, polygon[1][1] - y0
    for x, y in polygon[2:]:
        bx, by = x - x0, y - y0
        double = ax * by - bx * ay
        total += double
        mx += double * (ax + bx)
        my += double * (ay + by)
        ax, ay = bx, by
    mass = 0.5 * total
    return mass, mx / 6.0 + x0 * mass, my / 6.0 + y0 * mass


# Seven points, exact to degree 5 (Radon 1948): barycentric coordinates and weights.
_A, _B = (6.0 - math.sqrt(15.0)) / 21.0, (6.0 + math.sqrt(15.0)) / 21.0
_BARYCENTRIC = np.array(
    [
        [1 / 3, 1 / 3, 1 / 3],
        *([1 - 2 * _A, _A, _A], [_A, 1 - 2 * _A, _A], [_A, _A, 1 - 2 * _A]),
        *([1 - 2 * _B, _B, _B], [_B, 1 - 2 * _B, _B], [_B, _B, 1 - 2 * _B]),
    ]
)
_WEIGHTS = np.array([9 / 40] + [(155 - math.sqrt(15)) / 1200] * 3 + [(155 + math.sqrt(15)) / 1200] * 3)


def _refined(levels: int) -> tuple[Array, Array]:
    """The rule on a triangle divided into four, ``levels`` times."""
    corners = np.eye(3)[None]
    for _ in range(levels):
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        corners = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    points = np.einsum("qk,tkj->tqj", _BARYCENTRIC, corners).reshape(-1, 3)
    return points, np.tile(_WEIGHTS, len(corners)) / len(corners)


_POINTS, _SHARES = _refined(2)


def quadrature(polygon: Polygon) -> tuple[Array, Array, Array]:
    """Points ``x, y`` of a convex polygon [m] and their shares of its area [m^2]: 112 in each triangle of a fan.

    Args:
        polygon: its corners, counter-clockwise.
    """
    corners = np.array(polygon)
    middle = corners.mean(axis=0)
    following = np.roll(corners, -1, axis=0)
    triangles = np.stack([np.broadcast_to(middle, corners.shape), corners, following], axis=1)
    (ax, ay), (bx, by) = (corners - middle).T, (following - middle).T
    points = np.einsum("qk,tkj->tqj", _POINTS, triangles)
    weight = 0.5 * (ax * by - bx * ay)[:, None] * _SHARES
    return points[..., 0].ravel(), points[..., 1].ravel(), weight.ravel()
