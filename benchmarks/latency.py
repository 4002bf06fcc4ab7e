"""How long a pose takes to become a command, and what that costs: our bus and our agents beside bare Zenoh.

One process per robot, a router between, and a driver that sends each of them a pose at 30 Hz and waits for the
commands. All topologies of a size run at once, each behind a router of its own, and take turns every few seconds, so
that what else the machine does hits them alike::

    python benchmarks/latency.py --seconds 20 --json latency.json

Rows: milliseconds from the tick to the last robot's command (p50, p99), commands lost, processor time of all processes
together (router and driver too) in percent of one core, resident memory, threads. The agents are real ones that run
``circle`` on poses of a robot that drives round it; they get no odometry, as the others do not.

Then how long it takes from spawning a process to its first command, bare and agent in turns, and until all processes of
``make demo`` are ready.
"""

from __future__ import annotations

import contextlib
import json
import math
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import click
import psutil
import zenoh
import zenoh.ext
from rich.console import Console
from rich.table import Table

from muro_zenoh import channels
from muro_zenoh.channels import key_of
from muro_zenoh.config import BusSettings
from muro_zenoh.geometry import Circle, wrap_to_pi
from muro_zenoh.messages import Behaviour, Message, PoseFix, StopOrder, encode, encoding_of
from muro_zenoh.messages import Circle as CircleMessage
from muro_zenoh.runtime.clock import SystemClock
from muro_zenoh.transport.zenoh_link import zenoh_config

HERE = Path(__file__).parent
RATE = 30.0
TURN = 2.0
COVARIANCE = (1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 1e-5)

CIRCLE = Circle(0.0, 0.0, 0.8)
SPEED = 0.2

Spawn = Callable[[str, Sequence[str]], list["Child"]]
"""Starts a topology's processes for the robots named, as clients of an endpoint; returns when all are ready."""


# ---- topologies: one function each


def echoes(kind: str) -> Spawn:
    """One echo process per robot; ``kind`` as in :mod:`echo`."""

    def spawn(endpoint: str, names: Sequence[str]) -> list[Child]:
        return start([[str(HERE / "echo.py"), kind, endpoint, name] for name in names])

    return spawn


def agents(endpoint: str, names: Sequence[str]) -> list[Child]:
    """A real agent per robot."""
    with tempfile.NamedTemporaryFile("w", suffix=".toml", delete=False) as file:
        file.write(f'robots = {len(names)}\n[camera.north]\nlatency = 0.0\n[bus]\nconnect = ["{endpoint}"]\n')
    try:
        return start([["-m", "muro_zenoh", "agent", file.name, name] for name in names])
    finally:
        Path(file.name).unlink()


TOPOLOGIES: dict[str, Spawn] = {
    "bare, in the callback": echoes("callback"),
    "bare, through a loop": echoes("loop"),
    "our bus": echoes("bus"),
    "agents on a circle": agents,
}
GROUND = "bare, in the callback"
"""What the others are compared with: callback in, put out, nothing between."""


# ---- measuring


@dataclass
class Measured:
    """What one topology did in its turns."""

    latencies: list[float] = field(default_factory=list)
    sent: int = 0
    answered: int = 0
    cpu_seconds: float = 0.0
    seconds: float = 0.0
    rss: int = 0
    threads: int = 0


