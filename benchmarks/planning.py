"""What a plan costs: Dubins beside OMPL, and Voronoi cells beside shapely alone, alternating in one run.

Every row of cells is the cells of all robots: the library computes them together, a fleet's agents each their own.

    python benchmarks/planning.py [--json FILE]
"""

from __future__ import annotations

import argparse
import math
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from benchmarks.support.rows import write
from muro_zenoh.geometry import Bounds, Pose2
from muro_zenoh.planning.coverage import Point, cell, cells
from muro_zenoh.planning.dubins import all_words, plan, shortest_word

RADIUS = 0.3
PAIRS = 2000
ROUNDS = 15
ARENA = Bounds(-2.1, 2.1, -1.5, 1.5)


def alternate(contenders: dict[str, Callable[[], object]], units: int) -> dict[str, float]:
    """Microseconds a unit of each contender, the median over rounds in which each has its turn."""
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(ROUNDS):
        for name, run in contenders.items():
            start = time.perf_counter()
            run()
            times[name].append((time.perf_counter() - start) / units * 1e6)
    return {name: statistics.median(values) for name, values in times.items()}


def ompl_contender(starts: np.ndarray[Any, Any], goals: np.ndarray[Any, Any]) -> Callable[[], object] | None:
    """OMPL's Dubins length for all pairs, or None where it is not installed."""
    try:
        from ompl import base
    except ImportError:
        return None
    space = base.DubinsStateSpace(RADIUS)

    def state(pose: list[float]) -> Any:
        made = space.allocState()
        made.setX(pose[0])
        made.setY(pose[1])
        made.setYaw(pose[2])
        return made

    pairs = [(state(a), state(b)) for a, b in zip(starts.tolist(), goals.tolist(), strict=True)]
    return lambda: [space.distance(a, b) for a, b in pairs]


def dubins_rows() -> list[dict[str, Any]]:
    """Microseconds a pair, and how many times OMPL's."""
    rng = np.random.default_rng(1)
    starts, goals = rng.uniform([-2.1, -1.5, -math.pi], [2.1, 1.5, math.pi], (2, PAIRS, 3))
    pairs = [(Pose2(*a), Pose2(*b)) for a, b in zip(starts.tolist(), goals.tolist(), strict=True)]
    contenders: dict[str, Callable[[], object]] = {
        "shortest word, scalar": lambda: [shortest_word(a, b, RADIUS) for a, b in pairs],
        "path laid out, scalar": lambda: [plan(a, b, RADIUS) for a, b in pairs],
        "all six words, arrays": lambda: all_words(starts, goals, RADIUS),
    }
    ompl = ompl_contender(starts, goals)
    if ompl is not None:
        contenders = {"OMPL distance": ompl, **contenders}
    microseconds = alternate(contenders, PAIRS)
    reference = microseconds.get("OMPL distance")
    return [
        {"what": "dubins", "how": how, "us": us, "ratio": us / reference if reference else None}
        for how, us in microseconds.items()
    ]


def cell_rows(robots: int) -> list[dict[str, Any]]:
    """Microseconds for the cells of all robots, and how many times shapely's alone."""
    rng = np.random.default_rng(2)
    rings: list[list[Point]] = [
        [(x, y) for x, y in rng.uniform([-2.1, -1.5], [2.1, 1.5], (robots, 2)).tolist()] for _ in range(20)
    ]
    box = shapely.box(*(ARENA.x_min, ARENA.y_min, ARENA.x_max, ARENA.y_max))
    reference = "shapely alone, unclipped"
    microseconds = alternate(
        {
            reference: lambda: [
                shapely.voronoi_polygons(shapely.MultiPoint(sites), extend_to=box, ordered=True) for sites in rings
            ],
            "all cells at once": lambda: [cells(sites, ARENA) for sites in rings],
            "each agent its own cell": lambda: [[cell(k, sites, ARENA) for k in range(robots)] for sites in rings],
        },
        len(rings),
    )
    return [
        {"what": f"cells of {robots}", "how": how, "us": us, "ratio": us / microseconds[reference]}
        for how, us in microseconds.items()
    ]


def main() -> None:
    """Print the table; write it as JSON when asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows as JSON")
    arguments = parser.parse_args()
    rows = [*dubins_rows(), *cell_rows(10), *cell_rows(100)]
    print(f"{'what':<14}{'how':<38}{'us':>10}{'ratio':>8}")
    for row in rows:
        ratio = "" if row["ratio"] is None else f"{row['ratio']:.2f}"
        print(f"{row['what']:<14}{row['how']:<38}{row['us']:>10.2f}{ratio:>8}")
    write(arguments.json, rows)


if __name__ == "__main__":
    main()
