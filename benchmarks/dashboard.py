"""What the page costs, by robots and clients: `muro page`, and the base station that it belongs to.

    python benchmarks/dashboard.py [--robots 10 100] [--clients 0 1 10] [--seconds 10] [--json dashboard.json]

``played``: a process plays the robots and the base station on a router (20 states, 20 commands a robot and second, and
all else that a page reads), `muro page` is the real one, and the clients are in a process of their own. ``page`` is the
page's processor time in percent of one core, ``above`` what that is above no clients, ``kB/s`` what one client gets,
``MB`` the page's memory. ``asleep`` is a client that stops reading after its first message.

``stop``: a client asks for a stop, and the time until it is on the bus [ms].

``station``: a real base station, of which only the cameras are played, and a real page: processor time of both.

``run``: a real `muro run pursuit` of ten robots: processor time of its base station and of its page.

``beside``: how late a timer of 5 ms is in a process that also serves the page in a thread, in one that leaves it to
another process, and in one that has no page; ten clients and the most robots.

``draw``: how long a browser takes to draw a hundred robots [ms], where there is one: benchmarks/page.py.

Ends with the goals, and with 1 when one is missed.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgpack
import psutil
from websockets.asyncio.client import connect

from basestation.dashboard.access import tokens_in
from benchmarks.page import measure as measure_in_browser
from benchmarks.scale import machine
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import BusSettings
from muro_zenoh.transport import open_bus
from tests.support.browser import browser_missing
from tests.support.router import free_port

SETTLED = 3.0
"""Time before each measurement [s]."""

STOPS = 30

LAB = """\
robots = {robots}
[arena]
x_min = -5.0
x_max = 5.0
y_min = -5.0
y_max = 5.0
[circle]
radius = 4.0
[separation]
enabled = false
"""


def start(*arguments: str, ready: str = "READY") -> subprocess.Popen[str]:
    """Start one of our processes, and wait for a line of it."""
    process = subprocess.Popen([sys.executable, *arguments], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    for text in process.stdout:
        if text.startswith(ready):
            return process
    raise SystemExit(f"{' '.join(arguments)} ended before it was ready")


@contextlib.contextmanager
def running(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A process within a block."""
    process = start(*arguments)
    try:
        yield process
    finally:
        process.terminate()
        process.communicate(timeout=20)


class Played:
    """A router, a played fleet, and the page of it.

    Args:
        robots: how many are played.
        folder: for files.
        station: whether there is a real base station; otherwise it is played, too.

    Attributes:
        station: the base station's process, where there is a real one.
    """

    station: subprocess.Popen[str]

    def __init__(self, robots: int, folder: Path, station: bool = False) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.port = free_port()
        self.file = folder / f"lab{robots}.toml"
        self.file.write_text(LAB.format(robots=robots))
        self.tokens = folder / "tokens.json"
        self.token = tokens_in(self.tokens).operator
        self._robots = robots
        self._real_station = station
        self._stack = contextlib.ExitStack()

    @property
    def url(self) -> str:
        """Of the WebSocket."""
        return f"ws://127.0.0.1:{self.port}/ws"

    def __enter__(self) -> Played:
        muro = ("-P", "-m", "muro_zenoh")
        enter = self._stack.enter_context
        enter(running(*muro, "router", "--listen", self.endpoint))
        what = "robots" if self._real_station else "all"
        enter(running("-m", "benchmarks.support.page_traffic", self.endpoint, str(self._robots), what))
        if self._real_station:
            self.station = enter(running("-m", "benchmarks.support.page_station", self.endpoint, str(self.file)))
        return self

    def serve(self) -> psutil.Process:
        """Start the page."""
        web = ("--web", f"127.0.0.1:{self.port}", "--tokens", str(self.tokens), "--connect", self.endpoint)
        page = self._stack.enter_context(running("-P", "-m", "muro_zenoh", "page", str(self.file), *web))
        return psutil.Process(page.pid)

    def __exit__(self, *_: object) -> None:
        self._stack.close()


def cpu_of(lasts: float, *processes: psutil.Process) -> list[float]:
    """Processor time of processes over a time, in percent of one core."""
    before, begin = [sum(one.cpu_times()[:2]) for one in processes], time.monotonic()
    time.sleep(lasts)
    after, passed = [sum(one.cpu_times()[:2]) for one in processes], time.monotonic() - begin
    return [round(100.0 * (end - was) / passed, 2) for was, end in zip(before, after, strict=True)]


def measure(
    page: psutil.Process, url: str, token: str, clients: int, asleep: int, lasts: float
) -> dict[str, float | int]:
    """What a number of clients cost a page, and what each of them gets."""
    arguments = ("-m", "benchmarks.support.page_clients", url, token, str(clients), str(asleep))
    load = start(*arguments, str(SETTLED + lasts + 1.0))
    time.sleep(SETTLED)
    (cpu,) = cpu_of(lasts, page)
    rest, _ = load.communicate(timeout=60)
    found = json.loads(rest.strip().splitlines()[-1])
    return {
        "clients": clients,
        "asleep": asleep,
        "page_cpu_percent": cpu,
        "client_kb_per_s": round(found["bytes_per_s"] / 1e3, 1),
        "states_per_s": round(found["states_per_s"], 1),
        "page_rss_mb": round(page.memory_info().rss / 1e6, 1),
    }


