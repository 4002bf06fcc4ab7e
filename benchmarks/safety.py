"""How robots get past each other without touching: our separation filter beside ORCA and the classical barrier.

    python benchmarks/safety.py [--json FILE]                                    what a decision costs
    python benchmarks/safety.py --swap [--seeds N] [--cases ...] [--methods ...]  whether and when they arrive
    python benchmarks/safety.py --attack [--states N]                            robots that do their worst

Lock-step and without a bus: each robot knows its own state, and sees the others as they were ``--delay`` ms ago in
snapshots of which its link loses the share ``--loss``. Before they set off, robots have heard snapshots for a second,
as agents do that hold. Robots of the default settings want to drive at 0.4 m/s; they have arrived when all are within
10 cm of their goals at once. A contact is one of two bodies; walls count apart. Seeds give starts, goals and losses.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.support import attack_games, filter_times
from benchmarks.support.crowd import CASES, FLOORS, Result, drive_to_goals
from benchmarks.support.crowd_methods import METHODS
from benchmarks.support.crowd_pursuit import pursue, pursuit
from benchmarks.support.jobs import run_jobs
from benchmarks.support.rows import quantile, write

DEFAULT = "ours"
SETTINGS: dict[str, tuple[tuple[str, int], ...]] = {
    "swap": (("walls", 10), ("open", 10), ("6 x 6", 20)),
    "pairs": (("walls", 10),),
    "doorway": (("walls", 10),),
    "pursuit": (("walls", 10),),
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
    layout = pursuit if trial.case == "pursuit" else CASES[trial.case]
    case = layout(np.random.default_rng(trial.seed), trial.robots, FLOORS[trial.floor])
    drive = pursue if trial.case == "pursuit" else drive_to_goals
    rng = np.random.default_rng((trial.seed, 1))
    return drive(case, METHODS[trial.method](case), rng, trial.delay, trial.loss)


def describe(trial: Trial) -> str:
    """A trial without its seed."""
    return f"{trial.case} ({trial.floor}), {trial.robots} robots, {trial.method}"


def row_of(group: list[Trial], results: list[Result]) -> dict[str, Any]:
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
    parser.add_argument("--attack", action="store_true", help="robots that obey the certificate, and do their worst")
    parser.add_argument("--states", type=int, default=1_000_000, help="of the attack (default %(default)s)")
    parser.add_argument("--searches", type=int, default=8, help="of the attack (default %(default)s)")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    parser.add_argument("--seeds", type=int, default=20, help="how many seeds (default %(default)s)")
    parser.add_argument("--first", type=int, default=0, help="the first seed (default %(default)s)")
    parser.add_argument("--cases", nargs="+", choices=list(SETTINGS), default=list(SETTINGS), help="(default all)")
    parser.add_argument("--methods", nargs="+", choices=list(METHODS), default=list(METHODS), help="(default all)")
    parser.add_argument("--floors", nargs="+", choices=list(FLOORS), default=list(FLOORS), help="of the swaps")
    parser.add_argument("--robots", type=int, help="how many robots, in every case")
    parser.add_argument("--delay", type=float, default=100.0, help="age of the positions [ms] (default %(default)s)")
    parser.add_argument("--loss", type=float, default=0.0, help="share of the snapshots lost (default %(default)s)")
    parser.add_argument("--jobs", type=int, default=1, help="how many processes (default %(default)s)")
    given = parser.parse_args()
    if min(given.states, given.seeds, given.jobs) < 1:
        parser.error("--states, --seeds and --jobs must be at least 1")
    if given.attack:
        rows = []
        print(attack_games.HEAD)
        for row in attack_games.attack(given.states, given.searches, given.jobs):
            rows.append(row)
            print(attack_games.line(row), flush=True)
        write(given.json, rows)
    elif given.swap:
        swap(given)
    else:
        costs = filter_times.measure()
        print_costs(costs)
        write(given.json, costs)


def print_costs(rows: list[dict[str, Any]]) -> None:
    """A table of what a decision costs."""
    print("median microseconds of one robot's decision, same inputs; p99 of ours; ours over the barrier")
    print(
        f"{'robots':>6}{'passes':>9}{'changed':>9}{'p99':>9}{'barrier':>9}{'orca':>9}{'passes/b.':>11}{'changed/b.':>11}"
    )
    for row in rows:
        print(
            f"{row['robots']:>6}{row['passes_us']:>9.0f}{row['changed_us']:>9.0f}{row['p99_us']:>9.0f}"
            f"{row['barrier_us']:>9.0f}{row['orca_us']:>9.0f}"
            f"{row['passes_over_barrier']:>11.2f}{row['changed_over_barrier']:>11.2f}"
        )
    passes, changed = filter_times.GOALS_US["passes"], filter_times.GOALS_US["changed"]
    print(f"goals for ten robots: {passes:g} us when the desired command passes, {changed:g} us when it does not")


def swap(given: argparse.Namespace) -> None:
    """The crowds."""
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
    for group in trials:
        measured = row_of(group, run_jobs(run, group, given.jobs, describe(group[0])))
        rows.append(measured)
        print(line(measured), flush=True)
        if measured["default"] and measured["bad_seeds"]:
            print(f"          not clean: seeds {', '.join(map(str, measured['bad_seeds']))}")
        write(given.json, rows)


if __name__ == "__main__":
    main()
