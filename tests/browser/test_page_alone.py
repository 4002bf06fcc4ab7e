"""What the page does by itself, against a base station that the test plays: what it sends, and when nothing."""

from __future__ import annotations

import asyncio
import mimetypes
from collections.abc import AsyncIterator
from typing import Any

import pytest
import pytest_asyncio
from playwright.async_api import Browser

from tests.support.browser import STATIC, Visit, visit
from tests.support.played_base import NAMES, PlayedBase, played, receipt
from tests.support.waiting import seconds

pytestmark = [pytest.mark.asyncio(loop_scope="package")]

There = tuple[Visit, PlayedBase]


@pytest_asyncio.fixture(loop_scope="package")
async def there(browser: Browser) -> AsyncIterator[There]:
    async with played(browser) as opened:
        yield opened


async def shows_stopped(there: There, **stop: Any) -> None:
    """Wait until the page offers to resume."""
    opened, base = there
    base.stop = {"all": False, "names": [], **stop}
    await opened.page.locator("#resume button").first.wait_for()


async def focused(opened: Visit) -> str:
    return str(await opened.page.evaluate("document.activeElement.textContent"))


# ---- resume


async def test_a_held_enter_does_not_resume(there: There) -> None:
    opened, base = there
    await shows_stopped(there, all=True, revision=5)
    await opened.page.locator("#resume button").focus()
    for _ in range(5):  # a key that is held repeats
        await opened.page.keyboard.down("Enter")
    await opened.page.keyboard.up("Enter")
    assert await focused(opened) == "No"
    assert base.of("resume") == []


async def test_a_resume_has_the_stop_that_was_shown_and_is_asked_again_when_there_is_another(there: There) -> None:
    opened, base = there
    refuse = {"outcome": "refused", "reason": "an order came in between"}
    base.answers["resume"] = lambda order: None if order["revision"] == base.stop["revision"] else refuse
    await shows_stopped(there, all=True, revision=5)
    await opened.page.locator("#resume button", has_text="Resume").click()
    base.stop = {**base.stop, "revision": 6}
    await opened.until("() => window.muro.state.stop.revision === 6")
    await opened.page.locator("#resume button", has_text="Yes").click()
    await opened.page.locator("#resume", has_text="Somebody has stopped since").wait_for()
    assert [order["revision"] for order in base.of("resume")] == [5]
    assert await focused(opened) == "No"
    await opened.page.locator("#resume button", has_text="Yes").click()
    await base.until(lambda: len(base.of("resume")) == 2, "a second order")
    assert base.of("resume")[1]["revision"] == 6


async def test_to_resume_one_robot_is_asked_too(there: There) -> None:
    opened, base = there
    await shows_stopped(there, names=["r1"], revision=3)
    await opened.page.locator("#robots strong", has_text="r1").click()
    await opened.page.locator("#card button", has_text="Resume r1").click()
    assert await focused(opened) == "No"
    assert base.of("resume") == []
    await opened.page.locator("#card button", has_text="Yes").click()
    await base.until(lambda: base.of("resume"), "an order")
    assert (base.of("resume")[0]["names"], base.of("resume")[0]["revision"]) == (["r1"], 3)


# ---- receipts


async def test_a_stop_of_one_robot_that_fails_does_not_look_like_a_success(there: There) -> None:
    opened, base = there
    base.answers["stop"] = lambda order: {
        "outcome": "taken",
        "reason": "",
        "receipt": receipt(*order["names"], status="not alive"),
    }
    await opened.page.locator("#robots strong", has_text="r1").click()
    await opened.page.locator("#card button", has_text="Stop r1").click()
    bad = opened.page.locator("#card .receipt.bad")
    await bad.wait_for()
    assert "0 of 1 robot confirmed" in await bad.inner_text()
    base.answers["stop"] = lambda order: {"outcome": "taken", "reason": "", "receipt": receipt(*order["names"])}
    await opened.page.locator("#card button", has_text="Stop r1").click()
    await opened.page.locator("#card .receipt.good", has_text="1 robot stands still").wait_for()
    base.stop = {"all": False, "names": ["r1"], "revision": 2}  # the card is made anew, and keeps the receipt
    await opened.page.locator("#card button", has_text="Resume r1").wait_for()
    assert await opened.page.locator("#card .receipt.good").count() == 1


# ---- connections that are dead


async def test_a_stop_on_a_dead_connection_is_sent_again_on_the_next(there: There) -> None:
    """The press went into a connection that nobody reads any more, and the page could not know."""
    opened, base = there
    base.answers["stop"] = lambda order: None
    await opened.page.keyboard.press("Escape")
    await base.until(lambda: base.of("stop"), "a stop")
    base.answers["stop"] = lambda order: {"outcome": "taken", "reason": "", "receipt": receipt(*NAMES)}
    await base.cut()
    await base.until(lambda: len(base.of("stop")) == 2, "the stop again")
    await opened.page.locator("#receipt.good", has_text="2 robots stand still").wait_for()
    await base.cut()
    await base.until(lambda: base.connections == 3, "a third connection")
    await opened.page.locator("#link", has_text="Live").wait_for()
    assert len(base.of("stop")) == 2, "it was confirmed, and is owed no longer"


