"""The games of the attack on the separation certificate: random ones, and a search for the worst."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import basinhopping, differential_evolution

from benchmarks.support.attack import (
    CAMERA_AGE,
    IDEAS,
    KEPT,
    NEVER,
    PERIOD,
    TICK,
    TICKS,
    Game,
    Player,
    play,
)
from benchmarks.support.crowd import ROBOT, SNAPSHOT_LIMIT
from benchmarks.support.jobs import run_jobs
from muro_zenoh.safety.separation import SeparationSettings


def random_game(rng: np.random.Generator, robots: int, settings: SeparationSettings) -> Game:
    """Robots near each other, at rest and free of each other, and a world that does its worst.

    Args:
        rng: the luck.
        robots: how many.
        settings: of the filter.
    """
    keep = 2.0 * ROBOT.radius + settings.margin
    size = rng.uniform(0.7, 1.6) * math.sqrt(robots / 2.0)
    while True:
        places = rng.uniform(-0.5 * size, 0.5 * size, (robots, 2))
        gaps = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))[np.triu_indices(robots, k=1)]
        if gaps.min() > keep:
            break
    every = int(rng.integers(2, 6)) if rng.random() < 0.2 else 1  # no two receive the same ones
    players = []
    for turn, (x, y) in enumerate(places.tolist()):
        heading = rng.uniform(-math.pi, math.pi)
        if rng.random() < 0.5:  # towards the middle
            heading = math.atan2(-y, -x) + rng.normal(0.0, 0.4)
        cut = int(rng.integers(0, TICKS)) if rng.random() < 0.4 else NEVER
        freezes = int(rng.integers(0, TICKS)) if rng.random() < 0.3 else NEVER
        delay, holds, waits = int(rng.integers(4, 25)), int(rng.integers(0, 29)), int(rng.integers(0, 120))
        if rng.random() < 0.3:  # it makes the most of what it saw last: waits, and goes blind as late as possible
            cut = int(rng.integers(10, 120))
            freezes, holds = cut + round((SNAPSHOT_LIMIT + CAMERA_AGE) / TICK) - int(rng.integers(0, 12)), 28
            waits = freezes - int(rng.integers(1, 40))
        players.append(
            Player(
                x,
                y,
                heading,
                delay=delay,
                loss=float(rng.choice((0.0, 0.0, 0.2, 0.5, 0.8))),
                cut=cut,
                mended=cut + int(rng.integers(4, 240)),
                phase=int(rng.integers(0, PERIOD)),
                freezes=freezes,
                wakes=freezes + int(rng.integers(4, 160)),
                holds=holds,
                waits=waits if rng.random() < 0.5 else 0,
                idea=int(rng.choice(len(IDEAS), p=(0.35, 0.25, 0.15, 0.1, 0.15))),
                seed=int(rng.integers(0, 2**31)),
                scale=float(rng.choice((1.0, rng.uniform(0.8, 1.2)))),
                every=every,
                turn=turn % every,
            )
        )
    return players


_BOUNDS = (
    (0.05, 1.2),  # free floor between the bodies' margins at the start [m]
    (-math.pi, math.pi),  # heading of the first, from the direction to the second
    (-math.pi, math.pi),  # heading of the second, likewise
    (4, 25),  # delay of the first's snapshots
    (4, 25),  # of the second's
    (0, 120),  # when the first's link is cut
    (0, 60),  # it freezes so much later
    (0, 29),  # its wheels go on for so long
    (0, 60),  # it sets off so long before it freezes
    (0, 120),  # the second waits until
    (0, 3),  # idea of the first
    (0, 3),  # of the second
    (0.8, 1.2),  # what the first's wheels do of the nominal
    (0.8, 1.2),  # what the second's do
)
"""What the search varies: two robots, one of which goes blind."""


def game_of(numbers: Sequence[float], settings: SeparationSettings) -> Game:
    """The game of a point of the search.

    Args:
        numbers: one within each of the bounds.
        settings: of the filter.
    """
    free, first, second, *rest, scale, other_scale = (float(number) for number in numbers)
    delay, other_delay, cut, later, holds, before, other_waits, idea, other_idea = (int(value) for value in rest)
    apart = 2.0 * ROBOT.radius + settings.margin + 1e-3 + free
    freezes = cut + later
    blind = Player(0.0, 0.0, first, delay, cut=cut, freezes=freezes, wakes=NEVER, holds=holds, waits=freezes - before)
    other = Player(apart, 0.0, math.pi + second, other_delay, waits=other_waits)
    return blind._replace(idea=idea, scale=scale), other._replace(idea=other_idea, scale=other_scale)


def _first(clearances: Callable[[np.ndarray], np.ndarray], seed: int, population: int) -> np.ndarray:
    """The best of many random points."""
    low, high = np.array(_BOUNDS).T
    points = np.random.default_rng(seed).uniform(low, high, (10 * population, len(_BOUNDS)))
    return points[np.argsort(clearances(points.T))[:population]]


class Found(NamedTuple):
    """What a search found: the least ``clearance`` [m], the ``game`` and how many games it ``played``."""

    clearance: float
    game: Game
    played: int


def search(
    settings: SeparationSettings, seed: int, generations: int = 40, hops: int = 0, population: int = 60
) -> Found:
    """Search the game of two robots for the least clearance.

    Differential evolution over all of it, then, from the best game, basin hopping.

    Args:
        settings: of the filter.
        seed: of the search.
        generations: of differential evolution.
        hops: of basin hopping.
        population: of differential evolution; it begins with the best of ten times as many random games.
    """
    played = 0

    def clearances(points: np.ndarray) -> np.ndarray:
        nonlocal played
        games = [game_of(point, settings) for point in np.atleast_2d(points.T)]
        played += len(games)
        return np.array([outcome.clearance for outcome in play(games, settings)])

    evolved = differential_evolution(
        clearances,
        _BOUNDS,
        rng=seed,
        init=_first(clearances, seed, population),
        maxiter=generations,
        polish=False,
        vectorized=True,
        updating="deferred",
        tol=0.0,
    )
    best, value = evolved.x, float(evolved.fun)
    if hops:
        low, high = np.array(_BOUNDS).T
        hopped = basinhopping(
            lambda point: float(clearances(np.clip(point, low, high - 1e-9))[0]),
            best,
            niter=hops,
            stepsize=1.0,
            minimizer_kwargs={"method": "Nelder-Mead", "options": {"maxfev": 30}},
            rng=seed,
        )
        if hopped.fun < value:
            best, value = np.clip(hopped.x, low, high - 1e-9), float(hopped.fun)
    return Found(value, game_of(best, settings), played)


class Siege(NamedTuple):
    """A batch of the attack: random games of so many ``robots``, or, with 0, one search; its ``seed``."""

    robots: int
    seed: int
    games: int = 50


def besiege(siege: Siege) -> list[tuple[float, Game]]:
    """Play one batch: the clearance of each game, with the game; of a search, of the best one."""
    settings = SeparationSettings()
    if not siege.robots:
        found = search(settings, siege.seed, generations=30, hops=4)
        return [(found.clearance, found.game)] * found.played
    rng = np.random.default_rng((siege.seed, siege.robots))
    games = [random_game(rng, siege.robots, settings) for _ in range(siege.games)]
    return [(outcome.clearance, game) for outcome, game in zip(play(games, settings), games, strict=True)]


SHARES = {2: 0.5, 3: 0.3, 4: 0.2}
"""The share of the states in random games of so many robots."""
HEAD = f"{'attack':<18}{'games':>8}{'states':>10}{'contacts':>10}{f'< {KEPT:g} m':>10}{'least m':>9}"


def attack(states: int, searches: int, processes: int) -> Iterator[dict[str, Any]]:
    """The rows of the attack: random games by number of robots, then the searches.

    Args:
        states: in which a robot of a random game decides, in all.
        searches: how many.
        processes: how many.
    """
    for robots, share in SHARES.items():
        batches = math.ceil(share * states / (_decisions(robots) * Siege(robots, 0).games))
        sieges = [Siege(robots, seed) for seed in range(batches)]
        yield _row(f"random, {robots} robots", robots, run_jobs(besiege, sieges, processes, f"{robots} robots"))
    if searches:
        sieges = [Siege(0, seed) for seed in range(searches)]
        yield _row("search, 2 robots", 2, run_jobs(besiege, sieges, processes, "searches"))


def _decisions(robots: int) -> int:
    """States in which a certificate decides, in one game."""
    return robots * TICKS // PERIOD


def _row(name: str, robots: int, batches: Sequence[list[tuple[float, Game]]]) -> dict[str, Any]:
    played = [one for batch in batches for one in batch]
    least, game = min(played, key=lambda one: one[0])
    return {
        "attack": name,
        "games": len(played),
        "states": len(played) * _decisions(robots),
        "contacts": sum(clearance < 0.0 for clearance, _ in played),
        "below_kept": sum(clearance < KEPT for clearance, _ in played),
        "least_clearance_m": round(least, 4),
        "worst": [player._asdict() for player in game],
    }


def line(row: dict[str, Any]) -> str:
    """A row as text."""
    return (
        f"{row['attack']:<18}{row['games']:>8}{row['states']:>10}{row['contacts']:>10}{row['below_kept']:>10}"
        f"{row['least_clearance_m']:>9.4f}"
    )
