"""How well robots cover a floor, round by round. Pure."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Final, NamedTuple

from muro_zenoh.behaviours.interface import Deployment
from muro_zenoh.planning.coverage import Point, coverage_cost, lloyd_step
from muro_zenoh.scoring.observed import SAMPLE_PERIOD, Body
from muro_zenoh.scoring.rows import Row, Table

_UNSEEN: Final = 2.0 * SAMPLE_PERIOD
"""A stationary period is measured up to two samples too short [s]."""

_CONVERGED: Final = 1e-4
"""Lloyd's algorithm is iterated until no site moves further than this [m]."""

_MAX_STEPS: Final = 2000


class Deployed(NamedTuple):
    """The result of a deployment.

    Attributes:
        distance: the largest distance of a robot from its own cell's centroid at the end [m]; None while one moves.
        cost: the cost of the last round.
        gain: the fraction by which Lloyd's algorithm, iterated from the final positions, would still lower the cost.
        rise: the largest fraction by which the cost rose from the end of one round to the end of the next.
        rounds: number of rounds that ended.
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
            "the fraction by which Lloyd's algorithm, started at the final positions and iterated until it converges, "
            "would lower the cost; `null` while a robot drives",
            digits=5,
        ),
    ]
    rise: Annotated[
        float | None,
        Row(
            "the largest fraction by which the cost rose from the end of one round to the end of the next (negative: "
            "it always fell); a round ends when all robots, stationary for `hold_time`, drive on; a stationary period "
            f"is measured up to two samples ({_UNSEEN:g} s) too short",
            digits=5,
        ),
    ]
    rounds: Annotated[int, Row("number of rounds that ended")]


def score_deployment(expected: Deployment, fleet: Sequence[tuple[float, Mapping[str, Body]]], robots: int) -> Deployed:
    """The result of a deployment.

    Args:
        expected: the task.
        fleet: scenario time [s] and the robots then, in order.
        robots: number of robots; moments at which not all are known are skipped.
    """
    known = [(t, bodies) for t, bodies in fleet if len(bodies) == robots]
    rests = [rest for rest in _rests(known) if rest.end - rest.begin >= expected.hold_time - _UNSEEN]
    costs = [coverage_cost(_sites(rest.bodies), expected.floor, expected.density) for rest in rests]
    rise = max((b / a - 1.0 for a, b in itertools.pairwise(costs)), default=0.0 if costs else None)
    if not rests or rests[-1].end < known[-1][0]:  # a robot is driving at the end
        return Deployed(None, costs[-1] if costs else None, None, rise, len(costs))
    sites = _sites(rests[-1].bodies)
    cost = coverage_cost(sites, expected.floor, expected.density)
    ahead = lloyd_step(sites, expected.floor, expected.density)
    distance = max(math.dist(site, centre) for site, centre in zip(sites, ahead, strict=True))
    settled = coverage_cost(_lloyd(sites, expected), expected.floor, expected.density)
    return Deployed(distance, cost, 1.0 - settled / cost, rise, len(costs))


class _Rest(NamedTuple):
    """A period in which all robots were stationary: begin, end [s], and their positions at its end."""

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


def _lloyd(sites: tuple[Point, ...], expected: Deployment) -> tuple[Point, ...]:
    for _ in range(_MAX_STEPS):
        before, sites = sites, lloyd_step(sites, expected.floor, expected.density)
        if max(math.dist(a, b) for a, b in zip(before, sites, strict=True)) < _CONVERGED:
            break
    return sites