class Driver:
    """The room: sends every robot a pose each tick and takes the commands. Bare Zenoh, the same for every topology."""

    def __init__(self, endpoint: str, names: Sequence[str]) -> None:
        settings = BusSettings(connect=(endpoint,))
        self._session = zenoh.open(zenoh_config(settings))
        self._clock = SystemClock()
        self._arrived: list[tuple[float, str, bytes]] = []
        self._names = names
        self._poses = [
            self._session.declare_publisher(
                key_of(settings.realm, channels.POSE, name),
                encoding=encoding_of(PoseFix),
                priority=zenoh.Priority.INTERACTIVE_HIGH,
                congestion_control=zenoh.CongestionControl.DROP,
                express=False,
            )
            for name in names
        ]
        self._commands = self._session.declare_subscriber(
            key_of(settings.realm, channels.CMD_VEL, "*"), zenoh.handlers.Callback(self._file, indirect=False)
        )
        # What the base station keeps: agents stand still without it. Nobody else listens.
        self._kept = [self._keep(settings, channels.STOP, "", StopOrder(stamp=1.0, all=False, revision=1))]
        x, y, radius, clockwise = CIRCLE
        self._kept.append(
            self._keep(
                settings, channels.CIRCLE, "", CircleMessage(stamp=1.0, x=x, y=y, radius=radius, clockwise=clockwise)
            )
        )
        behaviour = Behaviour(stamp=1.0, behaviour="circle", parameters={"speed": SPEED})
        self._kept += [self._keep(settings, channels.BEHAVIOUR, name, behaviour) for name in names]
        self._tick = 0

    def _keep(self, settings: BusSettings, channel: channels.Channel[Any], name: str, message: Message) -> Any:
        publisher = zenoh.ext.declare_advanced_publisher(
            self._session,
            key_of(settings.realm, channel, name),
            cache=zenoh.ext.CacheConfig(max_samples=1),
            publisher_detection=True,
        )
        publisher.put(encode(message))
        return publisher

    def first_command(self, timeout: float) -> float:
        """Send poses until a command comes; when that was [s, perf_counter]."""
        self._arrived.clear()
        began = time.perf_counter()
        while not self._arrived and time.perf_counter() < began + timeout:
            self._tick += 1
            for i, pose in enumerate(self._poses):
                pose.put(self._payload(i))
            time.sleep(0.005)
        return self._arrived[0][0] if self._arrived else math.nan

    def _file(self, sample: zenoh.Sample) -> None:
        self._arrived.append((time.perf_counter(), str(sample.key_expr), sample.payload.to_bytes()))

    def turn(self, seconds: float, into: Measured | None) -> None:
        """Send poses for a while; what came back is added to ``into``."""
        ticks: dict[int, float] = {}
        self._arrived.clear()
        began = time.perf_counter()
        for k in range(int(seconds * RATE)):
            time.sleep(max(0.0, began + k / RATE - time.perf_counter()))
            self._tick += 1
            ticks[self._tick] = time.perf_counter()
            for i, pose in enumerate(self._poses):
                pose.put(self._payload(i))
        time.sleep(1.0 / RATE + 0.2)
        if into is not None:
            self._count(ticks, into)

    def _payload(self, robot: int) -> bytes:
        """The pose of a robot that drives round the circle."""
        angle = self._tick / RATE * SPEED / CIRCLE.radius + robot
        return encode(
            PoseFix(
                stamp=self._clock.now(),
                seq=self._tick,
                epoch=1,
                age=0.0,
                x=CIRCLE.x + CIRCLE.radius * math.cos(angle),
                y=CIRCLE.y + CIRCLE.radius * math.sin(angle),
                theta=wrap_to_pi(angle + 0.5 * math.pi),
                covariance=COVARIANCE,
                camera="north",
            )
        )

    def _count(self, ticks: dict[int, float], into: Measured) -> None:
        """A tick is answered by a robot's first command after it, if that comes before the next tick but one."""
        times = sorted(ticks.values())
        heard: dict[str, list[float]] = {}
        for at, key, _ in self._arrived:
            heard.setdefault(key, []).append(at)
        last = [0.0] * len(times)
        answers = [0] * len(times)
        for arrivals in heard.values():
            waiting = deque(range(len(times)))
            for at in arrivals:
                while waiting and at > times[waiting[0]] + 2.0 / RATE:
                    waiting.popleft()
                if waiting and at >= times[waiting[0]]:
                    tick = waiting.popleft()
                    answers[tick] += 1
                    last[tick] = max(last[tick], at)
        into.sent += len(times) * len(self._names)
        into.answered += sum(answers)
        # A tick that lost a command has no last one; it is told in the losses.
        into.latencies += [
            at - tick for at, tick, count in zip(last, times, answers, strict=True) if count == len(self._names)
        ]

    def close(self) -> None:
        self._session.close()


class Running:
    """A topology that runs: its router, its robots' processes and its driver."""

    def __init__(self, stack: contextlib.ExitStack, spawn: Spawn, names: Sequence[str]) -> None:
        self.endpoint = endpoint = f"tcp/127.0.0.1:{free_port()}"
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        settings = folder / "router.toml"
        settings.write_text(f'[bus]\nlisten = ["{endpoint}"]\n')
        self.router = start([["-m", "muro_zenoh", "router", str(settings)]])
        stack.callback(stop, self.router)
        self.robots = spawn(endpoint, names)
        stack.callback(stop, self.robots)
        self.driver = Driver(endpoint, names)
        stack.callback(self.driver.close)
        self.measured = Measured()

    def turn(self, seconds: float) -> None:
        """Take a turn."""
        processes = [child.info for child in (*self.router, *self.robots)] + [psutil.Process()]
        before = sum(map(_cpu, processes))
        began = time.perf_counter()
        self.driver.turn(seconds, self.measured)
        self.measured.seconds += time.perf_counter() - began
        self.measured.cpu_seconds += sum(map(_cpu, processes)) - before
        self.measured.rss = sum(p.memory_info().rss for p in processes[:-1])
        self.measured.threads = sum(p.num_threads() for p in processes[:-1])


