"""What the page shows of a real ``muro run pursuit``: every robot, where it is, on every screen, to everybody."""

from __future__ import annotations

import asyncio
import base64
import math
import time
from pathlib import Path
from typing import Any

import cv2
import msgpack
import numpy as np
import pytest
from playwright.async_api import Browser

from tests.support.browser import PagedRun, Visit, visit
from tests.support.waiting import seconds

pytestmark = [pytest.mark.asyncio(loop_scope="package"), pytest.mark.slow]

AXE = Path(__file__).parents[2] / "node_modules" / "axe-core" / "axe.min.js"

PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}

TABS = ("robots", "behaviour", "plots", "health", "faults")

ARENA = (-2.1, -1.5, 2.1, 1.5)
EDGE = 26


async def test_every_robot_is_there_within_three_seconds(browser: Browser, run: PagedRun) -> None:
    async with visit(browser, "about:blank") as opened:
        began = time.monotonic()
        await opened.page.goto(run.url)
        await opened.sees(run.robots, 3.0)
        assert time.monotonic() - began < seconds(3.0)
        assert await opened.page.locator("#robots strong").all_inner_texts() == list(run.robots)
        await opened.page.locator("#link", has_text="Live").wait_for()


async def test_places_on_the_canvas_are_those_of_all_positions(operator: Visit, run: PagedRun) -> None:
    """Within a pixel, and by a reckoning of the test's own."""
    compared = 0
    for _ in range(50):
        # All at one moment of the page: it is not redrawn in between.
        state, pixels, size, drawn = await operator.page.evaluate(
            """names => {
                const {clientWidth, clientHeight, height} = document.querySelector('#floor');
                const pixels = Object.fromEntries(names.map(name => [name, window.muro.screenOf(name)]));
                const drawn = Math.abs(height / devicePixelRatio - clientHeight) < 1;
                return [window.muro.state, pixels, [clientWidth, clientHeight], drawn];
            }""",
            list(run.robots),
        )
        scale = min((size[0] - 2 * EDGE) / (ARENA[2] - ARENA[0]), (size[1] - 2 * EDGE) / (ARENA[3] - ARENA[1]))
        await asyncio.sleep(0.1)  # the snapshot may come to us a moment later than to the page
        snapshot = run.snapshot_like(state["robots"])
        if snapshot is None or not drawn:  # the line of robots without a place may come or go just then
            continue
        for robot in snapshot.robots:
            expected = (size[0] / 2 + robot.x * scale, size[1] / 2 - robot.y * scale)
            assert pixels[robot.name] == pytest.approx(expected, abs=1.0), robot
        compared += 1
        if compared == 5:
            return
    raise AssertionError(f"only {compared} states of the page were found among the snapshots")


STOPPED = """names => new Promise(resolve => {
    const look = () => names.map(name => [...window.muro.screenOf(name), window.muro.conditionOf(name)]);
    const before = look();
    requestAnimationFrame(() => {
        const still = look().every(([x, y], k) => Math.hypot(x - before[k][0], y - before[k][1]) < 0.3);
        const stopped = [...before, ...look()].every(([, , condition]) => condition === "stopped");
        resolve(still && stopped ? [before, document.querySelector("#floor").toDataURL()] : null);
    });
})"""
"""Where robots are that are stopped, and the canvas of that moment: what was known a frame before is painted."""


