"""How fast the lock-step rollout is: robot-steps per second, on one core.

A robot-step is one move of one robot's plant, with all that the loop does meanwhile. Without the filter a period is one
move: law, limits, wheels, slip. With it a period is two (to the picture, and on to the next fix), and has the fix, the
EKF with both drive scales, the look ahead, law, calibration and limits besides; ``periods_per_s`` counts those.

    python benchmarks/rollout.py [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from muro_zenoh.control.circle import circle_law
from muro_zenoh.control.pursuit import pursuit_law, pursuit_speed
from muro_zenoh.control.ring_arrays import array_gaps
from muro_zenoh.geometry import Circle, State
from muro_zenoh.simulation.rollout.fleet import Fleet, Policy
from muro_zenoh.simulation.rollout.settings import NOISY

CIRCLE = Circle(0.0, 0.0, 1.1)
GOALS = {False: 5e6, True: 2e6}
Array = np.ndarray


def following(n: int) -> Policy:
    """Circular path following, each robot alone."""
    law, speed = circle_law(), np.full(n, 0.2)
    return lambda t, ahead: (speed, law(ahead.x, ahead.y, ahead.theta, ahead.v, CIRCLE))


def pursuing(trials: int, robots: int) -> Policy:
    """Cyclic pursuit within each trial, and circular path following."""
    law, circle = pursuit_law(), circle_law()

    def policy(t: float, ahead: State) -> tuple[Array, Array]:
        angle = np.arctan2(ahead.y - CIRCLE.y, ahead.x - CIRCLE.x).reshape(trials, robots)
        gap, behind, count = array_gaps(angle, CIRCLE.clockwise)
        speed = pursuit_speed(law, gap, behind, count, angle, CIRCLE.radius, CIRCLE.clockwise)
        return speed.ravel(), circle(ahead.x, ahead.y, ahead.theta, ahead.v, CIRCLE)

    return policy


CASES: dict[str, tuple[int, Callable[[], Policy]]] = {
    "1,000 robots, circle": (1_000, lambda: following(1_000)),
    "1,000 trials of ten, circle": (10_000, lambda: following(10_000)),
    "1,000 trials of ten, pursuit": (10_000, lambda: pursuing(1_000, 10)),
}


def measure(repeats: int) -> list[dict[str, Any]]:
    """A row per case, without and with the filter: the best of ``repeats`` stretches, by wall clock and by CPU time."""
    rows = []
    for case, (n, make) in CASES.items():
        for estimated in (False, True):
            rng = np.random.default_rng(1)
            starts = rng.uniform((-2.0, -1.5, -math.pi), (2.0, 1.5, math.pi), (n, 3))
            fleet = Fleet(starts, replace(NOISY, estimated=estimated), rng)
            policy = make()
            moves = 2 if estimated else 1
            periods = max(5, 100_000 // n)
            best_wall, best_cpu = math.inf, math.inf
            for _ in range(repeats):
                wall, cpu = time.perf_counter(), time.process_time()
                for _ in range(periods):
                    fleet.step(policy)
                best_wall = min(best_wall, time.perf_counter() - wall)
                best_cpu = min(best_cpu, time.process_time() - cpu)
            rows.append(
                {
                    "case": case,
                    "robots": n,
                    "ekf": estimated,
                    "robot_steps_per_s": round(moves * periods * n / best_wall),
                    "robot_steps_per_cpu_s": round(moves * periods * n / best_cpu),
                    "periods_per_s": round(periods * n / best_wall),
                    "goal": GOALS[estimated],
                }
            )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    parser.add_argument("--repeats", type=int, default=20, help="stretches per case (default %(default)s)")
    arguments = parser.parse_args()
    rows = measure(arguments.repeats)
    print(f"{'case':<30}{'EKF':>5}{'Mstep/s':>10}{'per CPU s':>11}{'Mperiod/s':>11}{'goal':>6}")
    for row in rows:
        speeds = [row[key] / 1e6 for key in ("robot_steps_per_s", "robot_steps_per_cpu_s", "periods_per_s")]
        print(
            f"{row['case']:<30}{'yes' if row['ekf'] else 'no':>5}"
            f"{speeds[0]:>10.2f}{speeds[1]:>11.2f}{speeds[2]:>11.2f}{row['goal'] / 1e6:>6.0f}"
        )
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    main()
