"""A browser, and a fleet of real processes with its page: for tests, benchmarks and screenshots."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import re
import socket
import time
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

import psutil
import pytest
from playwright.async_api import Browser, BrowserContext, Page, async_playwright
from playwright.async_api import TimeoutError as NotInTime

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import BusSettings
from muro_zenoh.messages import FleetSnapshot, Truth
from muro_zenoh.transport import Bus, open_bus
from tests.support.process import Process
from tests.support.router import free_port
from tests.support.waiting import seconds, within

CHROMIUM: Final = Path("/usr/bin/chromium")

_FLAGS: Final = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)

STATIC: Final = Path(__file__).parents[2] / "basestation" / "dashboard" / "static"

_REST: Final = (0.005, 0.02)
"""Wheels are at zero below these [m/s, rad/s]."""


def browser_missing() -> str:
    """Why there can be no test in a browser on this machine; empty when there can."""
    if not CHROMIUM.exists():
        return f"no {CHROMIUM}: apt-get install chromium"
    if not (STATIC / "vendor" / "msgpack.min.js").exists():
        return "the page's libraries are not installed: make setup"
    return ""


needs_browser = pytest.mark.skipif(bool(browser_missing()), reason=browser_missing())


@asynccontextmanager
async def chromium() -> AsyncIterator[Browser]:
    """Debian's browser, without a window."""
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=str(CHROMIUM), args=_FLAGS)
        try:
            yield browser
        finally:
            await browser.close()


_NOTE_STOPS: Final = """
    let before = -1e9;
    for (const kind of ["pointerdown", "keydown"]) window.addEventListener(kind, event => {
        const stops = event.key === " " || event.key === "Escape" || event.target.closest?.("#stop");
        if (!stops) return;
        const first = event.timeStamp - before > 500;
        before = event.timeStamp;
        if (first) window.pressedAt = (performance.timeOrigin + event.timeStamp) / 1000;
    }, {capture: true});
"""


AGAIN: Final = re.compile("not answered|give it again")
"""What a notice says of an order that may have been lost on a busy machine."""

_HAVE_READ: Final = "for (const notice of document.querySelectorAll('.notice')) notice.dataset.read = 'yes'"


