"""How long wheels go on turning when a process dies, freezes or is cut off in a real `muro run`, and when they resume.

    python benchmarks/stopping.py [--repeats 10] [--json FILE]

Each case is a ``[[fault]]`` of one scenario: a process of each role is killed (SIGKILL), frozen (SIGSTOP), or its link
is partitioned by the relay, which notifies nobody. The time runs from the fault to the moment at which the simulator
commands the wheels to stop, on one clock; of several robots the last one counts. ``resumed`` runs from the kill, or
from the end of the freeze or partition, until all of them are commanded to turn again; nobody helps. A case in which a
robot did not turn before the fault, did not stop, turned while the fault lasted, or did not resume is an error.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

ROBOTS = ("r1", "r2", "r3")
ROLES = ("agent", "basestation", "router", "camera")
KINDS = ("crash", "freeze", "partition")
LIMITS = {"agent": 0.45, "router": 0.45, "basestation": 0.6, "camera": 0.6}
"""Until the wheels are commanded to stop, after the last good information [s]."""

FIRST, APART, LASTS = 8.0, 6.0, 1.5
"""When the first fault is, the time from one to the next, and how long a freeze or partition lasts [s]."""

_RESTART = 0.5
"""A killed process is not started again before [s]."""

_SCENARIO = """\
description = "What happens to the wheels"
robots = 3
duration = {duration}

[camera.north]
jpeg_quality = 0

[behaviour]
name = "circle"
"""


class StationaryError(RuntimeError):
    """A robot did not drive when it was to be stopped: no fault of what stops it, but nothing to measure, either."""


class Case(NamedTuple):
    """A process, by its role, and what befalls it."""

    role: str
    kind: str


class Turn(NamedTuple):
    """When [s since 1970] a robot's wheels were commanded to turn, or to stop."""

    t: float
    turn: bool


class Time(NamedTuple):
    """How long after its beginning a fault stopped the wheels, and how long after its end they turned again [s]."""

    stopped: float
    resumed: float


@dataclass(frozen=True)
class Row:
    """A case over all repeats; times in seconds."""

    role: str
    fault: str
    repeats: int
    limit_s: float
    stopped_p50_s: float
    stopped_max_s: float
    resumed_p50_s: float
    resumed_max_s: float


ALL = tuple(Case(role, kind) for kind, role in product(KINDS, ROLES))
"""In an order in which no process dies often enough for its supervisor to hesitate."""


def scenario(cases: Sequence[Case]) -> str:
    """A scenario whose faults are these cases, one after the other.

    Args:
        cases: the cases, in order.
    """
    text = _SCENARIO.format(duration=FIRST + APART * len(cases))
    for number, case in enumerate(cases):
        text += (
            f'\n[[fault]]\nkind = "{case.kind}"\ntarget = "{_target(number, case)}"\nat = {FIRST + APART * number}\n'
        )
        if case.kind != "crash":
            text += f"duration = {LASTS}\n"
    return text


def measure(cases: Sequence[Case], folder: Path) -> list[Time]:
    """Run a fleet to which all of these happen.

    Args:
        cases: the cases, in order.
        folder: where the run may write.

    Returns:
        The times of each.

    Raises:
        StationaryError: a robot did not drive at the beginning of a case.
        RuntimeError: the run broke off, or a case went wrong; with the reason.
    """
    file, report = folder / "stopping.toml", folder / "report.json"
    file.write_text(scenario(cases))
    command = [
        sys.executable,
        "-P",
        "-m",
        "muro_zenoh",
        "run",
        str(file),
        "--headless",
        "--no-web",
        "--report",
        str(report),
    ]
    run = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, env={**os.environ, "MURO_LOG": "debug"}, check=False
    )
    if not report.exists():
        raise RuntimeError(f"{' '.join(command)}: exit code {run.returncode}\n{run.stdout}{run.stderr}")
    faults = json.loads(report.read_text())["faults"]
    (log,) = folder.glob("runs/*/simulator.log")
    turns = turns_in(log.read_text())
    log.rename(folder / "simulator.log")
    return [_time(number, case, fault, turns) for number, (case, fault) in enumerate(zip(cases, faults, strict=True))]


