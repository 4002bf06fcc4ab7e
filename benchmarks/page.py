"""The page in a browser: how long one draw takes, what an idle page sends, and how fast `Stop all` stops all wheels.

    python benchmarks/page.py [--only draw|idle|stop] [--presses 50] [--json FILE]

``draw``: a hundred robots, 20 states a second for 20 s, in Debian's chromium without a GPU; all robots with trails, on
a circle, or deployed with a cell, a path and a goal each. The time is that of the page's own drawing code, by
``performance.now()``. ``idle``: a page of a real ``muro run pursuit`` that nobody touches for a minute. ``stop``: the
button is pressed twice at random moments of such a run; the time runs from the press to all wheels at rest by the
simulator's truth.
"""

from __future__ import annotations

import argparse
import asyncio
import math
import random
import sys
import tempfile
from pathlib import Path
from typing import Any

import msgpack
from playwright.async_api import Browser, WebSocketRoute

from benchmarks.support.rows import quantile, write
from tests.support.browser import PagedRun, Visit, browser_missing, chromium, paged_run, visit
from tests.support.played_base import DETAILS, PlayedBase, hello, serve

ROBOTS = 100
RATE = 20.0
SECONDS = 20.0
ARENA = (-8.0, -6.0, 8.0, 6.0)
RADIUS = 5.0
GOAL_MS = 8.0
STOPPED_WITHIN = 0.5

NAMES = [f"r{number + 1}" for number in range(ROBOTS)]

Row = dict[str, Any]


def greeting() -> Row:
    """What the page gets first."""
    outline = [[ARENA[0], ARENA[1]], [ARENA[2], ARENA[1]], [ARENA[2], ARENA[3]], [ARENA[0], ARENA[3]]]
    kinds = {"pursuit": {"summary": "", "needs": ["circle"], "parameters": {}}}
    return hello(NAMES, arena=ARENA, cameras={"north": {"outline": outline}}, behaviours=kinds)


