"""What the page does by itself, against a base station that the test plays: what it sends, and when nothing."""

from __future__ import annotations

import asyncio
import itertools
import mimetypes
import re
from typing import Any

import pytest
from playwright.async_api import Browser

from tests.support.browser import STATIC, Visit, visit
from tests.support.played_base import NAMES, PlayedBase, There, hello, receipt, serve
from tests.support.waiting import seconds

pytestmark = [pytest.mark.asyncio(loop_scope="package")]


async def shows_stopped(there: There, **stop: Any) -> None:
    """Wait until the page offers to resume."""
    opened, base = there
    base.stop = {"all": False, "names": [], **stop}
    await opened.page.locator("#resume button").first.wait_for()


async def focused(opened: Visit) -> str:
    return str(await opened.page.evaluate("document.activeElement.textContent"))


# ---- the floor


async def test_the_floor_does_not_move_while_the_page_opens(browser: Browser) -> None:
    """It would if robots stood aside until the first state: a click at once would be one beside the place meant."""
    async with visit(browser, "about:blank") as opened:
        await opened.page.add_init_script(
            """addEventListener("DOMContentLoaded", () => {
                const aside = document.querySelector("#aside");
                window.shown = 0;
                new MutationObserver(() => { window.shown += !aside.hidden; }).observe(aside, {attributes: true});
            });"""
        )
        base = PlayedBase()
        await serve(opened, base)
        await opened.sees(NAMES)
        await opened.page.locator("#robots .condition", has_text="driving").first.wait_for()
        assert await opened.page.evaluate("window.shown") == 0


PAINTED = """places => places.map(([x, y]) => {
    const [px, py] = window.muro.screenAt(x, y).map(Math.round);
    const pixel = new OffscreenCanvas(1, 1).getContext("2d");
    pixel.drawImage(document.querySelector("#floor"), -px, -py);
    return [...pixel.getImageData(0, 0, 1, 1).data];
})"""


async def test_walls_are_drawn_where_they_are(there: There) -> None:
    opened, base = there
    sides, doorway, beside = ((1.23, -0.9), (1.23, 0.9)), (1.23, 0.3), (1.33, 0.9)

    async def painted(*places: tuple[float, float]) -> list[list[int]]:
        """By the canvas itself: of a state that is late the page makes it grey."""
        return list(await opened.page.evaluate(PAINTED, places))

    await opened.until("() => window.muro.times.length > 0")
    (floor,) = await painted(doorway)
    assert await painted(*sides, beside) == [floor] * 3
    base.send(hello(NAMES, walls=((1.23, -1.5, 1.23, -0.4), (1.23, 0.4, 1.23, 1.5))))
    async with asyncio.timeout(seconds(5)):
        while floor in await painted(*sides):
            await opened.page.wait_for_timeout(50)
    assert await painted(doorway, beside) == [floor] * 2


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


async def test_a_page_that_cannot_show_it_sends_the_stop_all_the_same(there: There) -> None:
    opened, base = there
    shows = "Element.prototype.replaceChildren"
    await opened.page.evaluate(f"() => {{ window.shows = {shows}; {shows} = () => {{ throw new Error('broken'); }}; }}")
    async with opened.page.expect_event("pageerror"):
        await opened.page.keyboard.press("Escape")
    await base.until(lambda: base.of("stop"), "a stop")
    await opened.page.evaluate(f"() => {{ {shows} = window.shows; }}")
    opened.complaints = [text for text in opened.complaints if text != "broken"]


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
    await base.until(lambda: base.connections >= 3, "a third connection")
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
    await base.until(lambda: base.connections >= 2, "a second connection")
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
        await opened.hold_time()
        await opened.page.goto(f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}/")
        async with asyncio.timeout(seconds(10.0)):
            await asked.get()
            await opened.page.clock.run_for(2900)
            assert asked.empty()
            await opened.page.clock.fast_forward(200)
            await opened.page.clock.fast_forward(300)  # it waits a little before it tries again
            await asked.get()
        opened.complaints = [text for text in opened.complaints if "closed before the connection" not in text]
    server.close()


async def test_who_is_not_let_in_asks_less_and_less_often(browser: Browser) -> None:
    """By the page's own clock: the waits get longer, although each connection is opened before it is refused."""
    base = PlayedBase()
    base.admits = False
    asked: list[float] = []
    async with visit(browser, "about:blank") as opened:
        await opened.hold_time()
        await serve(opened, base)
        for count in range(1, 5):
            async with asyncio.timeout(seconds(10.0)):
                while base.connections < count:
                    await opened.page.clock.fast_forward(50)
            asked.append(await opened.page.evaluate("performance.now()"))
            await base._closing  # until the page knows that it is refused, its time stands still
            assert not await opened.muro("connected")
        await opened.page.clock.fast_forward(200)
        await opened.page.locator("#veil", has_text="does not let this page in").wait_for()
    waits = [after - before for before, after in itertools.pairwise(asked)]
    for wait, least in zip(waits, (200, 450, 950), strict=True):
        assert wait >= least, waits


# ---- browsers


async def test_a_browser_that_keeps_nothing_shows_the_page(there: There) -> None:
    opened, _ = there
    await opened.page.add_init_script(
        "Object.defineProperty(window, 'localStorage', {get() { throw new DOMException('blocked', 'SecurityError') }})"
    )
    await opened.page.reload()
    await opened.sees(NAMES)
    await opened.page.locator("#theme").click()
    assert await opened.page.locator("#theme").get_attribute("aria-label") == "Colours: light"


async def test_ages_are_not_read_aloud(browser: Browser) -> None:
    """A live region is read whenever it changes: what changes five times a second stands beside it."""
    async with visit(browser, "about:blank") as opened:
        await opened.hold_time()
        await serve(opened, PlayedBase())
        await opened.sees(NAMES)
        await opened.page.clock.run_for(1000)  # without another state
        await opened.page.locator("#veil").wait_for()
        await opened.page.evaluate(
            """() => {
                window.spoken = [];
                const observer = new MutationObserver(() => window.spoken.push(document.body.innerText));
                for (const region of document.querySelectorAll("[role=status], [role=alert]"))
                    observer.observe(region, {subtree: true, childList: true, characterData: true});
            }"""
        )
        ages = opened.page.locator("#link-age, #veil-age")
        before = await ages.all_inner_texts()
        await opened.page.clock.run_for(400)
        after = await ages.all_inner_texts()
        for was, has_become in zip(before, after, strict=True):
            assert re.search(r"\d s\b", was), "an age"
            assert was != has_become
        assert await opened.page.evaluate("window.spoken") == []