def turns_in(log: str) -> dict[str, list[Turn]]:
    """What the wheels were commanded, by robot.

    Args:
        log: of the simulator, with its debug lines.
    """
    turns: dict[str, list[Turn]] = {name: [] for name in ROBOTS}
    for name, what, t in re.findall(r"DEBUG (\w+): wheels commanded to (turn|stop) at ([\d.]+)", log):
        turns[name].append(Turn(float(t), what == "turn"))
    return turns


def _target(number: int, case: Case) -> str:
    return f"{ROBOTS[number % len(ROBOTS)]}/agent" if case.role == "agent" else case.role


def _time(number: int, case: Case, fault: Mapping[str, Any], turns: Mapping[str, Sequence[Turn]]) -> Time:
    begin = fault["stamp"]
    if begin is None or fault["note"]:
        raise RuntimeError(f"fault {number}, {case.kind} of {fault['target']}: it had no effect: {fault['note']}")
    lasts = LASTS if case.kind != "crash" else _RESTART
    robots = [_target(number, case).partition("/")[0]] if case.role == "agent" else ROBOTS
    times = []
    for name in robots:
        what = f"fault {number}, {case.kind} of {fault['target']}: {name}"
        before = [turn for turn in turns[name] if turn.t < begin]
        after = [turn for turn in turns[name] if begin <= turn.t < begin + APART]
        if not before or not before[-1].turn:
            raise StationaryError(f"{what} was stationary before it, expected it to drive")
        if not after:
            raise RuntimeError(f"{what} did not stop")
        if any(turn.turn for turn in after if turn.t < begin + lasts):
            raise RuntimeError(f"{what} drove while it lasted: {after}")
        again = next((turn.t for turn in after if turn.turn), None)
        if again is None:
            raise RuntimeError(f"{what} did not resume within {APART:g} s")
        times.append(Time(after[0].t - begin, again - begin - (lasts if case.kind != "crash" else 0.0)))
    return Time(max(t.stopped for t in times), max(t.resumed for t in times))


def rows_of(cases: Iterable[Case], times: Mapping[Case, Sequence[Time]]) -> list[Row]:
    """One row for each case.

    Args:
        cases: the cases, in order.
        times: the times of each repeat.
    """
    return [
        Row(
            case.role,
            case.kind,
            len(times[case]),
            LIMITS[case.role],
            round(statistics.median(t.stopped for t in times[case]), 3),
            round(max(t.stopped for t in times[case]), 3),
            round(statistics.median(t.resumed for t in times[case]), 2),
            round(max(t.resumed for t in times[case]), 2),
        )
        for case in cases
    ]


def table(rows: Iterable[Row]) -> str:
    """The rows as Markdown, as in docs/safety.md.

    Args:
        rows: the rows.
    """
    lines = [
        "| role | fault | wheels at zero p50 [s] | max | limit | turn again p50 [s] | max |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row.role} | {row.fault} | {row.stopped_p50_s:.3f} | {row.stopped_max_s:.3f} | {row.limit_s:g} "
        f"| {row.resumed_p50_s:.2f} | {row.resumed_max_s:.2f} |"
        for row in rows
    ]
    return "\n".join(lines)


def main() -> int:
    """Measure, and print the table; 1 when a limit is not met."""
    parser = argparse.ArgumentParser(description="Measure how soon wheels stop when a process dies, freezes or is cut.")
    parser.add_argument("--repeats", type=int, default=10, metavar="N", help="of each case [10]")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows to this file")
    arguments = parser.parse_args()
    times: dict[Case, list[Time]] = {case: [] for case in ALL}
    for repeat in range(1, arguments.repeats + 1):
        with tempfile.TemporaryDirectory() as folder:
            for case, time in zip(ALL, measure(ALL, Path(folder)), strict=True):
                times[case].append(time)
        print(f"{repeat} of {arguments.repeats}", file=sys.stderr)
    rows = sorted(rows_of(ALL, times), key=lambda row: (ROLES.index(row.role), KINDS.index(row.fault)))
    print(table(rows))
    if arguments.json is not None:
        arguments.json.write_text(
            json.dumps({"machine": platform.platform(), "cores": os.cpu_count(), "rows": [asdict(r) for r in rows]})
        )
    return 0 if all(row.stopped_max_s <= row.limit_s for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
