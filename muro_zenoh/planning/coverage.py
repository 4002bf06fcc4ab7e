"""Deployment: each robot drives to the centroid of its Voronoi cell, in rounds (Lloyd); and the cost of a deployment.

A cell is the arena clipped by half-planes, nearest neighbour first, until no further robot can cut it: an agent
computes only its own cell.

Source: Lloyd, IEEE Transactions on Information Theory 28, 1982; Cortes, Martinez, Karatas, Bullo, Coverage control for
mobile sensing networks, IEEE T-RA 20, 2004; seed 004, sections 1 and 7.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from muro_zenoh.geometry import Bounds
from muro_zenoh.planning.density import Density, Peaks
from muro_zenoh.planning.polygon import Point, Polygon, area, centroid, clip, quadrature

__all__ = [
    "Density",
    "Peaks",
    "Point",
    "Polygon",
    "Round",
    "area",
    "cell",
    "cell_cost",
    "cells",
    "centroid",
    "coverage_cost",
    "lloyd_goal",
    "lloyd_step",
    "next_round",
    "same_place",
]

SAME = 1e-9
"""Sites closer than this [m] count as one."""


def cell(k: int, sites: Sequence[Point], bounds: Bounds) -> Polygon:
    """The Voronoi cell of one site within the arena: the points nearer to it than to any other site.

    Sites at the same position have the same cell. A site outside the arena may have an empty one.

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
        # A bisector further away than every corner cuts nothing, and neither do those after it.
        if square > 4.0 * reach:
            break
        nx, ny = ox - x, oy - y
        polygon = clip(polygon, nx, ny, nx * (x + ox) / 2.0 + ny * (y + oy) / 2.0)
        if not polygon:
            return ()
        reach = max((px - x) ** 2 + (py - y) ** 2 for px, py in polygon)
    return polygon


def cells(sites: Sequence[Point], bounds: Bounds) -> tuple[Polygon, ...]:
    """The Voronoi cells of all sites within the arena, in their order.

    Args:
        sites: all sites [m, world].
        bounds: the arena.
    """
    return tuple(cell(k, sites, bounds) for k in range(len(sites)))


def cell_cost(site: Point, polygon: Polygon, density: Density | None = None) -> float:
    """The cost of one robot's cell: the integral over it of ``|q - p|^2 density(q)`` [m^4 times the density's unit].

    Args:
        site: the robot's position [m, world].
        polygon: its cell; the cost of an empty one is 0.
        density: the density over the floor; None for uniform (1).
    """
    if not polygon:
        return 0.0
    x, y, weight = quadrature(polygon)
    if density is not None:
        weight = weight * density(x, y)
    return float((weight * ((x - site[0]) ** 2 + (y - site[1]) ** 2)).sum())


def coverage_cost(sites: Sequence[Point], bounds: Bounds, density: Density | None = None) -> float:
    """The cost of a deployment: the density weighted with the square of the distance to the nearest robot.

    Args:
        sites: the robots' positions [m, world].
        bounds: the arena.
        density: the density over the floor; None for uniform (1).
    """
    apart = _apart(sites)
    return sum(cell_cost(site, polygon, density) for site, polygon in zip(apart, cells(apart, bounds), strict=True))


def lloyd_goal(k: int, sites: Sequence[Point], bounds: Bounds, density: Density | None = None) -> Point:
    """Where one robot should go: the centroid of its own cell [m, world].

    Robots at the same position are treated as a micrometre apart; otherwise they would never separate. A robot outside
    the arena whose cell is empty goes to the nearest point inside.

    Args:
        k: index of the robot.
        sites: all robots' positions [m, world].
        bounds: the arena.
        density: the density over the floor; None for uniform.
    """
    apart = _apart(sites)
    polygon = cell(k, apart, bounds)
    return centroid(polygon, density) if polygon else bounds.nearest(*sites[k])


def lloyd_step(sites: Sequence[Point], bounds: Bounds, density: Density | None = None) -> tuple[Point, ...]:
    """Where all robots should go: one step of Lloyd's algorithm, which never raises :func:`coverage_cost`.

    Args:
        sites: the robots' positions [m, world].
        bounds: the arena.
        density: the density over the floor; None for uniform.
    """
    return tuple(lloyd_goal(k, sites, bounds, density) for k in range(len(sites)))


class Round(NamedTuple):
    """The state of a round of a deployment: all robots drive, all are stationary for a time, all choose a new goal.

    Args:
        rest_since: when all robots became stationary [s]; None while one moves.
        due: whether all have been stationary for the hold time: the next round begins now.
    """

    rest_since: float | None = None
    due: bool = False


def next_round(now: float, rest: bool, before: Round, hold_time: float) -> Round:
    """Advance the state of the rounds by one snapshot.

    Robots that use the same snapshots, and their stamps as the time, begin every round together.

    Args:
        now: the time of the snapshot [s].
        rest: whether all robots are stationary.
        before: the previous state; ``Round()`` at first.
        hold_time: how long all must have been stationary [s].
    """
    if not rest:
        return Round()
    since = now if before.rest_since is None or before.due else before.rest_since
    return Round(since, now - since >= hold_time)


def same_place(sites: Sequence[Point]) -> list[int]:
    """For each site the index into ``sites`` of the first one at the same position, usually its own.

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
    """The sites, with those at one position spread around it by a micrometre."""
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