def state(number: int, deployed: bool) -> Row:
    """A state; all robots move, and in the first one they have their details."""
    t = number / RATE
    robots, details = {}, {}
    for index, name in enumerate(NAMES):
        if deployed:
            x, y = -7.2 + 1.6 * (index % 10), -5.4 + 1.2 * (index // 10)
            x, y, theta = (
                x + 0.3 * math.cos(0.7 * t + index),
                y + 0.3 * math.sin(0.7 * t + index),
                0.7 * t + index + 1.6,
            )
        else:
            angle = 2.0 * math.pi * index / ROBOTS + 0.04 * t
            x, y, theta = RADIUS * math.cos(angle), RADIUS * math.sin(angle), angle + 1.6
        robots[name] = [x, y, theta, 0.2, 0.04, 0.06, 0.2, 0.04]
        if number == 0:
            details[name] = _details(x, y, theta, deployed)
    made: Row = {"kind": "state", "t": 1.7e9 + t, "seq": number, "robots": robots}
    if number == 0:
        circle = {"x": 0.0, "y": 0.0, "radius": RADIUS, "clockwise": False, "revision": 1, "importance": None}
        made |= {"details": details, "gaps": {}, "circle": circle}
        made |= {"stop": {"all": False, "names": [], "revision": 0}, "lease": [], "processes": {}, "events": []}
    return made


def _details(x: float, y: float, theta: float, deployed: bool) -> Row:
    corners = [[x - 0.8, y - 0.6], [x + 0.8, y - 0.6], [x + 0.8, y + 0.6], [x - 0.8, y + 0.6]]
    return {
        **DETAILS,
        "note": "keeps clear of r3",
        "behaviour": "coverage" if deployed else "pursuit",
        "cell": {"corners": corners, "x": x, "y": y} if deployed else None,
        "path": {"x": x, "y": y, "theta": theta, "segments": [[0.6, 2.0], [0.5, 0.0], [0.6, -2.0]]}
        if deployed
        else None,
        "goal": [x + 0.4, y + 0.3, 0.5] if deployed else None,
    }


class Crowd(PlayedBase):
    """A base station that sends states of a hundred robots, and takes no orders.

    Args:
        deployed: whether they have cells, paths and goals.
    """

    sending: asyncio.Task[None]

    def __init__(self, deployed: bool) -> None:
        super().__init__()
        self._packed = [msgpack.packb(state(number, deployed)) for number in range(int(SECONDS * RATE))]

    def connected(self, socket: WebSocketRoute) -> None:
        """A page connects."""
        self.sending = asyncio.create_task(self._send_all(socket))

    async def _send_all(self, socket: WebSocketRoute) -> None:
        socket.send(msgpack.packb(greeting()))
        for message in self._packed:
            socket.send(message)
            await asyncio.sleep(1.0 / RATE)


async def draw(browser: Browser, deployed: bool) -> Row:
    """How long the page draws a hundred robots [ms]."""
    crowd = Crowd(deployed)
    async with visit(browser, "about:blank", viewport={"width": 1920, "height": 1080}) as opened:
        await serve(opened, crowd)
        await opened.sees(NAMES)
        await crowd.sending
        times = await opened.muro("times")
        scene = "cells, paths, goals" if deployed else "circle"
        found = {q: quantile(times, value) for q, value in {"p50": 0.5, "p95": 0.95, "max": 1.0}.items()}
        return {"what": "draw", "scene": scene, "robots": ROBOTS, "draws": len(times), "unit": "ms", **found}


async def idle(opened: Visit, seconds: float) -> Row:
    """What a page sends that nobody touches."""
    before = await opened.muro("sent")
    await asyncio.sleep(seconds)
    return {"what": "idle", "seconds": seconds, "sent": await opened.muro("sent") - before}


async def stop(opened: Visit, run: PagedRun, presses: int) -> Row:
    """How long all wheels turn after a press [s]."""
    chance = random.Random(1)
    await opened.note_stops()
    await asyncio.sleep(20.0)  # they spread: what is measured are robots that go round
    times = [await run.stop_all(opened, "#stop", chance.uniform(0.2, 1.5)) for _ in range(presses)]
    found = {q: quantile(times, value) for q, value in {"p50": 0.5, "p95": 0.95, "max": 1.0}.items()}
    return {"what": "stop", "presses": presses, "unit": "s", **found}


async def measure(only: str | None, presses: int) -> list[Row]:
    """All of it.

    Args:
        only: one of the three; None for all.
        presses: of the button.
    """
    rows = []
    async with chromium() as browser:
        if only in (None, "draw"):
            rows += [await draw(browser, deployed) for deployed in (False, True)]
        if only == "draw":
            return rows
        with tempfile.TemporaryDirectory() as folder:
            async with (
                paged_run(Path(folder), "pursuit", robots=5) as run,
                visit(browser, run.url) as opened,
            ):
                await opened.sees(run.robots)
                if only in (None, "idle"):
                    rows.append(await idle(opened, 60.0))
                if only in (None, "stop"):
                    rows.append(await stop(opened, run, presses))
    return rows


def main() -> int:
    """Measure, print, and say whether the goals are met."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=("draw", "idle", "stop"))
    parser.add_argument("--presses", type=int, default=50)
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    given = parser.parse_args()
    if missing := browser_missing():
        print(missing, file=sys.stderr)
        return 2
    rows = asyncio.run(measure(given.only, given.presses))
    for row in rows:
        print("  ".join(f"{key} {value}" for key, value in row.items()))
    write(given.json, rows)
    limits = {"draw": ("p95", GOAL_MS), "idle": ("sent", 0), "stop": ("max", STOPPED_WITHIN)}
    return 0 if all(row[limits[row["what"]][0]] <= limits[row["what"]][1] for row in rows) else 1


if __name__ == "__main__":
    raise SystemExit(main())