async def stop_latencies(url: str, token: str, endpoint: str) -> list[float]:
    """The time from a client's order to the stop on the bus, again and again [s]."""
    found: list[float] = []
    protocols: Any = ["muro", f"token.{token}"]
    async with (
        open_bus(BusSettings(connect=(endpoint,)), Role.OPERATOR) as bus,
        connect(url, subprotocols=protocols, max_size=None, compression=None) as socket,
    ):
        stops = bus.every(channels.STOP)
        reading = asyncio.create_task(_read(socket))
        await stops.next()  # until what was kept before has come, new values wait for it
        for number in range(STOPS):
            stops.drain()
            asked = time.perf_counter()
            await socket.send(msgpack.packb({"order": "stop", "id": number, "names": ["r1"]}))
            while "r1" not in (await stops.next()).message.names:
                pass
            found.append(time.perf_counter() - asked)
            await asyncio.sleep(0.8 + 0.01 * number)  # until it is repeated no more
        reading.cancel()
    return found


async def _read(socket: Any) -> None:
    async for _ in socket:
        pass


def stop_row(lab: Played, clients: int) -> dict[str, float | int]:
    """How soon a stop is on the bus while a number of other clients look on."""
    lasts = str(STOPS * 1.2 + 5.0)
    load = start("-m", "benchmarks.support.page_clients", lab.url, lab.token, str(clients), "0", lasts)
    time.sleep(1.0)
    found = sorted(asyncio.run(stop_latencies(lab.url, lab.token, lab.endpoint)))
    load.terminate()
    load.communicate(timeout=20)
    return {
        "clients": clients,
        "stop_p50_ms": round(1e3 * statistics.median(found), 2),
        "stop_p95_ms": round(1e3 * found[int(0.95 * (len(found) - 1))], 2),
        "stop_max_ms": round(1e3 * found[-1], 2),
    }


def played_rows(robots: int, clients: list[int], lasts: float, folder: Path) -> dict[str, Any]:
    """All that is measured of one played fleet."""
    rows: list[dict[str, Any]] = []
    with Played(robots, folder) as lab:
        page = lab.serve()
        time.sleep(SETTLED)
        for number, asleep in [*((number, 0) for number in clients), (1, 10)]:
            rows.append({"robots": robots, **measure(page, lab.url, lab.token, number, asleep, lasts)})
            row = rows[-1]
            row["above_percent"] = round(row["page_cpu_percent"] - rows[0]["page_cpu_percent"], 2)
            print(
                f"played  {robots:>4} robots  {number:>3} clients  {asleep:>3} asleep"
                f"   page {row['page_cpu_percent']:>6.2f} %   above {row['above_percent']:>6.2f} %"
                f"   {row['client_kb_per_s']:>7.1f} kB/s   {row['states_per_s']:>5.1f} states/s"
                f"   {row['page_rss_mb']:>6.1f} MB",
                flush=True,
            )
        stops = [{"robots": robots, **stop_row(lab, number)} for number in (0, 10)]
        for row in stops:
            print(
                f"stop    {robots:>4} robots  {row['clients']:>3} clients   p50 {row['stop_p50_ms']:>6.2f} ms"
                f"   p95 {row['stop_p95_ms']:>6.2f} ms   max {row['stop_max_ms']:>6.2f} ms",
                flush=True,
            )
    return {"cpu": rows, "stops": stops}


def station_rows(robots: int, clients: list[int], lasts: float, folder: Path) -> list[dict[str, Any]]:
    """A real base station of a played fleet, and its page."""
    with Played(robots, folder, station=True) as lab:
        page = lab.serve()
        time.sleep(SETTLED)
        processes = psutil.Process(lab.station.pid), page
        return [both_row("station", robots, number, lab.url, lab.token, lasts, *processes) for number in clients]


def run_rows(clients: list[int], lasts: float, folder: Path) -> list[dict[str, Any]]:
    """A real run of ten robots: its base station and its page."""
    total = len(clients) * (lasts + SETTLED + 8.0) + 20.0
    command = ("-P", "-m", "muro_zenoh", "run", "pursuit", "--robots", "10", "--set", "circle.radius=1.1", "--headless")
    process = subprocess.Popen(
        [sys.executable, *command, "--duration", str(total), "--web", "127.0.0.1:0"],
        stdout=subprocess.PIPE, text=True, cwd=folder, env={**os.environ, "PYTHONPATH": os.getcwd()},
    )  # fmt: skip
    try:
        assert process.stdout is not None
        found = next(match for text in process.stdout if (match := re.search(r"page: http://(\S+)/#token=(\S+)", text)))
        time.sleep(SETTLED + 3.0)
        children = psutil.Process(process.pid).children()
        station = next(child for child in children if "basestation" in child.cmdline())
        (page,) = station.children()
        url = f"ws://{found[1]}/ws"
        return [both_row("run", 10, number, url, found[2], lasts, station, page) for number in clients]
    finally:
        process.terminate()
        process.communicate(timeout=30)


