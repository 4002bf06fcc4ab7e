"""How long one decision of one robot takes: our filter, the classical barrier and ORCA, on the same inputs in turn."""

from __future__ import annotations

import gc
import math
import time
from typing import Any, NamedTuple

import numpy as np

from benchmarks.support.crowd import ARENA, DESIRED, World, pairs
from benchmarks.support.crowd_methods import BarrierCertificates, Orca, Ours
from muro_zenoh.geometry import Bounds, Pose2

ROBOTS = (2, 10, 50)
GOALS_US = {"passes": 100.0, "changed": 300.0}
"""Of ten robots."""


class Times(NamedTuple):
    """Microseconds of a decision: the median where the desired command ``passes``, where it is ``changed``, of both its
    99 % ``p99``; the shares of ``barrier`` and ``orca`` are medians."""

    passes: float
    changed: float
    p99: float
    barrier: float
    orca: float


def floor_for(robots: int) -> Bounds:
    """As much floor for each of them as ten robots have in the default arena."""
    scale = math.sqrt(max(robots, 10) / 10.0)
    return Bounds(scale * ARENA.x_min, scale * ARENA.x_max, scale * ARENA.y_min, scale * ARENA.y_max)


def times_of(robots: int, seconds: float, seed: int = 0) -> Times:
    """Drive robots to random goals with our filter, and time every decision of a few of them.

    Args:
        robots: how many.
        seconds: for how long [s, simulated].
        seed: of places and goals.
    """
    case = pairs(np.random.default_rng(seed), robots, floor_for(robots))
    ours, barrier, orca = Ours(case), BarrierCertificates(case), Orca(case)
    world = World(case, np.random.default_rng(seed), 0.1, 0.0)
    spent: dict[str, list[float]] = {"passes": [], "changed": [], "barrier": [], "orca": []}
    gc.disable()
    try:
        while world.time < seconds:
            commands = []
            for i, (x, y) in enumerate(case.goals.tolist()):
                state, snapshot = world.state(i), world.snapshot(i)
                desired = DESIRED.twist(Pose2(state.x, state.y, state.theta), x, y)
                given = i, world.time, state, desired, snapshot
                began = time.perf_counter()
                command = ours.step(*given)
                ended = time.perf_counter()
                spent["passes" if command == desired else "changed"].append(ended - began)
                if i < 4:
                    for name, method in (("barrier", barrier), ("orca", orca)):
                        began = time.perf_counter()
                        method.step(*given)
                        spent[name].append(time.perf_counter() - began)
                commands.append(command)
            world.step(commands)
    finally:
        gc.enable()
    micro = {name: 1e6 * float(np.median(values)) if values else math.nan for name, values in spent.items()}
    p99 = 1e6 * float(np.quantile(spent["passes"] + spent["changed"], 0.99))
    return Times(micro["passes"], micro["changed"], p99, micro["barrier"], micro["orca"])


def measure(seconds: float = 20.0) -> list[dict[str, Any]]:
    """A row for each number of robots.

    Args:
        seconds: for how long each is driven [s, simulated].
    """
    rows = []
    for robots in ROBOTS:
        times = times_of(robots, seconds if robots <= 10 else 0.25 * seconds)
        row: dict[str, Any] = {"robots": robots}
        row |= {f"{name}_us": round(value, 1) for name, value in times._asdict().items()}
        row["passes_over_barrier"] = round(times.passes / times.barrier, 2)
        row["changed_over_barrier"] = round(times.changed / times.barrier, 2)
        row["changed_over_orca"] = round(times.changed / times.orca, 2)
        rows.append(row)
    return rows