def _cpu(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    robots: int
    topology: str
    p50_ms: float
    p99_ms: float
    sent: int
    lost: int
    cpu_percent: float
    rss_mb: float
    threads: int
    p50_ratio: float
    cpu_ratio: float


def compare(topologies: dict[str, Spawn], robots: int, seconds: float) -> list[Row]:
    """Run topologies side by side, in turns.

    Args:
        topologies: by name; with the one that the others are compared with.
        robots: how many each has.
        seconds: how long each is measured [s].
    """
    names = [f"r{i + 1}" for i in range(robots)]
    with contextlib.ExitStack() as stack:
        running = {name: Running(stack, spawn, names) for name, spawn in topologies.items()}
        for topology in running.values():
            topology.driver.turn(TURN, None)  # warm
        for _ in range(max(1, round(seconds / TURN))):
            for topology in running.values():
                topology.turn(TURN)
        ground = running[GROUND].measured
        return [_row(robots, name, topology.measured, ground) for name, topology in running.items()]


def _row(robots: int, name: str, m: Measured, ground: Measured) -> Row:
    return Row(
        robots=robots,
        topology=name,
        p50_ms=1e3 * quantile(m.latencies, 0.5),
        p99_ms=1e3 * quantile(m.latencies, 0.99),
        sent=m.sent,
        lost=m.sent - m.answered,
        cpu_percent=100.0 * m.cpu_seconds / m.seconds,
        rss_mb=m.rss / 2**20,
        threads=m.threads,
        p50_ratio=quantile(m.latencies, 0.5) / quantile(ground.latencies, 0.5),
        cpu_ratio=(m.cpu_seconds / m.seconds) / (ground.cpu_seconds / ground.seconds),
    )


def quantile(values: Sequence[float], q: float) -> float:
    """The q-quantile of values; NaN of none."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(q * len(ordered)))] if ordered else math.nan


# ---- starting up


@dataclass(frozen=True)
class StartUp:
    """How long something takes to be up: median and worst of some times [s]."""

    what: str
    median_s: float
    worst_s: float
    times: int


def start_ups(times: int) -> list[StartUp]:
    """From spawning a process to its first command, bare and agent in turns; and until ``make demo`` is ready.

    Args:
        times: how often each is measured.
    """
    took: dict[str, list[float]] = {name: [] for name in (GROUND, "agents on a circle")}
    demo = []
    with contextlib.ExitStack() as stack:
        empty = Running(stack, lambda *_: [], ["r1"])
        for _ in range(times):
            for name, each in took.items():
                began = time.perf_counter()
                children = TOPOLOGIES[name](empty.endpoint, ["r1"])
                each.append(empty.driver.first_command(5.0) - began)
                stop(children)
    for _ in range(times):
        run = [sys.executable, "-P", "-m", "muro_zenoh", "run", "pursuit", "--duration", "1", "--headless"]
        said = subprocess.run(run, stdout=subprocess.PIPE, text=True, check=False).stdout
        found = re.search(r"all processes ready after ([0-9.]+) s", said)
        demo.append(float(found.group(1)) if found else math.nan)
    took = {f"{name}: spawn to first command": each for name, each in took.items()}
    took["make demo: all processes ready"] = demo
    return [StartUp(name, quantile(each, 0.5), max(each), times) for name, each in took.items()]


# ---- processes


@dataclass
class Child:
    """A child process."""

    popen: subprocess.Popen[str]
    info: psutil.Process


def start(commands: Sequence[Sequence[str]]) -> list[Child]:
    """Start Python processes and wait until each has said that it is ready."""
    children = []
    for command in commands:
        popen = subprocess.Popen([sys.executable, "-P", *command], stdout=subprocess.PIPE, text=True)
        children.append(Child(popen, psutil.Process(popen.pid)))
    for child in children:
        assert child.popen.stdout is not None
        line = child.popen.stdout.readline()
        if not line.startswith("READY"):
            stop(children)
            raise click.ClickException(f"a process ended before it was ready; it said {line!r}")
    return children


def stop(children: Sequence[Child]) -> None:
    """Terminate processes, and kill those that stay."""
    for child in children:
        child.popen.terminate()
    for child in children:
        try:
            child.popen.wait(5.0)
        except subprocess.TimeoutExpired:
            child.popen.kill()
            child.popen.wait()


def free_port() -> int:
    """A TCP port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


# ---- telling


def table(rows: Sequence[Row]) -> Table:
    """The rows for people."""
    out = Table("robots", "topology", "p50 ms", "p99 ms", "lost", "CPU %", "RSS MB", "threads", "p50 x", "CPU x")
    for r in rows:
        out.add_row(
            str(r.robots),
            r.topology,
            f"{r.p50_ms:.2f}",
            f"{r.p99_ms:.2f}",
            f"{r.lost}/{r.sent}",
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
    for size in filter(None, robots.split(",")):
        rows += compare(TOPOLOGIES, int(size), seconds)
        console.print(table(rows[-len(TOPOLOGIES) :]))
    ups = start_ups(starts) if starts else []
    if ups:
        out = Table("start-up", "median s", "worst s")
        for up in ups:
            out.add_row(up.what, f"{up.median_s:.2f}", f"{up.worst_s:.2f}")
        console.print(out)
    if file:
        file.write_text(json.dumps([asdict(row) for row in (*rows, *ups)], indent=1) + "\n")


if __name__ == "__main__":
    main()
