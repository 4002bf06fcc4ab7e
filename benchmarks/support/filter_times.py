"""What one decision of one robot costs: our filter, the classical barrier and ORCA, on the same inputs in turn.

Processor time, so that a busy machine counts for little.
"""

from __future__ import annotations

import gc
import math
import time
from typing import Any, NamedTuple

import numpy as np

from benchmarks.support.crowd import ARENA, DESIRED, World, pairs, swap
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
    """Drive robots to random goals with our filter (two: past each other), and time their decisions.

    Args:
        robots: how many.
        seconds: for how long [s, simulated].
        seed: of places and goals.
    """
    layout = swap if robots == 2 else pairs  # of two, so that they meet
    case = layout(np.random.default_rng(seed), robots, floor_for(robots))
    ours, barrier, orca = Ours(case), BarrierCertificates(case), Orca(case)
    world = World(case, np.random.default_rng(seed), 0.1, 0.0)
    world.stand(ours)
    spent: dict[str, list[float]] = {"passes": [], "changed": [], "barrier": [], "orca": []}
    gc.disable()
    try:
        while world.time < seconds:
            commands = []
            for i, (x, y) in enumerate(case.goals.tolist()):
                state, snapshot = world.state(i), world.snapshot(i)
                desired = DESIRED.twist(Pose2(state.x, state.y, state.theta), x, y)
                given = i, world.time, state, desired, snapshot
                began = time.process_time()
                command = ours.step(*given)
                ended = time.process_time()
                spent["passes" if command == desired else "changed"].append(ended - began)
                if i < 4:
                    for name, method in (("barrier", barrier), ("orca", orca)):
                        began = time.process_time()
                        method.step(*given)
                        spent[name].append(time.process_time() - began)
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
