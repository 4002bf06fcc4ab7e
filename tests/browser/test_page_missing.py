"""Every robot of the fleet file is on the page always: without cameras, without agents, at the side with the reason."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.async_api import Browser, Error

from muro_zenoh.config import as_table, parse_scenario
from tests.support.browser import Visit, visit
from tests.support.process import Process
from tests.support.router import free_port, router
from tests.support.waiting import seconds

pytestmark = [pytest.mark.asyncio(loop_scope="package"), pytest.mark.slow]

ROBOTS = ["r1", "r2"]


class Parts:
    """A fleet whose processes are started one by one."""

    def __init__(self, folder: Path, endpoint: str) -> None:
        self._folder = folder
        self._file = str(folder / "scenario.json")
        bus = {"mode": "client", "connect": [endpoint]}
        table = {"robots": len(ROBOTS), "camera": {"north": {}}, "behaviour": {"name": "hold"}, "bus": bus}
        Path(self._file).write_text(json.dumps(as_table(parse_scenario(table, "test", name="test"))))
        self._processes: list[Process] = []

    def start(self, *arguments: str) -> Process:
        """Start a process, and wait until it is ready."""
        command = ["-m", "muro_zenoh", arguments[0], self._file, *arguments[1:]]
        process = Process(command, name=arguments[0])
        self._processes.append(process)
        process.ready(30.0)
        return process

    def base_station(self) -> str:
        """Start the base station with its page; returns the operator's link."""
        state = str(self._folder / "state.json")
        process = Process(
            ["-m", "muro_zenoh", "basestation", self._file, "--state", state, "--web", f"127.0.0.1:{free_port()}"],
            name="basestation",
        )
        self._processes.append(process)
        return process.line("page: ", 30.0).removeprefix("page: ").strip()

    def close(self) -> None:
        """Stop all."""
        for process in reversed(self._processes):
            process.stop()


@pytest.fixture
def parts(tmp_path: Path, browser: Browser) -> Iterator[Parts]:
    with router() as running:
        made = Parts(tmp_path, running.endpoint)
        try:
            yield made
        finally:
            made.close()


async def test_robots_without_cameras_and_agents_stand_at_the_side_with_the_reason(
    parts: Parts, browser: Browser
) -> None:
    url = parts.base_station()
    async with visit(browser, "about:blank") as opened:
        await open_when_served(opened, url)
        await opened.page.locator("#aside li").nth(1).wait_for(timeout=1000 * seconds(5))
        assert await aside(opened) == ROBOTS
        assert await opened.page.locator("#robots strong").all_inner_texts() == ROBOTS
        for line in await opened.page.locator("#aside span").all_inner_texts():
            assert line, "a reason"
        await opened.page.locator("#stop").click()
        await opened.page.locator("#receipt.bad", has_text="0 of 2 robots confirmed").wait_for()
        assert await opened.page.locator("#receipt .missing li").all_inner_texts() == ["r1 no agent", "r2 no agent"]
        await opened.resume()
        parts.start("sim")  # bases and cameras, no agents
        await opened.sees(ROBOTS)
        await opened.page.locator("#aside", has_text="agent").wait_for()
        assert await aside(opened) == ROBOTS
        parts.start("agent", "r1")
        await opened.page.locator("#aside li", has_text="r1").wait_for(state="detached")
        assert await aside(opened) == ["r2"]
        await opened.until("() => window.muro.conditionOf('r1') === 'holding'")  # stale, while no picture comes
        await opened.page.locator("#robots li", has_text="the behaviour is hold").wait_for()


async def open_when_served(opened: Visit, url: str) -> None:
    """Go to a page whose process may still be starting."""
    async with asyncio.timeout(seconds(30.0)):
        while True:
            try:
                await opened.page.goto(url)
                break
            except Error:
                await asyncio.sleep(0.1)
    opened.forgive_no_connection()


async def aside(opened: Visit) -> list[str]:
    """The robots at the side."""
    return await opened.page.locator("#aside strong").all_inner_texts()