class Visit:
    """A page that somebody has open.

    Attributes:
        page: Playwright's.
        complaints: what the browser's console complained of, and what was thrown.
    """

    def __init__(self, page: Page) -> None:
        self.page = page
        self.complaints: list[str] = []
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on(
            "console", lambda message: message.type in ("error", "warning") and self.complaints.append(message.text)
        )

    def forgive_no_connection(self) -> None:
        """Forget that the browser complained of connections that could not be made, or not to the end; nothing else."""
        others = (text for text in self.complaints if not text.startswith("WebSocket connection to"))
        self.complaints = [text for text in others if "net::ERR_" not in text]

    async def hold_time(self) -> None:
        """Let time pass by ``page.clock`` alone in what is opened from now on: no machine is too slow for it."""
        await self.page.clock.install()
        await self.page.clock.pause_at(time.time() + 3600.0)  # which is nobody else's time

    async def muro(self, expression: str) -> Any:
        """A value of the page's hook for tests, such as ``sent``."""
        return await self.page.evaluate(f"window.muro.{expression}")

    async def until(self, expression: str, limit: float = 10.0, argument: Any = None) -> None:
        """Wait until an expression holds in the page, at most for ``limit`` (scaled) [s]."""
        await self.page.wait_for_function(expression, arg=argument, timeout=1000 * seconds(limit))

    async def found(self, function: str, argument: Any, what: str, limit: float = 10.0) -> Any:
        """What a function of the page returns, which may await, once it is not null; ``limit`` is scaled [s]."""

        async def look() -> Any:
            while (found := await self.page.evaluate(function, argument)) is None:  # noqa: ASYNC110 - it is in the page
                await asyncio.sleep(0.05)
            return found

        return await within(limit, look(), what)

    async def sees(self, names: Sequence[str], limit: float = 10.0) -> None:
        """Wait until robots have a place on the canvas."""
        every = "names => window.muro && names.every(name => window.muro.screenOf(name) !== null)"
        await self.until(every, limit, list(names))

    async def note_stops(self) -> None:
        """Note when a stop is pressed, from now on."""
        await self.page.evaluate(_NOTE_STOPS)

    async def pressed_at(self) -> float:
        """When a stop was pressed last, the first time of two in a row, by the clock of this machine [s since 1970]."""
        return float(await self.page.evaluate("window.pressedAt"))

    async def press_stop_twice(self, way: str) -> None:
        """Stop all: press ``#stop`` with the mouse, or a key, two times in a row."""
        if way == "#stop":
            box = await self.page.locator(way).bounding_box()
            assert box is not None
            await self.page.mouse.dblclick(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        else:
            await self.page.keyboard.press(way)
            await self.page.keyboard.press(way)

    async def words(self) -> str:
        """What the page says, for a failure."""
        return f"{' | '.join((await self.page.inner_text('body')).splitlines())}; complaints: {self.complaints}"

    async def resume(self) -> None:
        """Lift a stop as a person does: asked once."""

        async def give() -> None:
            await self.page.locator("#resume button", has_text="Resume").click()
            await self.page.locator("#resume button", has_text="Yes").click()

        hidden = "() => document.querySelector('#resume').hidden"
        said = await self.order("Resume", give, hidden)
        assert "refused" not in said, said
        await self.until(hidden)

    async def press_on_floor(self, x: float, y: float) -> None:
        """Click a place of the floor [m, world]."""
        await self.page.mouse.click(*await self.pixel(f"screenAt({x}, {y})"))

    async def pixel(self, where: str) -> tuple[float, float]:
        """A pixel of the canvas, such as ``screenOf('r1')``, in the window's pixels."""
        px, py = await self.muro(where)
        box = await self.page.locator("#floor").bounding_box()
        assert box is not None
        return box["x"] + px, box["y"] + py

    async def order(self, words: str, give: Callable[[], Awaitable[Any]], obeyed: str = "() => false") -> str:
        """Give an order as a person does: again when it was not answered, or refused because a process stood still.

        Args:
            words: that its notice has.
            give: gives it.
            obeyed: holds in the page when it was carried out, answered or not: then it is not given again.

        Returns:
            What came of it: it was taken, or refused for another reason, or it was obeyed.
        """
        for _ in range(5):
            await self.page.evaluate(_HAVE_READ)
            await give()
            said = await self.notice(words)
            if not AGAIN.search(said):
                return said
            with contextlib.suppress(NotInTime):
                await self.until(obeyed, 1.0)
                return said
        raise AssertionError(f"given five times: {said}")

    async def notice(self, words: str, limit: float = 10.0) -> str:
        """Wait for the notice of an order that has these words, and was not there before it; returns all of it."""
        notice = self.page.locator("#notices .notice:not([data-read])", has_text=words).first
        await notice.wait_for(timeout=1000 * seconds(limit))
        return " ".join(await notice.locator("strong, span").all_inner_texts())


@asynccontextmanager
async def visit(browser: Browser, url: str, **options: Any) -> AsyncIterator[Visit]:
    """Open a page; a test whose page complains in the console fails.

    Args:
        browser: the browser.
        url: where to.
        options: of the context, such as ``viewport``.
    """
    context: BrowserContext = await browser.new_context(**{"viewport": {"width": 1280, "height": 800}, **options})
    try:
        visited = Visit(await context.new_page())
        await visited.page.goto(url)
        yield visited
        assert not visited.complaints, f"the page complains: {visited.complaints}"
    finally:
        await context.close()


class PagedRun:
    """``muro run`` with its page, and an observer on its bus. Made by :func:`paged_run`.

    Attributes:
        process: the process of `muro run`.
        robots: the robots' names.
        url: the operator's link.
        viewer_url: the link of one who may not steer.
        bus: the observer's.
    """

    def __init__(self, process: Process, robots: tuple[str, ...], url: str, viewer_url: str, bus: Bus) -> None:
        self.process = process
        self.robots = robots
        self.url = url
        self.viewer_url = viewer_url
        self.bus = bus
        self._truth = bus.latest(channels.TRUTH, "*")
        self._truths = bus.every(channels.TRUTH, "*", depth=1024)
        self._health = bus.latest(channels.HEALTH, "*")
        self._resting: dict[str, float] = {}
        self._snapshots = bus.every(channels.ALL_POSITIONS, depth=256)
        self._seen: deque[FleetSnapshot] = deque(maxlen=256)

    def serves(self) -> bool:
        """Whether the page is served."""
        address = urlsplit(self.url)
        with socket.socket() as probe:
            return probe.connect_ex((address.hostname or "", address.port or 0)) == 0

    def truth(self, name: str) -> Truth:
        """The newest true state of a robot."""
        received = self._truth.get(name)
        assert received is not None, f"no truth of {name}"
        return received.message

    def moving(self) -> list[str]:
        """The robots whose wheels turn now, by the truth."""
        for received in self._truths.drain():
            truth = received.message
            if abs(truth.v) > _REST[0] or abs(truth.omega) > _REST[1]:
                self._resting.pop(received.name, None)
            else:
                self._resting.setdefault(received.name, truth.stamp)
        return [name for name in self.robots if name not in self._resting]

    def at_rest_since(self, *names: str) -> float:
        """When the last of these robots, or of all, came to rest, as of :meth:`moving` [s since 1970]."""
        return max(self._resting[name] for name in names or self.robots)

    async def time_until(self, condition: Callable[[], bool], limit: float, what: str) -> float:
        """Wait until a condition holds; returns after which time it did [s]. Fails after ``limit`` (scaled) [s]."""
        loop = asyncio.get_running_loop()
        began = loop.time()
        while not condition():
            assert loop.time() - began < seconds(limit), f"{what}: not within {seconds(limit):g} s; {self._state()}"
            await asyncio.sleep(0.005)
        return loop.time() - began

    def _state(self) -> str:
        """Where the robots are and why they hold, for a failure."""
        states = []
        for name in self.robots:
            truth, report = self.truth(name), self._health.get(name)
            reasons = ", ".join(report.message.reasons) if report is not None else "no report"
            age = self.bus.clock.now() - truth.stamp
            where = f"{name} at ({truth.x:.2f}, {truth.y:.2f}), {truth.v:.2f} m/s {age:.1f} s ago"
            states.append(f"{where}: {reasons or 'drives'}")
        return "; ".join(states)

    async def stop_all(self, opened: Visit, way: str, after: float) -> float:
        """Stop all a while after all drive, pressing twice, and resume.

        Args:
            opened: the page, which notes stops (:meth:`Visit.note_stops`).
            way: ``#stop`` or a key.
            after: how long after [s].

        Returns:
            The time from the press to all wheels at rest, by the stamps of the browser and of the simulator [s].
        """
        await self.time_until(lambda: len(self.moving()) == len(self.robots), 10.0, "all robots drive")
        await asyncio.sleep(after)
        await opened.press_stop_twice(way)
        try:
            await self.time_until(lambda: not self.moving(), 5.0, f"all wheels stand, stopped by {way!r}")
        except AssertionError as error:
            raise AssertionError(f"{error}; the page: {await opened.words()}") from None
        took = self.at_rest_since() - await opened.pressed_at()
        await opened.page.locator("#receipt.good").wait_for(timeout=1000 * seconds(8))
        await opened.resume()
        return took

    def snapshot_like(self, rows: dict[str, Any]) -> FleetSnapshot | None:
        """The snapshot that a state of the page shows: the one whose places it has."""
        self._seen += (received.message for received in self._snapshots.drain())
        for snapshot in reversed(self._seen):
            places = {robot.name: robot for robot in snapshot.robots}
            if all(
                name in places and math.hypot(row[0] - places[name].x, row[1] - places[name].y) < 1e-4
                for name, row in rows.items()
            ):
                return snapshot
        return None

    def child(self, *words: str) -> psutil.Process:
        """The process of the run whose command line has these words."""
        for child in psutil.Process(self.process.pid).children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess):
                if set(words) <= set(child.cmdline()):
                    return child
        raise AssertionError(f"no process {words}")