async def test_what_is_painted_is_where_the_hook_says(operator: Visit, run: PagedRun) -> None:
    """The octagon of a stopped robot is symmetric, so that its middle can be found in a picture of the canvas."""
    await operator.page.keyboard.press("Escape")
    await run.time_until(lambda: not run.moving(), 5.0, "every robot stands")
    places, picture = await operator.found(STOPPED, list(run.robots), "every robot is shown stopped")
    image = cv2.imdecode(np.frombuffer(base64.b64decode(picture.partition(",")[2]), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    red = np.abs(image.astype(int) - np.array([0x1C, 0x16, 0xC4])).sum(axis=2) < 60
    _, _, boxes, _ = cv2.connectedComponentsWithStats(red.astype(np.uint8))
    middles = [(box[0] + box[2] / 2, box[1] + box[3] / 2) for box in boxes[1:] if box[4] > 200]
    for name, (x, y, _) in zip(run.robots, places, strict=True):
        assert min(abs(x - mx) + abs(y - my) for mx, my in middles) < 2.0, (name, (x, y), middles)
    await operator.page.locator("#receipt.good").wait_for()  # while it is sent, nobody may resume
    await operator.resume()


async def test_pictures_of_the_cameras_lie_where_the_robots_are(browser: Browser, run: PagedRun) -> None:
    """Within three pixels, with the robots at rest: the tags in the pictures against the poses that are drawn."""
    pictures: dict[str, dict[str, Any]] = {}

    def received(payload: bytes | str) -> None:
        message = msgpack.unpackb(payload) if isinstance(payload, bytes) else {}
        if message.get("kind") == "picture":
            pictures[message["camera"]] = message

    async with visit(browser, "about:blank") as opened:
        opened.page.on("websocket", lambda socket: socket.on("framereceived", received))
        await opened.page.goto(run.url)
        await opened.sees(run.robots)
        await opened.page.locator("#stop").click()
        await run.time_until(lambda: not run.moving(), 5.0, "every robot stands")
        await opened.page.locator("#receipt.good").wait_for()  # while it is sent, nobody may resume
        await opened.page.locator("#pictures").click()
        await asyncio.sleep(0.3)
        pictures.clear()
        await run.time_until(lambda: len(pictures) == 2, 5.0, "a picture of both cameras")
        rows = (await opened.muro("state"))["robots"]
        scale = (await opened.muro("screenAt(1, 0)"))[0] - (await opened.muro("screenAt(0, 0)"))[0]
        found = [place for picture in pictures.values() for place in _tags(picture)]
        assert len({tag for tag, _ in found}) >= 2, "not all are whole in a picture"
        for tag, (x, y) in found:
            off = min(math.dist((x, y), _mounted(*row[:3])) for row in rows.values())
            assert off * scale < 3.0, (tag, x, y)
        await opened.resume()


def _tags(picture: dict[str, Any]) -> list[tuple[int, tuple[float, float]]]:
    """The middles of the tags in a picture [m, world]."""
    image = cv2.imdecode(np.frombuffer(picture["jpeg"], np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    left, bottom, right, top = picture["area"]
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    corners, ids, _ = detector.detectMarkers(image)
    height, width = image.shape
    places = []
    for tag, quad in zip([] if ids is None else ids.ravel(), corners, strict=True):
        u, v = quad.reshape(4, 2).mean(axis=0) + 0.5
        places.append((int(tag), (left + u / width * (right - left), top - v / height * (top - bottom))))
    return places


def _mounted(x: float, y: float, theta: float) -> tuple[float, float]:
    """Where the tag of a robot is: the scenario's ``tag_x`` and ``tag_y``."""
    return x - 0.03 * math.cos(theta) - 0.02 * math.sin(theta), y - 0.03 * math.sin(theta) + 0.02 * math.cos(theta)


async def test_on_a_phone_nothing_overflows(browser: Browser, run: PagedRun) -> None:
    async with visit(browser, run.url, **PHONE) as opened:
        await opened.sees(run.robots)
        stop = opened.page.locator("#stop")
        for tab in TABS:
            await opened.page.locator(f"#tab-{tab}").tap()
            await opened.page.wait_for_timeout(100)
            width = await opened.page.evaluate("document.documentElement.scrollWidth")
            assert width <= 390, tab
            box = await stop.bounding_box()
            assert box is not None
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= 390
            assert box["y"] + box["height"] <= 844, "the stop button is always in sight"


VIOLATIONS = """async scheme => {
    const { body, documentElement } = document;
    const settled = () => body.dataset.link === "live" && documentElement.dataset.theme === scheme
        && document.getAnimations().length === 0;
    const found = settled() && await axe.run({resultTypes: ["violations"]});
    return found && settled() ? found.violations : null;
}"""
"""What axe finds, once nothing is faded: what is old is, and what just appears."""


async def test_axe_finds_nothing_serious(browser: Browser, run: PagedRun) -> None:
    if not AXE.exists():
        pytest.skip("no axe-core: make setup")
    async with visit(browser, run.url) as opened:
        await opened.sees(run.robots)
        await opened.page.evaluate(AXE.read_text())  # not as a script of the page, whose policy allows its own only
        await opened.page.locator("#robots button").first.click()
        await opened.page.keyboard.press("Escape")  # so that there are receipts and a way to resume
        await opened.page.locator("#card button", has_text="Stop r1").click()
        await opened.page.locator("#card .receipt.good").wait_for()
        for tab in TABS:
            await opened.page.locator(f"#tab-{tab}").click()
            for scheme in ("light", "dark"):
                await opened.page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
                serious = [
                    (violation["id"], [node["html"][:120] for node in violation["nodes"]][:3])
                    for violation in await opened.found(VIOLATIONS, scheme, f"nothing of {tab} is faded", 30.0)
                    if violation["impact"] in ("serious", "critical")
                ]
                assert serious == [], (tab, scheme)
        await opened.resume()


async def test_everything_can_be_reached_by_the_keyboard(operator: Visit) -> None:
    reached: set[str] = set()
    for _ in range(40):
        await operator.page.keyboard.press("Tab")
        reached.add(await operator.page.evaluate("document.activeElement.id || document.activeElement.textContent"))
    assert {"theme", "zoom-in", "pictures", "stop", "tab-robots"} <= reached
    await operator.page.locator("#tab-faults").wait_for()
    await operator.page.locator("#tab-robots").focus()
    for tab in TABS[1:]:
        await operator.page.keyboard.press("ArrowRight")
        assert await operator.page.locator(f"#panel-{tab}").is_visible()


async def test_a_viewer_cannot_steer_and_can_stop(browser: Browser, run: PagedRun) -> None:
    async with visit(browser, run.viewer_url) as opened:
        await opened.sees(run.robots)
        await opened.page.locator("#tab-behaviour").click()
        assert await opened.page.locator("#panel-behaviour button[type=submit]").first.is_disabled()
        assert await opened.page.locator("#panel-behaviour .fields input").first.is_disabled()
        await opened.page.locator("#tab-robots").click()
        await opened.page.locator("#robots button").first.click()
        assert await opened.page.locator("#card form.goal").count() == 0
        await opened.press_on_floor(1.5, 1.0)  # a drag of the view, no goal
        assert await opened.muro("sent") == 0
        await opened.page.keyboard.press(" ")
        await opened.page.locator("#receipt.good").wait_for()
        assert await opened.page.locator("#resume button").count() == 0
    async with visit(browser, run.url) as opened:
        await opened.sees(run.robots)
        await opened.resume()


async def test_a_page_says_when_it_may_not_read(browser: Browser, run: PagedRun) -> None:
    async with visit(browser, f"{run.viewer_url}/#token=wrong") as opened:
        await opened.page.locator("#veil", has_text="does not let this page in").wait_for()
