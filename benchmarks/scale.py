"""What a fleet costs, by its size: `muro run pursuit` with ever more robots on one machine.

    python benchmarks/scale.py [--robots 5 10 20 30 40] [--seconds 30] [--json scale.json]

Every run is the real thing: a router, a simulator, a base station, one agent per robot and `muro run` itself, each a
process. One camera of 1920 x 1080 pixels looks at 6 m x 6 m; the robots spread round a circle of 2.6 m. Numbers are
from the run's score sheet, and count from the moment that all processes are ready.

Rows: processor time in percent of one core, of the agents (mean and greatest of one agent), of every other process,
and of all together; accepted fixes per second, mean and least of the robots (on their way to the circle, robots that
start in each other's way hide each other's tags: bodies pass through each other in the simulation); age of the pose
behind a command; resident memory of all agents together, and of all processes (pages that processes share count in
each of them), and what the agents really take of the machine (each has its share of the pages that it shares).
``times`` is what the fleet costs for a robot, compared with the smallest fleet: 1 is growth in proportion to the
number of robots.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import psutil

SCENARIO = """\
description = "One camera over 6 m x 6 m, and as many robots as are asked for."
robots = 5

[all]
tag_x = -0.03
tag_y = 0.02
tag_yaw = 0.2

[arena]
x_min = -3.0
x_max = 3.0
y_min = -3.0
y_max = 3.0

[camera.north]
width = 1920
height = 1080
jpeg_quality = 0

[circle]
radius = 2.6

[behaviour]
name = "pursuit"
cruise = 0.2
"""

OTHERS = ("router", "simulator", "basestation", "muro")
SEED = 1


@dataclass(frozen=True)
class Row:
    """What one size of fleet cost.

    Attributes:
        robots: how many.
        agent_cpu_percent: of one core, mean of the agents.
        agent_cpu_percent_max: of one core, the agent that used most.
        router_cpu_percent: of one core.
        simulator_cpu_percent: of one core.
        basestation_cpu_percent: of one core.
        muro_cpu_percent: of one core, `muro run` itself: the supervisor and the score's collector.
        total_cpu_percent: of one core, all processes.
        fix_rate_hz: accepted fixes per second, mean of the robots.
        fix_rate_least_hz: the same, of the robot that has the fewest.
        pose_age_p50_ms: age of the pose behind a command.
        pose_age_p99_ms: the same.
        rss_mb: resident memory of all agents together.
        pss_mb: their memory with a page that k processes share counted as 1 / k in each, near the run's end.
        total_rss_mb: resident memory of all processes together.
    """

    robots: int
    agent_cpu_percent: float
    agent_cpu_percent_max: float
    router_cpu_percent: float
    simulator_cpu_percent: float
    basestation_cpu_percent: float
    muro_cpu_percent: float
    total_cpu_percent: float
    fix_rate_hz: float
    fix_rate_least_hz: float
    pose_age_p50_ms: float
    pose_age_p99_ms: float
    rss_mb: float
    pss_mb: float
    total_rss_mb: float


def measure(robots: int, seconds: float, folder: Path) -> Row:
    """Run a fleet to its end.

    Args:
        robots: how many.
        seconds: for how long, once all processes are ready [s].
        folder: where the run may write.

    Raises:
        RuntimeError: the run gave no score sheet, or broke off.
    """
    scenario, report = folder / "scale.toml", folder / f"{robots}.json"
    scenario.write_text(SCENARIO)
    command = [sys.executable, "-P", "-m", "muro_zenoh", "run", str(scenario), "--robots", str(robots)]
    command += ["--duration", str(seconds), "--seed", str(SEED), "--headless", "--no-web", "--report", str(report)]
    run = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    said, pss = "", 0.0
    try:
        said, _ = run.communicate(timeout=seconds)  # the start takes some seconds more, so the robots still drive
    except subprocess.TimeoutExpired:
        pss = agents_pss(run.pid)
        said, _ = run.communicate()
    if run.returncode != 0 or not report.exists():
        raise RuntimeError(f"{' '.join(command)}: exit code {run.returncode}\n{said}")
    return row_of(json.loads(report.read_text()), pss)


def agents_pss(pid: int) -> float:
    """Memory of all agents of a run, a shared page counted in parts [MB].

    Args:
        pid: of `muro run`.
    """
    agents = [child for child in psutil.Process(pid).children() if "agent" in child.cmdline()]
    return float(sum(agent.memory_full_info().pss for agent in agents)) / 1e6


def row_of(sheet: dict[str, Any], pss_mb: float) -> Row:
    """The row of a run.

    Args:
        sheet: its score sheet.
        pss_mb: of all agents together.

    Raises:
        RuntimeError: the sheet lacks a number, as where there is no ``/proc``.
    """
    processes = sheet["processes"]
    rates = list(sheet["fix_rate_hz"].values())
    ages = sheet["pose_age_ms"]
    uses = [use[key] for use in processes.values() for key in ("cpu_percent", "rss_mb")]
    if None in [*uses, *rates, *ages.values()]:
        raise RuntimeError(f"numbers are missing in the score sheet of {sheet['robots']} robots: {processes}, {rates}")
    agents = [use for name, use in processes.items() if name not in OTHERS]
    cpu = [use["cpu_percent"] for use in agents]
    return Row(
        robots=sheet["robots"],
        agent_cpu_percent=round(sum(cpu) / len(cpu), 2),
        agent_cpu_percent_max=max(cpu),
        **{f"{name}_cpu_percent": processes[name]["cpu_percent"] for name in OTHERS},
        total_cpu_percent=round(sum(use["cpu_percent"] for use in processes.values()), 1),
        fix_rate_hz=round(sum(rates) / len(rates), 2),
        fix_rate_least_hz=round(min(rates), 2),
        pose_age_p50_ms=round(ages["p50"], 1),
        pose_age_p99_ms=round(ages["p99"], 1),
        rss_mb=round(sum(use["rss_mb"] for use in agents), 1),
        pss_mb=round(pss_mb, 1),
        total_rss_mb=round(sum(use["rss_mb"] for use in processes.values()), 1),
    )


COLUMNS = (
    ("robots", "robots", "d"),
    ("agent", "agent_cpu_percent", ".1f"),
    ("max", "agent_cpu_percent_max", ".1f"),
    ("router", "router_cpu_percent", ".1f"),
    ("sim", "simulator_cpu_percent", ".1f"),
    ("station", "basestation_cpu_percent", ".1f"),
    ("muro", "muro_cpu_percent", ".1f"),
    ("total", "total_cpu_percent", ".1f"),
    ("fixes Hz", "fix_rate_hz", ".1f"),
    ("least", "fix_rate_least_hz", ".1f"),
    ("age p50", "pose_age_p50_ms", ".0f"),
    ("p99 ms", "pose_age_p99_ms", ".0f"),
    ("agents MB", "rss_mb", ".0f"),
    ("PSS MB", "pss_mb", ".0f"),
    ("all MB", "total_rss_mb", ".0f"),
)


def head() -> str:
    """The table's first line."""
    return "".join(f"{title:>10}" for title, _, _ in COLUMNS) + f"{'times':>10}"


