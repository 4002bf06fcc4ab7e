"""How long a pose takes to become a command, and what that costs: our bus and our agents beside bare Zenoh.

One process per robot, a router between, and a room that sends each of them what it hears in a run: a pose 20 times a
second, odometry 25 times, a snapshot of all robots 20 times. The robots drive round a ring without a pause. Topologies
take turns of some seconds, again and again; in each turn its processes are started, measured and ended, so that nothing
else of ours is alive, and what the machine does besides hits all alike::

    python benchmarks/latency.py [--robots 1,10,30] [--seconds 20] [--json FILE]

Rows: milliseconds from the tick to the last robot's command (p50, p99), ticks at which a robot's command was late (not
there before the next tick), processor time of the router and the robots' processes together in percent of one core,
their resident memory and threads. Bare processes receive all of it and answer the poses with their own bytes; agents
run ``pursuit``. The ratios compare with bare Zenoh; the rest is the machine's.

Then the time from spawning a process to its first command and to the first that drives, bare and agent in turns, and
until all processes of ``make demo`` are ready.
"""

from __future__ import annotations

import math
import re
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from benchmarks.support.fleet_under_test import AGENTS, BARE, TOPOLOGIES, Topology, running
from benchmarks.support.rows import write
from muro_zenoh.supervision.launch import muro_command
from tests.support.router import router

TURN = 5.0
WARM_UP = 1.0


@dataclass
class Measured:
    """What one topology did in its turns."""

    latencies: list[float] = field(default_factory=list)
    ticks: int = 0
    cpu_seconds: float = 0.0
    seconds: float = 0.0
    rss: float = 0.0
    threads: int = 0


@dataclass(frozen=True)
class Row:
    """One line of the table; ``ticks`` at which every robot was sent a pose, ``late`` those not answered in time."""

    robots: int
    topology: str
    p50_ms: float
    p99_ms: float
    ticks: int
    late: int
    cpu_percent: float
    rss_mb: float
    threads: int
    p50_ratio: float
    cpu_ratio: float


def compare(robots: int, seconds: float, folder: Path) -> list[Row]:
    """All topologies, in turns.

    Args:
        robots: how many each has.
        seconds: how long each is measured [s].
        folder: for files that only count meanwhile.
    """
    names = [f"r{i + 1}" for i in range(robots)]
    measured = {topology.name: Measured() for topology in TOPOLOGIES}
    for _ in range(max(1, round(seconds / TURN))):
        for topology in TOPOLOGIES:
            take_turn(topology, names, folder, measured[topology.name])
    ground = measured[BARE.name]
    return [_row(robots, name, each, ground) for name, each in measured.items()]


def take_turn(topology: Topology, names: Sequence[str], folder: Path, into: Measured) -> None:
    """Start a topology, measure it while it drives, and end it.

    Args:
        topology: which.
        names: of the robots.
        folder: for files that only count meanwhile.
        into: gets what was measured.
    """
    with running(topology, names, folder) as fleet:
        fleet.first_commands()
        time.sleep(WARM_UP)
        before, begin = fleet.use(), time.perf_counter()
        time.sleep(TURN)
        after, end = fleet.use(), time.perf_counter()
        rows = fleet.room.answers(begin, end)
        idle = fleet.idle(begin, end)
    if idle:
        raise click.ClickException(f"{topology.name}: {idle} commands did not drive; nothing is measured of such a run")
    into.ticks += len(rows)
    into.latencies += [max(times) for row in rows if len(times := [t for t in row if t is not None]) == len(names)]
    into.cpu_seconds += after.cpu - before.cpu
    into.seconds += end - begin
    into.rss, into.threads = after.rss, after.threads


