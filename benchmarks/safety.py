"""How robots get past each other without touching: our separation filter beside ORCA and the classical barrier.

    python benchmarks/safety.py --swap [--seeds N] [--cases ...] [--methods ...] [--json FILE]

Lock-step and without a bus: each robot knows its own state, and sees the others as they were ``--delay`` ms ago in
snapshots of which its link loses the share ``--loss``. Robots of the default settings want to drive at 0.4 m/s; they
have arrived when all are within 10 cm of their goals at once. A contact is one of two bodies; walls count apart. Seeds
give starts, goals and losses.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.support.crowd import CASES, FLOORS, Result, drive_to_goals
from benchmarks.support.crowd_methods import METHODS
from benchmarks.support.rows import quantile, write

DEFAULT = "ours"
SETTINGS = {
    "swap": (("walls", 10), ("open", 10), ("6 x 6", 20)),
    "pairs": (("walls", 10),),
    "doorway": (("walls", 10),),
}
"""The floors of each case, with the number of robots."""


class Trial(NamedTuple):
    """One run: what decides its result."""

    case: str
    floor: str
    robots: int
    method: str
    delay: float
    loss: float
    seed: int


def run(trial: Trial) -> Result:
    """The result of one run."""
    # The layout is the same for all methods, delays and losses.
    case = CASES[trial.case](np.random.default_rng(trial.seed), trial.robots, FLOORS[trial.floor])
    rng = np.random.default_rng((trial.seed, 1))
    return drive_to_goals(case, METHODS[trial.method](case), rng, trial.delay, trial.loss)


def measure(trials: list[list[Trial]], jobs: int) -> Iterator[dict[str, Any]]:
    """A row per list of trials, which differ in their seeds only."""
    with multiprocessing.get_context("spawn").Pool(jobs) if jobs > 1 else _Here() as pool:
        for group in trials:
            results = []
            for result in pool.imap(run, group):
                results.append(result)
                print(f"\r{describe(group[0])}: {len(results)} of {len(group)} ", end="", file=sys.stderr, flush=True)
            print("\r" + " " * 79 + "\r", end="", file=sys.stderr)
            yield row(group, results)


class _Here:
    """A pool without processes."""

    imap = staticmethod(map)

    def __enter__(self) -> _Here:
        return self

    def __exit__(self, *error: object) -> None:
        return None


def describe(trial: Trial) -> str:
    """A trial without its seed."""
    return f"{trial.case} ({trial.floor}), {trial.robots} robots, {trial.method}"


def row(group: list[Trial], results: list[Result]) -> dict[str, Any]:
    """The row of trials that differ in their seeds only."""
    first = group[0]
    seconds = [result.seconds for result in results]
    worst = [trial.seed for trial, result in zip(group, results, strict=True) if not _good(result)]
    return {
        "case": first.case,
        "floor": first.floor,
        "robots": first.robots,
        "method": first.method,
        "default": first.method == DEFAULT,
        "delay_ms": round(1e3 * first.delay),
        "loss": first.loss,
        "seeds": len(results),
        "arrived": sum(math.isfinite(value) for value in seconds),
        "contacts": sum(result.contacts for result in results),
        "at_wall": sum(result.walls for result in results),
        "median_s": quantile(seconds, 0.5),
        "p90_s": quantile(seconds, 0.9),
        "max_s": quantile(seconds, 1.0),
        "min_separation_m": round(min(result.separation for result in results), 4),
        "stood_10s": sum(result.stood for result in results),
        "bad_seeds": worst[:20],
    }


def _good(result: Result) -> bool:
    return math.isfinite(result.seconds) and not result.contacts and not result.walls and not result.stood


HEAD = (
    f"{'case':<9}{'floor':<7}{'robots':>6}  {'method':<9}{'delay':>6}{'loss':>6}{'arrived':>10}{'contacts':>9}"
    f"{'wall':>5}{'median':>8}{'p90':>7}{'max':>7}{'least m':>8}{'stood':>6}"
)


def line(row: dict[str, Any]) -> str:
    """A row as text."""
    times = "".join("  never" if row[key] is None else f"{row[key]:7.1f}" for key in ("median_s", "p90_s", "max_s"))
    return (
        f"{row['case']:<9}{row['floor']:<7}{row['robots']:>6}  {row['method']:<9}{row['delay_ms']:>6}{row['loss']:>6g}"
        f"{row['arrived']:>4} of {row['seeds']:<3}{row['contacts']:>8}{row['at_wall']:>5} {times}"
        f"{row['min_separation_m']:>8.3f}{row['stood_10s']:>6}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--swap", action="store_true", help="crowds that have to get past each other")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    parser.add_argument("--seeds", type=int, default=20, help="how many seeds (default %(default)s)")
    parser.add_argument("--first", type=int, default=0, help="the first seed (default %(default)s)")
    parser.add_argument("--cases", nargs="+", choices=list(SETTINGS), default=list(SETTINGS))
    parser.add_argument("--methods", nargs="+", choices=list(METHODS), default=list(METHODS))
    parser.add_argument("--floors", nargs="+", choices=list(FLOORS), default=list(FLOORS), help="of the swaps")
    parser.add_argument("--robots", type=int, help="how many robots, in every case")
    parser.add_argument("--delay", type=float, default=100.0, help="age of the positions [ms] (default %(default)s)")
    parser.add_argument("--loss", type=float, default=0.0, help="share of the snapshots lost (default %(default)s)")
    parser.add_argument("--jobs", type=int, default=1, help="how many processes (default %(default)s)")
    given = parser.parse_args()
    trials = [
        [
            Trial(case, floor, given.robots or robots, method, 1e-3 * given.delay, given.loss, seed)
            for seed in range(given.first, given.first + given.seeds)
        ]
        for case in given.cases
        for floor, robots in SETTINGS[case]
        if floor in given.floors
        for method in given.methods
    ]
    rows = []
    print(HEAD)
    for measured in measure(trials, given.jobs):
        rows.append(measured)
        print(line(measured), flush=True)
        if measured["default"] and measured["bad_seeds"]:
            print(f"          not clean: seeds {', '.join(map(str, measured['bad_seeds']))}")
        write(given.json, rows)


if __name__ == "__main__":
    main()