async def test_who_resumes_is_owed_no_stop(there: There) -> None:
    opened, base = there
    base.answers["stop"] = lambda order: {"outcome": "unanswered", "reason": "resumed before every robot had confirmed"}
    await opened.page.keyboard.press("Escape")
    await opened.page.locator("#receipt.bad", has_text="not answered").wait_for()
    await shows_stopped(there, all=True, revision=5)
    await opened.page.locator("#resume button", has_text="Resume").click()
    await opened.page.locator("#resume button", has_text="Yes").click()
    await base.until(lambda: base.of("resume"), "an order")
    await base.cut()
    await base.until(lambda: base.connections == 2, "a second connection")
    await opened.page.locator("#link", has_text="Live").wait_for()
    assert len(base.of("stop")) == 1


async def test_a_connection_that_is_never_opened_is_given_up(browser: Browser) -> None:
    """Somebody accepts it and says nothing: a browser alone would wait for minutes."""
    asked = asyncio.Queue[None]()

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """A web server that has the files, and opens no WebSocket."""
        path = (await reader.readline()).decode().partition(" ")[2].partition(" ")[0]
        if path == "/ws":
            asked.put_nowait(None)
            await reader.read()
        elif path:
            file = STATIC / (path.removeprefix("/") or "index.html")
            kind = mimetypes.guess_type(file.name)[0]
            head = f"HTTP/1.1 200 OK\r\nContent-Type: {kind}\r\nConnection: close\r\n\r\n"
            writer.write(head.encode() + await asyncio.to_thread(file.read_bytes))
            await writer.drain()
        writer.close()

    server = await asyncio.start_server(accept, "127.0.0.1", 0)
    async with visit(browser, "about:blank") as opened:
        await opened.page.clock.install()
        await opened.page.goto(f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}/")
        async with asyncio.timeout(seconds(10.0)):
            await asked.get()
            await opened.page.clock.fast_forward(2900)
            assert asked.empty()
            await opened.page.clock.fast_forward(200)
            await opened.page.clock.fast_forward(300)  # it waits a little before it tries again
            await asked.get()
        opened.complaints.clear()  # the browser says itself that it could not connect
    server.close()


# ---- driving by hand


@pytest_asyncio.fixture(loop_scope="package")
async def by_hand(there: There) -> There:
    """r1 is driven."""
    opened, _ = there
    await opened.page.locator("#robots strong", has_text="r1").click()
    await opened.page.locator("#card button", has_text="Drive by hand").click()
    await opened.page.locator(".pad").wait_for()
    return there


def wish(base: PlayedBase) -> tuple[float, float]:
    """What the page wants of the robot."""
    drives = base.of("drive")
    return (drives[-1]["v"], drives[-1]["omega"]) if drives else (0.0, 0.0)


async def drives(base: PlayedBase) -> None:
    before = len(base.of("drive"))
    await base.until(lambda: len(base.of("drive")) > before + 2 and wish(base) != (0.0, 0.0), "it drives")


async def stands(base: PlayedBase) -> None:
    """It is commanded zero, and nothing after that."""
    await base.until(lambda: wish(base) == (0.0, 0.0), "it stands")
    sent = len(base.of("drive"))
    await asyncio.sleep(0.25)
    assert len(base.of("drive")) == sent


async def test_a_wish_has_the_time_of_what_was_seen(by_hand: There) -> None:
    opened, base = by_hand
    await opened.page.keyboard.down("ArrowUp")
    await drives(base)
    base.sends = False
    await stands(base)  # what is shown is old: the hand is off
    base.sends = True
    await asyncio.sleep(0.3)
    assert wish(base) == (0.0, 0.0), "the key must come anew"
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
    opened, base = by_hand
    for lost in ("Meta", "Control", "Alt", "menu"):
        await opened.page.keyboard.down("ArrowUp")
        await drives(base)
        if lost == "menu":
            await opened.page.evaluate("window.dispatchEvent(new MouseEvent('contextmenu', {bubbles: true}))")
        else:
            await opened.page.keyboard.down(lost)
        await stands(base)
        await opened.page.keyboard.up("ArrowUp")
        if lost != "menu":
            await opened.page.keyboard.up(lost)


async def test_a_finger_on_the_stick_must_come_anew_after_the_page_lost_the_focus(by_hand: There) -> None:
    opened, base = by_hand
    mouse, pad = opened.page.mouse, await opened.page.locator(".pad").bounding_box()
    assert pad is not None
    x, y = pad["x"] + pad["width"] / 2, pad["y"] + pad["height"] / 2
    await mouse.move(x, y)
    await mouse.down()
    await mouse.move(x, y - 40, steps=2)
    await drives(base)
    await mouse.move(x, y)  # in the middle it rests, and goes on with the same finger
    await stands(base)
    await mouse.move(x, y - 40, steps=2)
    await drives(base)
    await opened.page.evaluate("window.dispatchEvent(new Event('blur'))")
    await mouse.move(x - 30, y - 30, steps=3)
    await stands(base)
    await mouse.up()
    await mouse.down()
    await drives(base)
    await mouse.up()
    await stands(base)


async def test_who_is_not_shown_as_driven_is_not_driven(by_hand: There) -> None:
    opened, base = by_hand
    await opened.page.keyboard.down("KeyW")
    await drives(base)
    await opened.page.locator("#robots strong", has_text="r1").click()  # it is no longer selected
    await stands(base)
    await opened.page.keyboard.up("KeyW")
    await opened.page.keyboard.down("KeyW")
    await asyncio.sleep(0.25)
    assert wish(base) == (0.0, 0.0)
