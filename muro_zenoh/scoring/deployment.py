"""What a deployment was worth, and how well a ring kept to an importance. Pure; see ``docs/scoresheet.md``."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from muro_zenoh.control.importance import Importance
from muro_zenoh.geometry import TWO_PI, Bounds, Circle
from muro_zenoh.planning.coverage import Density, Point, coverage_cost, lloyd_step
from muro_zenoh.scoring.goals import Body

BINS: Final = 36
"""Parts of the circle in which the time that robots spend there is compared with what is asked for."""

_SEEN_LATE = 0.2
"""A rest is seen up to two samples shorter than it is [s]."""

_CONVERGED = 1e-4
"""Lloyd's algorithm is followed until no site moves further than this [m]."""

_MOST_STEPS = 2000


class Deployment(NamedTuple):
    """What robots that cover a floor were asked for.

    Attributes:
        floor: what they cover.
        density: how much each place matters; None for all alike.
        hold_time: so long all have stood when a round ends [s].
    """

    floor: Bounds
    density: Density | None
    hold_time: float


class Deployed(NamedTuple):
    """How a deployment went.

    Attributes:
        distance: the largest way from a robot to its own cell's centroid, at rest at the end [m]; None while one moves.
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


def score_deployment(asked: Deployment, fleet: Sequence[tuple[float, Mapping[str, Body]]], robots: int) -> Deployed:
    """How a deployment went.

    Args:
        asked: what was asked for.
        fleet: scenario time [s] and the robots then, in order.
        robots: how many there are; a moment that does not know them all is passed over.
    """
    known = [(t, bodies) for t, bodies in fleet if len(bodies) == robots]
    rests = [rest for rest in _rests(known) if rest.end - rest.begin >= asked.hold_time - _SEEN_LATE]
    costs = [coverage_cost(_sites(rest.bodies), asked.floor, asked.density) for rest in rests]
    rise = max((b / a - 1.0 for a, b in itertools.pairwise(costs)), default=0.0 if costs else None)
    if not rests or rests[-1].end < known[-1][0]:  # at the end somebody drives
        return Deployed(None, costs[-1] if costs else None, None, rise, len(costs))
    sites = _sites(rests[-1].bodies)
    cost = coverage_cost(sites, asked.floor, asked.density)
    ahead = lloyd_step(sites, asked.floor, asked.density)
    distance = max(math.dist(site, centre) for site, centre in zip(sites, ahead, strict=True))
    settled = coverage_cost(_lloyd(sites, asked), asked.floor, asked.density)
    return Deployed(distance, cost, 1.0 - settled / cost, rise, len(costs))


class _Rest(NamedTuple):
    """A stretch of time in which all robots stood: from, to [s], and where at its end."""

    begin: float
    end: float
    bodies: Mapping[str, Body]


def _rests(fleet: Sequence[tuple[float, Mapping[str, Body]]]) -> list[_Rest]:
    found: list[_Rest] = []
    begin: float | None = None
    for t, bodies in fleet:
        if not all(body.stands for body in bodies.values()):
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
    for _ in range(_MOST_STEPS):
        before, sites = sites, lloyd_step(sites, asked.floor, asked.density)
        if max(math.dist(a, b) for a, b in zip(before, sites, strict=True)) < _CONVERGED:
            break
    return sites


def density_error(places: Sequence[tuple[float, float]], circle: Circle, importance: Importance) -> float | None:
    """How far the time spent round a circle is from what was asked for: total variation distance [-], 0 to 1.

    Half the sum over :data:`BINS` equal parts of \\|share of the places there - share of the importance there\\|.

    Args:
        places: x, y [m, world] of all robots, evenly in time; None comes of none.
        circle: round whose centre.
        importance: what was asked for.
    """
    if not places:
        return None
    counts = [0] * BINS
    for x, y in places:
        angle = math.atan2(y - circle.y, x - circle.x) % TWO_PI
        counts[int(angle / TWO_PI * BINS) % BINS] += 1
    edges = [importance.mass(TWO_PI * k / BINS) for k in range(BINS + 1)]
    return 0.5 * sum(
        abs(count / len(places) - (high - low) / TWO_PI)
        for count, (low, high) in zip(counts, itertools.pairwise(edges), strict=True)
    )
