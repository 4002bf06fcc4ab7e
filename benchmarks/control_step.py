"""What the whole step of a robot's control loop takes, in the agents of a real fleet.

    python benchmarks/control_step.py [--cases pursuit swap doorway] [--robots 10] [--seconds 30] [--json FILE]
    chrt --fifo 1 python benchmarks/control_step.py --cases swap    on a busy machine: nobody else runs within a step
    python benchmarks/control_step.py --alone      one agent has a core to itself, as on a robot's own laptop

Every case is the real thing: a router, a simulator, a base station, one agent per robot and `muro run`, each a process,
cameras at 20 Hz. ``pursuit``: the built-in scenario on a circle of 1.1 m. ``swap``: robots on a circle change places
with those opposite, again and again. ``doorway``: the built-in scenario, with its six robots. The agents are timed from
within (benchmarks/support/timed_agent.py), and nothing else of them is changed.

A step goes from the loop's resuming the control task for a fix until the task waits for the next one: decode the fix,
the odometry and the snapshot of all robots, estimate, behaviour, separation filter, encode, hand to Zenoh. Steps in
which a robot is held are left out; those in which the filter lets it stand are not. ``changed``: in how many of them
the filter changed the command [%]. ``cpu``: processor time of the thread that runs the loop. ``wall``: on the clock, so
it includes the times at which Zenoh's threads or other processes run instead. ``fix``: from the arrival of the fix in
Zenoh's thread until the command was handed over, so it includes the wait for the loop; the fixes of all robots come at
once, and wait for each other where there are fewer cores. All in milliseconds. With ``--alone`` all else runs on the
other cores, and only the steps of that one agent count.

The second table has the parts of a step, in percent of its processor time, over all steps and over the slowest 1 %.
``fix, odometry``: decoding these, and asyncio. ``snapshot``: decoding the positions of all robots. ``law``: the
behaviour, and the messages of the step. Timing the parts costs less than two runs differ by.

The exit code is 1 when the p99 of the processor time is not below the goal of 1 ms.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from benchmarks.support.crowd import swap
from benchmarks.support.rows import write
from muro_zenoh.config import Checks, Scenario, find_scenario
from muro_zenoh.config.sections import ARENA
from muro_zenoh.config.writing import as_toml
from muro_zenoh.supervision.launch import connected_to
from tests.support.process import Process
from tests.support.router import router

TIMED_AGENT = Path(__file__).parent / "support" / "timed_agent.py"
CASES = ("pursuit", "swap", "doorway")
GOAL = 1.0
"""Of the p99 of a step's processor time [ms]."""
SEED = 1
_ROUNDS = 20
"""How often robots that swap may do so."""


def scenario_of(case: str, robots: int) -> Scenario:
    """The scenario of a case, without checks: it is not the driving that is judged.

    Args:
        case: of :data:`CASES`.
        robots: how many; a doorway has its own number.
    """
    if case == "pursuit":
        scenario = find_scenario("pursuit", robots, {"circle.radius": 1.1})
    elif case == "doorway":
        scenario = find_scenario("doorway")
    else:
        scenario = find_scenario("steer", robots, {"behaviour.pause": 0.0})
        crowd = swap(np.random.default_rng(SEED), robots, ARENA)
        there = dict(zip(scenario.robots, crowd.goals.tolist(), strict=True))
        back = {name: [-x, -y] for name, (x, y) in there.items()}
        scenario = msgspec.structs.replace(
            scenario,
            starts={name: tuple(row) for name, row in zip(scenario.robots, crowd.starts.tolist(), strict=True)},
            goals={name: (tuple(there[name]), tuple(back[name])) * _ROUNDS for name in scenario.robots},
        )
    return msgspec.structs.replace(scenario, checks=Checks())


def measure(case: str, robots: int, seconds: float, folder: Path, alone: bool) -> list[dict[str, Any]]:
    """Run a fleet, and return the steps of its agents.

    Args:
        case: of :data:`CASES`.
        robots: how many.
        seconds: for how long, once all processes are ready [s].
        folder: where the run may write.
        alone: whether the first one has a core to itself, and counts alone.

    Raises:
        RuntimeError: the run broke off.
    """
    cores = os.sched_getaffinity(0)
    own = {max(cores)} if alone else cores
    try:
        return _measure(case, robots, seconds, folder, own, cores - own or cores)
    finally:
        os.sched_setaffinity(0, cores)