def _row(robots: int, name: str, m: Measured, ground: Measured) -> Row:
    return Row(
        robots=robots,
        topology=name,
        p50_ms=round(1e3 * quantile(m.latencies, 0.5), 3),
        p99_ms=round(1e3 * quantile(m.latencies, 0.99), 3),
        ticks=m.ticks,
        late=m.ticks - len(m.latencies),
        cpu_percent=round(100.0 * m.cpu_seconds / m.seconds, 2),
        rss_mb=round(m.rss, 1),
        threads=m.threads,
        p50_ratio=round(quantile(m.latencies, 0.5) / quantile(ground.latencies, 0.5), 3),
        cpu_ratio=round((m.cpu_seconds / m.seconds) / (ground.cpu_seconds / ground.seconds), 3),
    )


def quantile(values: Sequence[float], q: float) -> float:
    """The q-quantile of values; NaN of none."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(q * len(ordered)))] if ordered else math.nan


@dataclass(frozen=True)
class StartUp:
    """How long something takes to be up: median and worst of some times [s]."""

    what: str
    median_s: float
    worst_s: float
    times: int


def start_ups(times: int, folder: Path) -> list[StartUp]:
    """From spawning a process to its commands, bare and agent in turns; and until ``make demo`` is ready.

    Args:
        times: how often each is measured.
        folder: for files that only count meanwhile.
    """
    took: dict[str, list[float]] = {}
    with router() as routed:
        for _ in range(times):
            for topology in (BARE, AGENTS):
                with running(topology, ["r1"], folder, routed) as fleet:
                    first, driving = fleet.first_commands()
                took.setdefault(f"{topology.name}: spawn to the first command", []).append(first - fleet.spawned)
                if topology is AGENTS:
                    took.setdefault(f"{topology.name}: to the first that drives", []).append(driving - fleet.spawned)
    for _ in range(times):
        demo = (*muro_command("run", "pursuit", "--duration", "1", "--headless"),)
        said = subprocess.run(demo, stdout=subprocess.PIPE, text=True, check=False, cwd=folder).stdout
        found = re.search(r"all processes ready after ([0-9.]+) s", said)
        took.setdefault("make demo: all processes ready", []).append(float(found.group(1)) if found else math.nan)
    return [StartUp(name, round(quantile(each, 0.5), 4), round(max(each), 4), times) for name, each in took.items()]


def table(rows: Sequence[Row]) -> Table:
    """The rows for people."""
    out = Table("robots", "topology", "p50 ms", "p99 ms", "late", "CPU %", "RSS MB", "threads", "p50 x", "CPU x")
    for r in rows:
        out.add_row(
            str(r.robots),
            r.topology,
            f"{r.p50_ms:.2f}",
            f"{r.p99_ms:.2f}",
            f"{r.late}/{r.ticks}",
            f"{r.cpu_percent:.1f}",
            f"{r.rss_mb:.0f}",
            str(r.threads),
            f"{r.p50_ratio:.2f}",
            f"{r.cpu_ratio:.2f}",
        )
    return out


@click.command(help=(__doc__ or "").splitlines()[0])
@click.option("--robots", default="1,10,30", show_default=True, help="Sizes, comma-separated.")
@click.option("--seconds", default=20.0, show_default=True, help="How long each topology is measured at each size.")
@click.option("--starts", default=5, show_default=True, help="How often each start-up is measured; 0 for not at all.")
@click.option("--json", "file", type=click.Path(path_type=Path), help="Write the rows to this file too.")
def main(robots: str, seconds: float, starts: int, file: Path | None) -> None:
    rows: list[Row] = []
    console = Console(width=120)
    with tempfile.TemporaryDirectory(prefix="muro-latency-") as name:
        folder = Path(name)
        for size in filter(None, robots.split(",")):
            rows += compare(int(size), seconds, folder)
            console.print(table(rows[-len(TOPOLOGIES) :]))
        ups = start_ups(starts, folder) if starts else []
    if ups:
        out = Table("start-up", "median s", "worst s")
        for up in ups:
            out.add_row(up.what, f"{up.median_s:.3f}", f"{up.worst_s:.3f}")
        console.print(out)
    write(file, [*map(asdict, rows), *map(asdict, ups)])


if __name__ == "__main__":
    main()
