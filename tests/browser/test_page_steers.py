"""What is ordered from the page, against a real ``muro run pursuit`` with real processes, judged by the truth."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import math
import random
import signal
import time
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any

import pytest
from playwright.async_api import Browser
from playwright.async_api import TimeoutError as NotInTime

from tests.support.browser import AGAIN, PagedRun, Visit, visit
from tests.support.silent_link import SilentLink
from tests.support.waiting import seconds

pytestmark = [pytest.mark.asyncio(loop_scope="package"), pytest.mark.slow]

STOPPED_WITHIN = 1.0
"""From the press of the button to wheels at rest [s]: from the fastest speed braking alone takes 0.7 s.
benchmarks/page.py holds fifty presses at 0.2 m/s to half a second."""

LET_GO_WITHIN = 0.3
"""From the loss of the hand to a base that is commanded zero [s]; the wheels then take their time to brake."""

BRAKING = 0.35


async def test_a_click_on_the_floor_drives_a_robot_there(operator: Visit, run: PagedRun) -> None:
    """Its behaviour takes no goals: the refusal says so, and offers one that does."""
    page = operator.page
    await page.locator("#robots strong", has_text="r1").click()
    before = run.truth("r1")
    ahead = math.atan2(before.y, before.x) + 0.5  # a little on, and off the circle: others pass there
    x, y = 1.4 * math.cos(ahead), 1.15 * math.sin(ahead)
    words = await operator.order("r1 to", lambda: operator.press_on_floor(x, y))
    assert "refused" in words
    assert "takes no goals" in words
    await page.locator("#notices button", has_text="Run dubins on r1").first.click()
    taken = page.locator("#notices .taken", has_text="r1 to")
    lost = page.locator("#notices .notice:not([data-read])", has_text=AGAIN)
    await taken.or_(lost).first.wait_for()
    if await lost.count():  # on a busy machine: then one after the other
        await start(operator, "r1", "dubins")
        assert "taken" in await operator.order("r1 to", lambda: operator.press_on_floor(x, y))
    away = lambda: math.hypot(run.truth("r1").x - x, run.truth("r1").y - y)  # noqa: E731
    await run.time_until(lambda: away() < 0.1, 30.0, f"r1 at its goal ({x:.2f}, {y:.2f})")
    px, py = await operator.pixel("screenAt(-1.3, -0.9)")
    # A drag says the heading.
    assert "taken" in await operator.order("heading 0°", lambda: drag(operator, (px, py), (px + 60, py)))
    await start(operator, "r1", "pursuit")


async def test_behaviours_and_the_circle_are_changed_live(operator: Visit, run: PagedRun) -> None:
    page = operator.page
    await start(operator, "", "circle")
    await page.locator("#tab-behaviour").click()
    field = page.locator("#panel-behaviour .fields input[name=speed]")
    speeds = itertools.count(0.1, 0.001)  # the same again would be no change

    async def enter() -> None:
        await field.fill(f"{next(speeds):.3f}")
        await field.press("Tab")

    # Running already: it applies at once.
    assert "taken" in await operator.order("All robots: circle", enter)
    await operator.until(
        "() => Object.values(window.muro.state.robots).every(row => Math.abs(row[3] - 0.1) < 0.04)", 15
    )
    await field.fill("-1")
    await field.press("Tab")
    assert await field.evaluate("field => !field.checkValidity()"), "outside its limits"
    form = page.locator("#panel-behaviour form").nth(1)

    async def enlarge() -> None:
        await form.locator("input[name=radius]").fill("9")
        await form.locator("button[type=submit]").click()

    assert "at most" in await operator.order("Circle of 9 m", enlarge)

    async def move() -> None:
        """By hand: the handles are where the circle is."""
        await form.locator("button", has_text="Move on the floor").click()
        x, y = [float(await form.locator(f"input[name={axis}]").input_value()) for axis in "xy"]
        middle, beside = f"screenAt({x}, {y})", f"screenAt({x + 0.2}, {y + 0.1})"
        await drag(operator, await operator.pixel(middle), await operator.pixel(beside))
        await form.locator("button", has_text="Done").click()

    assert "taken" in await operator.order("Circle of 0.8 m at (0.", move)
    await start(operator, "", "pursuit")


async def test_stop_all_stops_all_wheels_at_once(operator: Visit, run: PagedRun) -> None:
    """At random moments, by the button and by either key, pressed twice; benchmarks/page.py: 50 times."""
    chance = random.Random(1)
    await operator.note_stops()
    for way in ("#stop", " ", "Escape"):
        took = await run.stop_all(operator, way, chance.uniform(0.1, 0.8))
        if took >= seconds(STOPPED_WITHIN):  # the machine stood still, or something is slow: then it is so again
            took = await run.stop_all(operator, way, chance.uniform(0.1, 0.8))
        in_time([took], STOPPED_WITHIN)


async def test_the_space_bar_stops_wherever_the_focus_is(operator: Visit, run: PagedRun) -> None:
    page = operator.page
    await page.locator("#tab-behaviour").click()
    for focused in (
        "#theme",
        "#panel-behaviour select[name=behaviour]",
        ".fields input",
    ):
        await run.time_until(lambda: len(run.moving()) == len(run.robots), 10.0, "all robots drive")
        theme = await page.locator("#theme").get_attribute("aria-label")
        await page.locator(focused).first.focus()
        await page.keyboard.press(" ")
        await run.time_until(lambda: not run.moving(), 5.0, f"all stand; the focus was on {focused}")
        assert await page.locator("#theme").get_attribute("aria-label") == theme, "it presses no button"
        await page.locator("#receipt.good").wait_for()
        await operator.resume()


async def test_a_receipt_names_who_does_not_answer(operator: Visit, run: PagedRun) -> None:
    agent = run.child("agent", "r2")
    agent.send_signal(signal.SIGSTOP)
    try:
        for _ in range(3):  # others are silent too while the machine stands still
            await operator.page.keyboard.press("Escape")
            missing = operator.page.locator("#receipt.bad .missing li", has_text="r2")
            await missing.wait_for(timeout=1000 * seconds(8))
            if "2 of 3 robots confirmed" in (words := await operator.page.locator("#receipt").inner_text()):
                break
        assert "2 of 3 robots confirmed" in words
    finally:
        agent.send_signal(signal.SIGCONT)
    await operator.resume()


async def test_an_idle_page_sends_nothing(operator: Visit, run: PagedRun) -> None:
    """For two seconds here, and for a minute in benchmarks/page.py."""
    await operator.page.locator("#tab-plots").click()
    await operator.page.mouse.move(300, 300)
    await operator.page.wait_for_timeout(2000)
    assert await operator.muro("sent") == 0


async def test_a_held_key_and_a_lost_hand_give_zero_wheels(browser: Browser, run: PagedRun) -> None:
    """The focus goes, the tab is hidden, nothing passes any more, the page is closed: each with the key still held."""
    link = SilentLink()
    losses: dict[str, Callable[[Visit], Awaitable[Any]]] = {
        "blur": lambda opened: opened.page.evaluate("window.dispatchEvent(new Event('blur'))"),
        "hidden": lambda opened: opened.page.evaluate(
            "Object.defineProperty(document, 'hidden', {value: true, configurable: true});"
            "document.dispatchEvent(new Event('visibilitychange'))"
        ),
        "silent": lambda opened: link.cut(),
        "closed": lambda opened: opened.page.close(),
    }
    took = []
    async with visit(browser, "about:blank") as opened:
        await opened.page.route_web_socket("**/ws", link.connected)
        await opened.page.goto(run.url)
        await opened.sees(run.robots)
        await by_hand(opened, "r3")
        keyboard = opened.page.keyboard
        for turn, (loss, lose) in enumerate(losses.items()):
            key = ("ArrowLeft", "ArrowRight")[turn % 2]
            await hold(run, partial(keyboard.down, key), partial(keyboard.up, key), 0.3)
            lost = time.time()
            await lose(opened)
            await run.time_until(lambda: "r3" not in run.moving(), 5.0, f"r3 stands: {loss}")
            took.append(run.at_rest_since("r3") - lost)
            if loss != "closed":
                await opened.page.keyboard.down(key)  # as a held key repeats
            await asyncio.sleep(0.3)
            assert "r3" not in run.moving(), f"and it goes on standing: {loss}"
            if loss != "closed":
                link.mend()
                await opened.page.keyboard.up(key)
                await opened.page.locator("#link", has_text="Live").wait_for()
    in_time(took, LET_GO_WITHIN + BRAKING)
    async with visit(browser, run.url) as opened:
        await opened.sees(run.robots)
        await start(opened, "r3", "pursuit")


async def test_a_hand_drives_a_robot_and_the_stop_is_above_it(operator: Visit, run: PagedRun) -> None:
    page = operator.page
    await by_hand(operator, "r3")
    pad = await page.locator(".pad").bounding_box()
    assert pad is not None
    x, y = pad["x"] + pad["width"] / 2, pad["y"] + pad["height"] / 2

    async def push() -> None:
        await page.mouse.move(x, y)
        await page.mouse.down()
        await page.mouse.move(x - 70, y, steps=3)

    await hold(run, push, page.mouse.up, 0.2)
    assert run.truth("r3").omega > 0, "to the left"
    await page.keyboard.press("Escape")
    await run.time_until(lambda: not run.moving(), 5.0, "all stand, with the stick still held")
    await asyncio.sleep(0.3)
    assert not run.moving()
    await page.locator("#receipt.good").wait_for()
    await operator.resume()
    await run.time_until(lambda: "r1" in run.moving(), 10.0, "the others drive again")
    await asyncio.sleep(0.3)
    assert "r3" not in run.moving(), "it was let go by the stop: the hand must come anew"
    await page.mouse.up()
    await start(operator, "r3", "pursuit")


async def test_what_is_broken_by_hand_shows_and_is_kept_for_a_scenario(operator: Visit, run: PagedRun) -> None:
    page = operator.page
    await page.locator("#tab-faults").click()
    form = page.locator("#panel-faults form")
    await form.locator("select[name=kind]").select_option("crash")
    await form.locator("select[name=target]").select_option("r2/agent")
    await form.locator("input[name=duration]").fill("1.5")
    assert "taken" in await operator.order("Break r2/agent: crash", form.locator("button[type=submit]").click)
    await page.locator("#aside li", has_text="r2").wait_for()
    rows = page.locator("#panel-faults pre", has_text='kind = "crash"')
    await rows.filter(has_text='target = "r2/agent"').wait_for()
    await page.locator("#aside li", has_text="r2").wait_for(state="hidden", timeout=1000 * seconds(10))
    async with page.expect_download() as saving:
        await page.locator("#panel-faults button", has_text="Save").click()
    assert (await saving.value).suggested_filename == "faults.toml"


async def test_a_killed_base_station_shows_and_comes_back(operator: Visit, run: PagedRun) -> None:
    run.child("basestation").kill()
    link = operator.page.locator("#link")
    await link.get_by_text("Disconnected").wait_for(timeout=1000 * seconds(5))
    assert "was seen last" in await operator.page.locator("#veil").inner_text()
    await operator.page.keyboard.press("Escape")
    assert "Not connected" in await operator.page.locator("#receipt").inner_text()
    await link.get_by_text("Live").wait_for(timeout=1000 * seconds(15))
    # The stop that was owed is given, and confirmed.
    await operator.page.locator("#receipt.good").wait_for(timeout=1000 * seconds(8))
    await operator.page.locator("#veil").wait_for(state="hidden")
    operator.forgive_no_connection()
    await operator.resume()


def in_time(took: list[float], limit: float) -> None:
    """Each of these times is within a limit. They are stamps of the browser and of the simulator, without this test's
    own delays; the limit is scaled all the same, because between the two are five processes that a busy machine keeps
    waiting."""
    assert max(took) < seconds(limit), took


# ---- what a person does


async def start(opened: Visit, name: str, behaviour: str) -> None:
    """Start a behaviour with the parameters that it has by default, on one robot or all."""
    await opened.page.locator("#tab-behaviour").click()
    form = opened.page.locator("#panel-behaviour form").first
    await form.locator("select[name=who]").select_option(name)
    await form.locator("select[name=behaviour]").select_option(behaviour)
    button = form.locator("button[type=submit]")
    running = "() => document.querySelector('#panel-behaviour button[type=submit]').hidden"
    if await button.is_visible():
        words = f"{name or 'All robots'}: {behaviour}"
        assert "refused" not in await opened.order(words, button.click, running)
    await opened.page.locator("#tab-robots").click()


async def by_hand(opened: Visit, name: str) -> None:
    """Take a robot by the hand: again when the behaviour that obeys one did not start in time."""
    await opened.page.locator("#robots strong", has_text=name).click()
    for _ in range(3):
        await opened.page.locator("#card button", has_text="Drive by hand").click()
        with contextlib.suppress(NotInTime):
            return await opened.page.locator(".pad").wait_for(timeout=1000 * seconds(5))
    raise AssertionError(f"{name} cannot be driven by hand: {await opened.words()}")


async def hold(
    run: PagedRun, down: Callable[[], Awaitable[Any]], up: Callable[[], Awaitable[Any]], omega: float
) -> None:
    """Hold a key or the stick until r3 turns faster than this [rad/s]: anew when it does not, for a page that has heard
    nothing for 0.3 s takes the hand off."""
    for _ in range(5):
        await down()
        with contextlib.suppress(AssertionError):
            await run.time_until(lambda: abs(run.truth("r3").omega) > omega, 1.5, "r3 turns")
            return
        await up()
    raise AssertionError("r3 does not turn, although it was taken by the hand five times")


async def drag(opened: Visit, begin: tuple[float, float], end: tuple[float, float]) -> None:
    """Press at a pixel of the window, and release at another."""
    mouse = opened.page.mouse
    await mouse.move(*begin)
    await mouse.down()
    await mouse.move(*end, steps=3)
    await mouse.up()
