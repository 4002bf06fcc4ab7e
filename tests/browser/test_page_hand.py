"""A hand at the page, against a base station that the test plays: what is driven, when nothing is, and where to."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest
import pytest_asyncio
from playwright.async_api import Browser

from tests.support.browser import visit
from tests.support.played_base import NAMES, PlayedBase, There, serve
from tests.support.waiting import seconds

pytestmark = [pytest.mark.asyncio(loop_scope="package")]


@pytest_asyncio.fixture(loop_scope="package")
async def by_hand(browser: Browser) -> AsyncIterator[There]:
    """r1 is driven. Time passes for the page as a test says: on a machine that stands still the hand would be off."""
    async with visit(browser, "about:blank") as opened:
        await opened.hold_time()
        base = PlayedBase()
        await serve(opened, base)
        await opened.sees(NAMES)
        await opened.page.locator("#robots strong", has_text="r1").click()
        await opened.page.locator("#card button", has_text="Drive by hand").click()
        await opened.page.locator(".pad").wait_for()
        yield opened, base


async def passes(there: There, milliseconds: int) -> None:
    """Time passes for the page, with twenty states a second unless none are sent."""
    opened, base = there
    for _ in range(milliseconds // 50):
        if base.sends:
            base.state()
        await opened.page.clock.run_for(50)


def wish(base: PlayedBase) -> tuple[float, float]:
    """What the page wants of the robot."""
    drives = base.of("drive")
    return (drives[-1]["v"], drives[-1]["omega"]) if drives else (0.0, 0.0)


async def drives(there: There) -> None:
    _, base = there
    before = len(base.of("drive"))
    await passes(there, 300)
    await base.until(lambda: len(base.of("drive")) > before + 2 and wish(base) != (0.0, 0.0), "it drives")


async def stands(there: There) -> None:
    """It is commanded zero, and nothing after that."""
    opened, base = there
    await base.until(lambda: wish(base) == (0.0, 0.0), "it stands")
    sent = await opened.muro("sent")
    await passes(there, 300)
    assert await opened.muro("sent") == sent


async def test_a_wish_has_the_time_of_what_was_seen(by_hand: There) -> None:
    opened, base = by_hand
    await opened.page.keyboard.down("ArrowUp")
    await drives(by_hand)
    base.sends = False
    await passes(by_hand, 400)
    await stands(by_hand)  # what is shown is old: the hand is off
    base.sends = True
    await stands(by_hand)  # the key must come anew
    assert all(abs(order["t"] - base.t) < seconds(30.0) for order in base.of("drive"))
    assert len({order["t"] for order in base.of("drive")}) > 2
    # A late answer is not one to the stick.
    base.send({"kind": "reply", "id": 999, "order": "circle", "outcome": "refused", "reason": "too late"})
    assert "circle" in await opened.notice("too late")
    base.send({"kind": "reply", "id": None, "order": "", "outcome": "refused", "reason": "not an order"})
    assert "Drive" not in await opened.notice("not an order")
    base.send({"kind": "reply", "id": 0, "order": "drive", "outcome": "refused", "reason": "driven from another page"})
    assert "Drive r1" in await opened.notice("driven from another page")


async def test_a_key_whose_release_may_be_lost_drives_no_longer(by_hand: There) -> None:
    opened, _ = by_hand
    for lost in ("Meta", "Control", "Alt", "menu"):
        await opened.page.keyboard.down("ArrowUp")
        await drives(by_hand)
        if lost == "menu":
            await opened.page.evaluate("window.dispatchEvent(new MouseEvent('contextmenu', {bubbles: true}))")
        else:
            await opened.page.keyboard.down(lost)
        await stands(by_hand)
        await opened.page.keyboard.up("ArrowUp")
        if lost != "menu":
            await opened.page.keyboard.up(lost)


async def test_a_finger_on_the_stick_must_come_anew_after_the_page_lost_the_focus(by_hand: There) -> None:
    opened, _ = by_hand
    mouse, pad = opened.page.mouse, await opened.page.locator(".pad").bounding_box()
    assert pad is not None
    x, y = pad["x"] + pad["width"] / 2, pad["y"] + pad["height"] / 2
    await mouse.move(x, y)
    await mouse.down()
    await mouse.move(x, y - 40, steps=2)
    await drives(by_hand)
    await mouse.move(x, y)  # in the middle it rests, and goes on with the same finger
    await stands(by_hand)
    await mouse.move(x, y - 40, steps=2)
    await drives(by_hand)
    await opened.page.evaluate("window.dispatchEvent(new Event('blur'))")
    await mouse.move(x - 30, y - 30, steps=3)
    await stands(by_hand)
    await mouse.up()
    await mouse.down()
    await drives(by_hand)
    await mouse.up()
    await stands(by_hand)


async def test_who_is_not_shown_as_driven_is_not_driven(by_hand: There) -> None:
    opened, _ = by_hand
    await opened.page.keyboard.down("KeyW")
    await drives(by_hand)
    await opened.page.locator("#robots strong", has_text="r1").click()  # it is no longer selected
    await stands(by_hand)
    await opened.page.keyboard.up("KeyW")
    await opened.page.keyboard.down("KeyW")
    await stands(by_hand)


async def test_a_held_key_is_no_entry_in_a_field(by_hand: There) -> None:
    """It repeats; the slider of the pace that was clicked meanwhile would take that, and the robot went faster."""
    opened, base = by_hand
    keyboard, mouse = opened.page.keyboard, opened.page.mouse
    pace = opened.page.locator(".hand input[type=range]")
    box = await pace.bounding_box()
    assert box is not None
    await keyboard.down("ArrowUp")
    await drives(by_hand)
    await mouse.move(box["x"] + 0.3 * box["width"], box["y"] + box["height"] / 2)
    await mouse.down()
    chosen = await pace.input_value()
    for _ in range(8):
        await keyboard.down("ArrowUp")
    await drives(by_hand)
    assert await pace.input_value() == chosen
    assert wish(base) == pytest.approx((float(chosen) * 0.2, 0.0))
    await mouse.up()
    await keyboard.up("ArrowUp")
    await stands(by_hand)
    await keyboard.down("ArrowUp")  # the slider has given the keys back
    await drives(by_hand)
    assert await pace.input_value() == chosen
    await keyboard.up("ArrowUp")
    await stands(by_hand)


# ---- goals


async def test_a_goal_is_where_the_finger_came_down(there: There) -> None:
    """The robot is followed: the floor moves under the finger that rests."""
    opened, base = there
    await opened.page.locator("#robots strong", has_text="r1").click()
    await opened.page.locator("#card button", has_text="Follow").click()
    await opened.page.locator("#veil").wait_for(state="hidden")  # it would lie over the place
    await opened.until(
        "() => { const [x, y] = window.muro.screenAt(0, 0); return Math.abs(x - floor.clientWidth / 2) < 1 }"
    )
    x, y = await opened.pixel("screenAt(-0.4, 0.6)")
    await opened.page.mouse.move(x, y)
    await opened.page.mouse.down()
    base.places["r1"] = (0.3, 0.0)
    await opened.until(
        "() => { const [x] = window.muro.screenAt(0.3, 0); return Math.abs(x - floor.clientWidth / 2) < 1 }"
    )
    await opened.page.mouse.move(x + 2, y)
    await opened.page.mouse.up()
    await base.until(lambda: base.of("goal"), "a goal")
    (goal,) = base.of("goal")
    assert (goal["x"], goal["y"]) == pytest.approx((-0.4, 0.6), abs=0.01)
    assert goal["theta"] is None