def _measure(
    case: str, robots: int, seconds: float, folder: Path, own: set[int], others: set[int]
) -> list[dict[str, Any]]:
    scenario = scenario_of(case, robots)
    file = folder / f"{case}.toml"
    notes = {name: folder / f"{case}-{name}.json" for name in scenario.robots}
    os.sched_setaffinity(0, others)
    with router() as there:
        file.write_text(as_toml(connected_to(scenario, there.endpoint)))
        with ExitStack() as agents:
            for name, noted in notes.items():
                os.sched_setaffinity(0, own if name == scenario.robots[0] else others)  # a child inherits it
                timed = Process([str(TIMED_AGENT), str(file), name, str(noted)], name=name)
                agents.enter_context(timed).ready()
            os.sched_setaffinity(0, others)
            command = [sys.executable, "-P", "-m", "muro_zenoh", "run", str(file), "--connect", there.endpoint]
            command += ["--duration", str(seconds), "--seed", str(SEED), "--headless", "--no-web"]
            run = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if run.returncode != 0:
        raise RuntimeError(f"{' '.join(command)}: exit code {run.returncode}\n{run.stdout}\n{run.stderr}")
    counted = list(notes.values()) if own == others else [notes[scenario.robots[0]]]
    steps = [step for noted in counted for step in json.loads(noted.read_text()) if step["drives"]]
    if not steps:
        raise RuntimeError(f"{case}: no robot drove in {seconds:g} s\n{run.stdout}")
    return steps


def row_of(case: str, robots: int, steps: list[dict[str, Any]], load: float) -> dict[str, Any]:
    """The row of a case.

    Args:
        case: which.
        robots: how many robots it had.
        steps: of all agents.
        load: of the machine before (mean of a minute).
    """
    row: dict[str, Any] = {"case": case, "robots": robots, "steps": len(steps), "compiled": steps[0]["compiled"]}
    row["changed_percent"] = round(100.0 * sum(step["changed"] for step in steps) / len(steps), 1)
    for key in ("cpu", "wall", "latency"):
        times = 1e3 * np.array([step[key] for step in steps])
        for name, q in (("p50", 0.5), ("p99", 0.99), ("max", 1.0)):
            row[f"{key}_{name}_ms"] = round(float(np.quantile(times, q)), 3)
    row["load"] = round(load, 1)
    slowest = sorted(steps, key=lambda step: float(step["cpu"]))[-max(1, len(steps) // 100) :]
    return row | {"parts_percent": shares(steps), "parts_of_slowest_percent": shares(slowest)}


def shares(steps: list[dict[str, Any]]) -> dict[str, float]:
    """The parts of steps, in percent of their processor time.

    Args:
        steps: at least one.
    """
    whole = sum(step["cpu"] for step in steps)
    return {part: round(100.0 * sum(step["parts"][part] for step in steps) / whole, 1) for part in steps[0]["parts"]}


COLUMNS = (
    ("case", "case", "s"),
    ("robots", "robots", "d"),
    ("steps", "steps", "d"),
    ("changed", "changed_percent", ".1f"),
    *(
        (f"{title} {name}", f"{key}_{name}_ms", ".3f")
        for title, key in (("cpu", "cpu"), ("wall", "wall"), ("fix", "latency"))
        for name in ("p50", "p99", "max")
    ),
    ("load", "load", ".1f"),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", nargs="+", choices=CASES, default=CASES, help="which (all)")
    parser.add_argument("--robots", type=int, default=10, help="how many; a doorway has six (10)")
    parser.add_argument("--alone", action="store_true", help="one agent has a core to itself, and counts alone")
    parser.add_argument("--seconds", type=float, default=30.0, help="how long each runs, once ready (30)")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    given = parser.parse_args()
    if given.alone and len(os.sched_getaffinity(0)) < 2:
        parser.error("--alone: got one core, expected at least two")
    rows = []
    print("".join(f"{title:>10}" for title, _, _ in COLUMNS), flush=True)
    with tempfile.TemporaryDirectory(prefix="muro-control-step-") as folder:
        for case in given.cases:
            load = os.getloadavg()[0]
            steps = measure(case, given.robots, given.seconds, Path(folder), given.alone)
            row = row_of(case, len(scenario_of(case, given.robots).robots), steps, load)
            rows.append(row | {"alone": given.alone})
            print("".join(f"{rows[-1][key]:>10{form}}" for _, key, form in COLUMNS), flush=True)
    parts = rows[0]["parts_percent"]
    if parts:
        print("\n" + "".join(f"{title:>14}" for title in ("% of cpu", "steps", *parts)))
    for row in rows if parts else ():
        for which, key in (("all", "parts_percent"), ("slowest 1 %", "parts_of_slowest_percent")):
            print(f"{row['case']:>14}{which:>14}" + "".join(f"{row[key][part]:>14.1f}" for part in parts))
    write(given.json, rows)
    sys.exit(any(row["cpu_p99_ms"] >= GOAL for row in rows))


if __name__ == "__main__":
    main()
