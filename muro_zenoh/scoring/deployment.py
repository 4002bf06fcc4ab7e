"""How well robots covered a floor, round by round. Pure."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Final, NamedTuple

from muro_zenoh.geometry import Bounds
from muro_zenoh.planning.coverage import Density, Point, coverage_cost, lloyd_step
from muro_zenoh.scoring.observed import SAMPLE_PERIOD, Body
from muro_zenoh.scoring.rows import Row, Table

_UNSEEN: Final = 2.0 * SAMPLE_PERIOD
"""A rest is seen up to two samples shorter than it is [s]."""

_CONVERGED: Final = 1e-4
"""Lloyd's algorithm is followed until no site moves further than this [m]."""

_MAX_STEPS: Final = 2000


class Deployment(NamedTuple):
    """What robots that cover a floor were asked for.

    Attributes:
        floor: what they cover.
        density: how much each place matters; None for all alike.
        hold_time: how long all have been stationary when a round ends [s].
    """

    floor: Bounds
    density: Density | None
    hold_time: float


class Deployed(NamedTuple):
    """How a deployment went.

    Attributes:
        distance: the largest distance from a robot to its own cell's centroid, at rest at the end [m]; None while one
            moves.
        cost: of the last round.
        gain: by what fraction Lloyd's algorithm, from the final places until it has converged, would lower the cost.
        rise: the largest fraction by which the cost rose from the end of one round to the end of the next.
        rounds: how many rounds ended.
    """

    distance: float | None
    cost: float | None
    gain: float | None
    rise: float | None
    rounds: int


@dataclass(frozen=True, slots=True)
class Coverage(Table):
    """How well the robots cover the floor."""

    distance_m: Annotated[
        float | None,
        Row(
            "at the end, the largest distance of a robot from the centroid of its own Voronoi cell, both from the true "
            "positions; `null` while a robot drives, and unless the robots are to cover the floor",
            "m",
            4,
        ),
    ]
    cost: Annotated[
        float | None,
        Row(
            "the integral over the arena of the squared distance to the nearest robot, times the density, at the end "
            "(of the last round, when a robot drives at the end)",
            "m^4",
            5,
        ),
    ]
    gain: Annotated[
        float | None,
        Row(
            "by what fraction Lloyd's algorithm, begun at the final positions and followed until it converges, would "
            "lower the cost; `null` while a robot drives",
            digits=5,
        ),
    ]
    rise: Annotated[
        float | None,
        Row(
            "the largest fraction by which the cost rose from the end of one round to the end of the next (negative: "
            "it always fell); a round ends when all robots, having been stationary for `hold_time`, go on; a rest is "
            f"seen up to two samples ({_UNSEEN:g} s) shorter than it is",
            digits=5,
        ),
    ]
    rounds: Annotated[int, Row("how many rounds ended")]


def score_deployment(asked: Deployment, fleet: Sequence[tuple[float, Mapping[str, Body]]], robots: int) -> Deployed:
    """How a deployment went.

    Args:
        asked: what was asked for.
        fleet: scenario time [s] and the robots then, in order.
        robots: how many there are; a moment at which not all are known is skipped.
    """
    known = [(t, bodies) for t, bodies in fleet if len(bodies) == robots]
    rests = [rest for rest in _rests(known) if rest.end - rest.begin >= asked.hold_time - _UNSEEN]
    costs = [coverage_cost(_sites(rest.bodies), asked.floor, asked.density) for rest in rests]
    rise = max((b / a - 1.0 for a, b in itertools.pairwise(costs)), default=0.0 if costs else None)
    if not rests or rests[-1].end < known[-1][0]:  # a robot is driving at the end
        return Deployed(None, costs[-1] if costs else None, None, rise, len(costs))
    sites = _sites(rests[-1].bodies)
    cost = coverage_cost(sites, asked.floor, asked.density)
    ahead = lloyd_step(sites, asked.floor, asked.density)
    distance = max(math.dist(site, centre) for site, centre in zip(sites, ahead, strict=True))
    settled = coverage_cost(_lloyd(sites, asked), asked.floor, asked.density)
    return Deployed(distance, cost, 1.0 - settled / cost, rise, len(costs))


class _Rest(NamedTuple):
    """A stretch of time in which all robots were stationary: from, to [s], and where they were at its end."""

    begin: float
    end: float
    bodies: Mapping[str, Body]


def _rests(fleet: Sequence[tuple[float, Mapping[str, Body]]]) -> list[_Rest]:
    found: list[_Rest] = []
    begin: float | None = None
    for t, bodies in fleet:
        if not all(body.stationary for body in bodies.values()):
            begin = None
        elif begin is None:
            begin = t
            found.append(_Rest(begin, t, bodies))
        else:
            found[-1] = _Rest(begin, t, bodies)
    return found


def _sites(bodies: Mapping[str, Body]) -> tuple[Point, ...]:
    return tuple((body.x, body.y) for body in bodies.values())


def _lloyd(sites: tuple[Point, ...], asked: Deployment) -> tuple[Point, ...]:
    for _ in range(_MAX_STEPS):
        before, sites = sites, lloyd_step(sites, asked.floor, asked.density)
        if max(math.dist(a, b) for a, b in zip(before, sites, strict=True)) < _CONVERGED:
            break
    return sites
