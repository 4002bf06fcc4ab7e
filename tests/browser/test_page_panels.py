"""The panels of the page, against a base station that the test plays: what they show, and what they order."""

from __future__ import annotations

import math

import pytest
from playwright.async_api import Locator

from tests.support.browser import Visit
from tests.support.played_base import PlayedBase, Row, There

pytestmark = [pytest.mark.asyncio(loop_scope="package")]

CIRCLE: Row = {"x": 0.0, "y": 0.0, "radius": 0.8, "clockwise": False, "revision": 1, "importance": None}


async def forms(opened: Visit) -> tuple[Locator, Locator]:
    """The form of the behaviour and that of the circle."""
    await opened.page.locator("#tab-behaviour").click()
    both = opened.page.locator("#panel-behaviour form")
    return both.nth(0), both.nth(1)


async def has(opened: Visit, field: Locator, value: str) -> None:
    """Wait until a field has a value."""
    await opened.until("([field, value]) => field.value === value", 10.0, [await field.element_handle(), value])


def runs(base: PlayedBase, **speeds: float | None) -> None:
    """Robots run `circle` with these speeds of their own."""
    for name, speed in speeds.items():
        base.tell(name, behaviour="circle", parameters={} if speed is None else {"speed": speed})


async def test_a_card_has_what_the_agent_complains_of(there: There) -> None:
    opened, base = there
    await opened.page.locator("#robots strong", has_text="r1").click()
    base.tell("r1", complaints=["a drive is not followed: another program's came first"])
    await opened.page.locator("#card dd", has_text="a drive is not followed").wait_for()


# ---- behaviours


async def test_a_change_for_all_does_not_level_what_robots_have_of_their_own(there: There) -> None:
    opened, base = there
    form, _ = await forms(opened)
    runs(base, r1=0.1, r2=0.15)
    await form.locator("select[name=behaviour]").select_option("circle")
    await form.get_by_text("different parameters").wait_for()
    field, button = form.locator("input[name=speed]"), form.locator("button[type=submit]")
    await has(opened, field, "0.1")
    await field.fill("0.12")
    await field.press("Tab")
    runs(base, r1=0.1, r2=0.1)
    await form.get_by_text("changes apply at once").wait_for()
    assert base.of("behaviour") == [], "nobody has pressed the button"
    assert await button.is_hidden()
    await field.fill("0.13")
    await field.press("Enter")  # an entry, and no press of the button besides
    await base.until(lambda: base.of("behaviour"), "an order")
    runs(base, r1=0.1, r2=0.15)
    await field.fill("0.12")
    await button.click()
    await base.until(lambda: len(base.of("behaviour")) == 2, "another")
    assert [order["parameters"] for order in base.of("behaviour")] == [{"speed": 0.13}, {"speed": 0.12}]
    assert {tuple(order["names"]) for order in base.of("behaviour")} == {()}


async def test_a_behaviour_is_started_anew_only_where_it_failed(there: There) -> None:
    """Robots pass over the same order again while it runs."""
    opened, base = there
    form, _ = await forms(opened)
    runs(base, r1=None, r2=None)
    await form.locator("select[name=behaviour]").select_option("circle")
    await form.get_by_text("changes apply at once").wait_for()
    button = form.locator("button[type=submit]")
    assert await button.is_hidden()
    base.tell("r1", behaviour="circle", state="failed", reason="behaviour circle: it raised")
    await form.locator("button", has_text="Start anew").click()
    await base.until(lambda: base.of("behaviour"), "an order")


# ---- the circle


async def test_the_circle_that_is_in_force_is_shown_after_it_was_set(there: There) -> None:
    opened, base = there
    _, form = await forms(opened)
    base.state(circle=CIRCLE)
    radius, button = form.locator("input[name=radius]"), form.locator("button[type=submit]")
    await has(opened, radius, "0.8")
    base.answers["circle"] = lambda order: {"outcome": "refused", "reason": "too large"}
    await radius.fill("9")
    await button.click()
    assert "refused" in await opened.notice("too large")
    await has(opened, radius, "0.8")
    await radius.fill("9")
    await button.focus()
    base.stop = {"all": True, "names": [], "revision": 2}
    base.state(circle={**CIRCLE, "radius": 0.7, "revision": 2})  # by somebody else, in the middle of it
    await opened.page.locator("#resume button").wait_for()  # the page shows that state
    assert await radius.input_value() == "9"
    await button.press("Enter")
    await has(opened, radius, "0.7")
    base.state(circle={**CIRCLE, "radius": 0.6, "revision": 3})
    await has(opened, radius, "0.6")
    assert await button.evaluate("button => button === document.activeElement")


# ---- the floor


async def test_a_goal_is_drawn_at_the_end_of_a_path_whoever_gave_it(there: There) -> None:
    opened, base = there
    is_ring = """([x, y]) => {
        const [px, py] = window.muro.screenAt(x, y);
        const pixel = new OffscreenCanvas(1, 1).getContext("2d");
        pixel.drawImage(document.querySelector("#floor"), -px, 7 - py);
        const [red, , blue] = pixel.getImageData(0, 0, 1, 1).data;
        return blue - red > 50;
    }"""  # above its middle
    assert not await opened.page.evaluate(is_ring, [-1.0, -0.6])
    base.tell("r1", path={"x": 0.2, "y": -0.6, "theta": math.pi, "segments": [(1.0, 0.0), (0.2, 0.0)]})
    await opened.until(is_ring, argument=[-1.0, -0.6])
    assert not await opened.page.evaluate(is_ring, [-0.8, -0.6]), "the path itself"
