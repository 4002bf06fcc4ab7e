"""How fast the circle laws settle, beside the shortest Dubins path: lock-step, clean and noisy.

500 starts from a fixed seed in 4.2 x 3 m, circle of 0.6 m, 0.15 m/s, at most 1 rad/s, 3 cm band. A law settles when it
enters the band for good. Two ratios: over the time at which the shortest Dubins path to any tangent enters the band for
good itself, which is like for like; and over the time of that path to its end, where it touches the circle. Starts that
are in the band within 1 s by that path are left out and counted.

    python benchmarks/convergence.py [--json FILE]
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.support.rows import cell, quantile, write
from muro_zenoh.control.circle import CIRCLE_LAWS, VectorFieldGains, circle_law
from muro_zenoh.geometry import Circle
from muro_zenoh.simulation.rollout.runs import CircleRun, follow_circle, settling_time
from muro_zenoh.simulation.rollout.settings import CLEAN, NOISY
from muro_zenoh.simulation.rollout.yardstick import shortest_tangent_path

WIDTH, HEIGHT = 4.2, 3.0
CIRCLE = Circle(WIDTH / 2, HEIGHT / 2, 0.6)
V, OMEGA_MAX, BAND = 0.15, 1.0, 0.03
GOALS = {"clean": (1.03, 1.07), "noisy": (1.06, 1.15)}
"""Of the default law, like for like: median and 90th percentile."""


def draw_starts(n: int, seed: int = 1) -> np.ndarray:
    """Poses anywhere in the arena (n, 3)."""
    rng = np.random.default_rng(seed)
    return rng.uniform((0.0, 0.0, -math.pi), (WIDTH, HEIGHT, math.pi), (n, 3))


def measure(n: int, seconds: float, laws: Iterable[str] = CIRCLE_LAWS) -> list[dict[str, Any]]:
    """The rows of all laws in both loops; that of the default law in the noisy one says when the scales were found."""
    starts = draw_starts(n)
    reference = shortest_tangent_path(starts, CIRCLE, V, OMEGA_MAX, BAND)
    counted = reference.enters >= 1.0
    rows: list[dict[str, Any]] = []
    for law in laws:
        for loop, settings in (("clean", CLEAN), ("noisy", NOISY)):
            rng = np.random.default_rng(2)
            run = follow_circle(starts, CIRCLE, circle_law(law), V, settings, rng, seconds)
            settled = settling_time(run.time, abs(run.radius_error) > BAND)
            to_band = settled[counted] / reference.enters[counted]
            to_end = settled[counted] / reference.full[counted]
            rows.append(
                {
                    "law": law,
                    "default": law == VectorFieldGains.NAME,
                    "loop": loop,
                    "median": quantile(to_band, 0.5),
                    "p90": quantile(to_band, 0.9),
                    "median_full": quantile(to_end, 0.5),
                    "p90_full": quantile(to_end, 0.9),
                    "unsettled": int(np.isinf(settled[counted]).sum()),
                    "starts": int(counted.sum()),
                    "left_out": int((~counted).sum()),
                }
            )
            if law == VectorFieldGains.NAME and loop == "noisy":
                rows[-1] |= calibrate(run)
    return rows


def calibrate(run: CircleRun) -> dict[str, Any]:
    """When the drive scales are within 5 % for good: s_v after the start, s_omega after so long of turning [s]."""
    period = np.arange(1, len(run.turned) + 1) * NOISY.period
    found_v = settling_time(period, abs(run.scale_error_v) > 0.05)
    found_omega = settling_time(period, abs(run.scale_error_omega) > 0.05)
    index = np.minimum(np.searchsorted(period, found_omega), len(period) - 1)
    turning = np.where(np.isinf(found_omega), np.inf, run.turned[index, np.arange(len(index))])
    return {
        name: {
            "median": quantile(t, 0.5),
            "p99": quantile(t, 0.99),
            "max": quantile(t, 1.0),
        }
        for name, t in (("s_v_found_s", found_v), ("s_omega_found_s_of_turning", turning))
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    parser.add_argument("--starts", type=int, default=500, help="how many starts (default %(default)s)")
    parser.add_argument("--seconds", type=float, default=90.0, help="length of a run (default %(default)s)")
    arguments = parser.parse_args()
    rows = measure(arguments.starts, arguments.seconds)
    print(f"{rows[0]['starts']} starts, {rows[0]['left_out']} left out; settling time over the Dubins path's,")
    print("like for like (both to the band for good), and over that path to its end")
    print(
        f"{'law':<16}{'loop':<8}{'median':>8}{'p90':>8}{'to end':>10}{'p90':>8}{'unsettled':>11}   goal, like for like"
    )
    for row in rows:
        goal = "<= {:.2f}, {:.2f}".format(*GOALS[row["loop"]]) if row["default"] else ""
        print(
            f"{row['law']:<16}{row['loop']:<8}{cell(row['median'])}{cell(row['p90'])}"
            f"{'':2}{cell(row['median_full'])}{cell(row['p90_full'])}{row['unsettled']:>11}   {goal}"
        )
    for name, value in next(row for row in rows if row["default"] and row["loop"] == "noisy").items():
        if isinstance(value, dict):
            print(f"{name}: median {value['median']}, p99 {value['p99']}, max {value['max']}")
    write(arguments.json, rows)


if __name__ == "__main__":
    main()