def line(row: Row, smallest: Row) -> str:
    """A row of the table, and what the fleet costs for a robot in times of the smallest fleet.

    Args:
        row: of this fleet.
        smallest: of the smallest fleet.
    """
    numbers = "".join(f"{getattr(row, key):>10{form}}" for _, key, form in COLUMNS)
    return numbers + f"{growth(row, smallest):>10.2f}"


def growth(row: Row, before: Row) -> float:
    """How much more a robot costs than in another fleet: total processor time for each robot, as a ratio.

    Args:
        row: of this fleet.
        before: of the other, smaller one.
    """
    return (row.total_cpu_percent / row.robots) / (before.total_cpu_percent / before.robots)


def machine() -> dict[str, Any]:
    """What the numbers were measured on."""
    model = platform.processor() or platform.machine()
    facts = Path("/proc/cpuinfo")
    if facts.exists():
        model = next(
            (text.partition(":")[2].strip() for text in facts.read_text().splitlines() if "model name" in text), model
        )
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {"cores": cores, "processor": model, "python": platform.python_version(), "system": platform.system()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, nargs="+", default=[5, 10, 20, 30, 40], help="sizes of the fleet")
    parser.add_argument("--seconds", type=float, default=30.0, help="how long each runs, once ready (30)")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    given = parser.parse_args()
    rows: list[Row] = []
    print(head(), flush=True)
    with tempfile.TemporaryDirectory(prefix="muro-scale-") as folder:
        for robots in sorted(set(given.robots)):
            rows.append(measure(robots, given.seconds, Path(folder)))
            print(line(rows[-1], rows[0]), flush=True)
    for before, row in pairwise(rows):
        print(
            f"from {before.robots} to {row.robots} robots: {row.robots / before.robots:.2f} times the robots, "
            f"{row.total_cpu_percent / before.total_cpu_percent:.2f} times the processor time, "
            f"{row.total_rss_mb / before.total_rss_mb:.2f} times the memory"
        )
    facts = machine()
    print(", ".join(f"{key} {value}" for key, value in facts.items()) + f", {given.seconds:g} s each, seed {SEED}")
    if given.json:
        found = {"machine": facts, "seconds": given.seconds, "rows": [asdict(row) for row in rows]}
        given.json.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
