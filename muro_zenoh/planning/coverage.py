"""Deployment: each robot to the centroid of its Voronoi cell, again and again (Lloyd), and what that costs.

A cell is cut out of the arena by half-planes, nearest neighbour first, and done when no further robot can reach it: an
agent needs its own cell only. All cells of many robots at once come quicker from
:func:`muro_zenoh.planning.voronoi.voronoi_cells`, which needs shapely.

Source: Lloyd, IEEE Transactions on Information Theory 28, 1982; Cortes, Martinez, Karatas, Bullo, Coverage control for
mobile sensing networks, IEEE T-RA 20, 2004; seed 004, sections 1 and 7.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from muro_zenoh.elementwise import Array
from muro_zenoh.planning.arena import Bounds

Point: TypeAlias = tuple[float, float]
"""A place ``x, y`` [m, world]."""

Polygon: TypeAlias = tuple[Point, ...]
"""A convex polygon, its corners counter-clockwise [m, world]; empty for no area at all."""

Density: TypeAlias = Callable[[Any, Any], Any]
"""How much each place matters: arrays ``x, y`` [m, world] to an array above 0, of any scale."""

SAME = 1e-9
"""Sites nearer than this [m] count as one."""


@dataclass(frozen=True, slots=True)
class Peaks:
    """A density of Gaussian peaks on a floor, callable as a :data:`Density`.

    ``floor + sum of height exp(-((x - px)^2 + (y - py)^2) / (2 width^2))``

    Args:
        peaks: rows ``x, y, width, height``: place [m, world], width [m] above 0, height not below 0.
        floor: density far from every peak, above 0.

    Raises:
        ValueError: a number outside those ranges.
    """

    peaks: tuple[tuple[float, float, float, float], ...]
    floor: float = 0.05

    def __post_init__(self) -> None:
        if not (math.isfinite(self.floor) and self.floor > 0.0):
            raise ValueError(f"Peaks.floor: got {self.floor!r}, expected a finite number above 0")
        for row in self.peaks:
            if len(row) != 4 or not all(map(math.isfinite, row)) or row[2] <= 0.0 or row[3] < 0.0:
                raise ValueError(f"Peaks.peaks: got {row!r}, expected x, y, width above 0, height not below 0")

    def __call__(self, x: Array, y: Array) -> Array:
        """The density at places, of their shape.

        Args:
            x: places [m, world].
            y: places [m, world].
        """
        total = np.full(np.shape(x), self.floor)
        for px, py, width, height in self.peaks:
            total += height * np.exp(-((x - px) ** 2 + (y - py) ** 2) / (2.0 * width * width))
        return total


def cell(k: int, sites: Sequence[Point], bounds: Bounds) -> Polygon:
    """The Voronoi cell of one site within the arena: what is nearer to it than to any other.

    Sites at the same place have the same cell. A site outside the arena may have an empty one.

    Args:
        k: which site.
        sites: all sites [m, world].
        bounds: the arena.
    """
    x, y = sites[k]
    others = []
    for j, (ox, oy) in enumerate(sites):
        square = (ox - x) ** 2 + (oy - y) ** 2
        if j != k and square > SAME * SAME:
            others.append((square, ox, oy))
    others.sort()
    polygon: Polygon = bounds.corners
    reach = max((px - x) ** 2 + (py - y) ** 2 for px, py in polygon)
    for square, ox, oy in others:
        # A bisector farther than every corner cuts nothing, nor does any after it.
        if square > 4.0 * reach:
            break
        nx, ny = ox - x, oy - y
        polygon = clip(polygon, nx, ny, nx * (x + ox) / 2.0 + ny * (y + oy) / 2.0)
        if not polygon:
            return ()
        reach = max((px - x) ** 2 + (py - y) ** 2 for px, py in polygon)
    return polygon


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


def cells(sites: Sequence[Point], bounds: Bounds) -> tuple[Polygon, ...]:
    """The Voronoi cells of all sites within the arena, in their order.

    Args:
        sites: all sites [m, world].
        bounds: the arena.
    """
    return tuple(cell(k, sites, bounds) for k in range(len(sites)))


def area(polygon: Polygon) -> float:
    """Area of a polygon [m^2].

    Args:
        polygon: its corners, counter-clockwise.
    """
    return _moments(polygon)[0]


def centroid(polygon: Polygon, density: Density | None = None) -> Point:
    """The (density-weighted) centroid of a cell [m, world].

    Args:
        polygon: the cell, not empty.
        density: how much each place matters; None for all alike, which is exact.

    Raises:
        ValueError: an empty cell.
    """
    if not polygon:
        raise ValueError("centroid: got a cell without area, expected at least three corners")
    if density is None:
        mass, mx, my = _moments(polygon)
        # Nearly nothing is left of the cell: its middle will do.
        if mass <= 1e-15:
            return sum(x for x, _ in polygon) / len(polygon), sum(y for _, y in polygon) / len(polygon)
        return mx / mass, my / mass
    x, y, weight = _quadrature(polygon)
    weight = weight * density(x, y)
    total = float(weight.sum())
    return float((weight * x).sum()) / total, float((weight * y).sum()) / total


def cell_cost(site: Point, polygon: Polygon, density: Density | None = None) -> float:
    """What one robot's cell costs: the integral over it of ``|q - p|^2 density(q)`` [m^4 times the density's unit].

    Args:
        site: where the robot is [m, world].
        polygon: its cell; empty costs nothing.
        density: how much each place matters; None for all alike (1).
    """
    if not polygon:
        return 0.0
    x, y, weight = _quadrature(polygon)
    if density is not None:
        weight = weight * density(x, y)
    return float((weight * ((x - site[0]) ** 2 + (y - site[1]) ** 2)).sum())


def coverage_cost(sites: Sequence[Point], bounds: Bounds, density: Density | None = None) -> float:
    """What a deployment costs: each place weighted with the square of the way from its nearest robot.

    Args:
        sites: where the robots are [m, world].
        bounds: the arena.
        density: how much each place matters; None for all alike (1).
    """
    apart = _apart(sites)
    return sum(cell_cost(site, polygon, density) for site, polygon in zip(apart, cells(apart, bounds), strict=True))


def lloyd_goal(k: int, sites: Sequence[Point], bounds: Bounds, density: Density | None = None) -> Point:
    """Where one robot should go: the centroid of its own cell [m, world].

    Robots at the same place are taken a hair apart, in their order, or they would never part. A robot outside the
    arena whose cell is empty goes to the nearest place inside.

    Args:
        k: which robot.
        sites: where all robots are [m, world].
        bounds: the arena.
        density: how much each place matters; None for all alike.
    """
    apart = _apart(sites)
    polygon = cell(k, apart, bounds)
    return centroid(polygon, density) if polygon else bounds.nearest(*sites[k])


def lloyd_step(sites: Sequence[Point], bounds: Bounds, density: Density | None = None) -> tuple[Point, ...]:
    """Where all robots should go: one step of Lloyd's algorithm, which never raises :func:`coverage_cost`.

    Args:
        sites: where the robots are [m, world].
        bounds: the arena.
        density: how much each place matters; None for all alike.
    """
    return tuple(lloyd_goal(k, sites, bounds, density) for k in range(len(sites)))


def same_place(sites: Sequence[Point]) -> list[int]:
    """For each site the first one at its place, itself mostly: an index into ``sites``.

    Args:
        sites: the sites [m, world].
    """
    first = list(range(len(sites)))
    by_x = sorted(first, key=lambda k: sites[k])
    for i, k in enumerate(by_x):
        x, y = sites[k]
        for j in reversed(by_x[:i]):
            if x - sites[j][0] > SAME:
                break
            if abs(y - sites[j][1]) <= SAME:
                low, high = sorted((first[j], first[k]))
                first = [low if f == high else f for f in first]
    return first


def _apart(sites: Sequence[Point]) -> list[Point]:
    """The sites, those at one place spread around it by a micrometre."""
    first = same_place(sites)
    apart = list(sites)
    if len(set(first)) == len(first):
        return apart
    for k, f in enumerate(first):
        count = first.count(f)
        if count > 1:
            turn = 2.0 * math.pi * first[:k].count(f) / count
            x, y = sites[f]
            apart[k] = (x + 1e-6 * math.cos(turn), y + 1e-6 * math.sin(turn))
    return apart


def _moments(polygon: Polygon) -> tuple[float, float, float]:
    """Area and first moments, about the first corner for the sake of small cells far from the origin."""
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
    """The rule on a triangle cut in four, ``levels`` times over."""
    corners = np.eye(3)[None]
    for _ in range(levels):
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        corners = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    points = np.einsum("qk,tkj->tqj", _BARYCENTRIC, corners).reshape(-1, 3)
    return points, np.tile(_WEIGHTS, len(corners)) / len(corners)


_POINTS, _SHARES = _refined(2)


def _quadrature(polygon: Polygon) -> tuple[Array, Array, Array]:
    """Points of a convex polygon and their shares of its area: a fan of triangles, 112 points in each."""
    corners = np.array(polygon)
    middle = corners.mean(axis=0)
    following = np.roll(corners, -1, axis=0)
    triangles = np.stack([np.broadcast_to(middle, corners.shape), corners, following], axis=1)
    (ax, ay), (bx, by) = (corners - middle).T, (following - middle).T
    points = np.einsum("qk,tkj->tqj", _POINTS, triangles)
    weight = 0.5 * (ax * by - bx * ay)[:, None] * _SHARES
    return points[..., 0].ravel(), points[..., 1].ravel(), weight.ravel()