@asynccontextmanager
async def paged_run(folder: Path, scenario: str, *arguments: str, robots: int) -> AsyncIterator[PagedRun]:
    """A run of real processes with a page.

    Args:
        folder: a new one, for what the run leaves.
        scenario: its name or file.
        arguments: more of `muro run`.
        robots: how many.
    """
    command = ["-m", "muro_zenoh", "run", scenario, "--headless", "--web", f"127.0.0.1:{free_port()}"]
    command += ["--robots", str(robots), "--duration", "3600", *arguments]
    with contextlib.chdir(folder):
        process = Process(command, name="muro run")
    with process:
        operator = process.line("page: ", 30.0).removeprefix("page: ").strip()
        viewer = process.line("      to look", 5.0).rpartition(" ")[2].strip()
        connect = _endpoints(folder)
        names = tuple(f"r{number + 1}" for number in range(robots))
        async with open_bus(BusSettings(connect=connect), Role.OPERATOR) as bus:
            run = PagedRun(process, names, operator, viewer, bus)
            await run.time_until(lambda: all(run._truth.get(name) for name in names), 10.0, "truth of every robot")
            await run.time_until(run.serves, 10.0, "the page is served")
            yield run


def _endpoints(folder: Path) -> tuple[str, ...]:
    """Where the processes of a run connect to."""
    (settings,) = folder.glob("runs/*/scenario.json")
    return tuple(json.loads(settings.read_text())["bus"]["connect"])