def both_row(
    what: str,
    robots: int,
    clients: int,
    url: str,
    token: str,
    lasts: float,
    station: psutil.Process,
    page: psutil.Process,
) -> dict[str, Any]:
    """What a number of clients cost a base station and its page."""
    arguments = ("-m", "benchmarks.support.page_clients", url, token, str(clients), "0")
    load = start(*arguments, str(SETTLED + lasts + 1.0))
    time.sleep(SETTLED)
    of_station, of_page = cpu_of(lasts, station, page)
    load.communicate(timeout=60)
    print(
        f"{what:<7} {robots:>4} robots  {clients:>3} clients   base station {of_station:>6.2f} %"
        f"   page {of_page:>6.2f} %",
        flush=True,
    )
    return {
        "robots": robots,
        "clients": clients,
        "basestation_cpu_percent": of_station,
        "page_cpu_percent": of_page,
    }


def beside_rows(robots: int, lasts: float, folder: Path) -> list[dict[str, Any]]:
    """How late a timer is beside the page."""
    rows: list[dict[str, Any]] = []
    for where in ("none", "process", "thread"):
        with Played(robots, folder) as lab:
            if where == "process":
                lab.serve()
            web = (str(lab.file), lab.endpoint, str(lab.port), str(lab.tokens), str(SETTLED), str(lasts))
            host = subprocess.Popen(
                [sys.executable, "-m", "benchmarks.support.page_host", where, *web], stdout=subprocess.PIPE, text=True
            )
            time.sleep(1.5)
            load = None
            if where != "none":
                clients = ("-m", "benchmarks.support.page_clients", lab.url, lab.token, "10", "0")
                load = start(*clients, str(SETTLED + lasts))
            found, _ = host.communicate(timeout=60 + lasts)
            if load is not None:
                load.communicate(timeout=60)
        rows.append({"robots": robots, "page": where, **json.loads(found.strip().splitlines()[-1])})
        row = rows[-1]
        print(
            f"beside  {robots:>4} robots  page {where:<8} late p50 {row['late_p50_ms']:>6.2f} ms"
            f"   p99 {row['late_p99_ms']:>6.2f} ms   max {row['late_max_ms']:>6.2f} ms",
            flush=True,
        )
    return rows


def draw_rows() -> list[dict[str, Any]]:
    """How long a browser draws."""
    if missing := browser_missing():
        print(missing)
        return []
    rows = asyncio.run(measure_in_browser("draw", presses=0))
    for row in rows:
        print("  ".join(f"{key} {value}" for key, value in row.items()))
    return rows


def goals(found: dict[str, Any]) -> list[tuple[str, float, float]]:
    """What is wanted: in words, what was measured, and the most that it may be. Of the most robots and clients."""
    robots = max(row["robots"] for row in found["played"])
    played = {(row["clients"], row["asleep"]): row for row in found["played"] if row["robots"] == robots}
    stations = [row["basestation_cpu_percent"] for row in found["station"] if row["robots"] == robots]
    none, some = (row["stop_p50_ms"] for row in found["stops"] if row["robots"] == robots)
    clients = max(number for number, _ in played)
    rows = [
        (f"page, {robots} robots, {clients} clients: % of a core above none", played[clients, 0]["above_percent"], 5.0),
        (f"base station, {robots} robots, {clients} clients: % above none", stations[-1] - stations[0], 5.0),
        ("ten clients that do not read: MB", played[1, 10]["page_rss_mb"] - played[clients, 0]["page_rss_mb"], 10.0),
        ("a stop with ten clients: ms later than with none", some - none, 5.0),
    ]
    return rows + [(f"a draw, {row['scene']}: ms", row["p95"], 8.0) for row in found["draws"]]


def main() -> int:
    """Measure, print, and say whether the goals are met."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, nargs="+", default=[10, 100], help="sizes of the played fleets")
    parser.add_argument(
        "--clients", type=int, nargs="+", default=[0, 1, 10], help="numbers of clients, the first is compared with"
    )
    parser.add_argument("--seconds", type=float, default=10.0, help="how long each is measured (10)")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="muro-dashboard-") as name:
        folder = Path(name)
        played = [played_rows(robots, given.clients, given.seconds, folder) for robots in given.robots]
        found = {
            "machine": machine(),
            "seconds": given.seconds,
            "played": [row for one in played for row in one["cpu"]],
            "stops": [row for one in played for row in one["stops"]],
            "station": [
                row for robots in given.robots for row in station_rows(robots, given.clients, given.seconds, folder)
            ],
            "run": run_rows(given.clients, given.seconds, folder),
            "beside": beside_rows(max(given.robots), given.seconds, folder),
            "draws": draw_rows(),
        }
    if given.json:
        given.json.write_text(json.dumps(found, indent=2) + "\n")
    rows = goals(found)
    for text, measured, most in rows:
        print(f"goal    {text} {measured:.2f}, at most {most:g}: {'met' if measured <= most else 'MISSED'}")
    return 0 if all(measured <= most for _, measured, most in rows) else 1


if __name__ == "__main__":
    raise SystemExit(main())
