"""What the page says of the fleet, and of how old that is, against a base station that the test plays."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from muro_zenoh.optics.jpeg import encode_jpeg
from tests.support.browser import Visit
from tests.support.played_base import DETAILS, NAMES, There, hello, receipt

pytestmark = [pytest.mark.asyncio(loop_scope="package")]

PICTURE = encode_jpeg(np.full((20, 20), 128, np.uint8), 70)


def rows(v: float, wanted: float) -> dict[str, Any]:
    """Robots that drive at a speed, and are to drive at another [m/s]."""
    return {name: [0.5 * turn, 0.0, 0.0, v, 0.0, 0.05, wanted, 0.0] for turn, name in enumerate(NAMES)}


async def becomes(opened: Visit, expression: str, value: Any) -> None:
    """Wait until something on the page is so: a state that is late makes the page look old for a moment, or live."""
    await opened.until(f"value => JSON.stringify({expression}) === JSON.stringify(value)", argument=value)


# ---- plots


async def test_frozen_plots_stay_as_they_are_and_are_read_with_what_was_commanded(there: There) -> None:
    opened, base = there
    base.sends = False
    await opened.page.locator("#tab-plots").click()
    began = time.time()
    for k in range(30):
        base.state(t=began + 0.2 * k, robots=rows(0.3, 0.4))
    speed = opened.page.locator(".charts figure", has_text="Speed")
    await speed.locator("canvas").wait_for()
    await opened.page.locator("#panel-plots button", has_text="Freeze").click()
    for k in range(30, 60):
        base.state(t=began + 0.2 * k, robots=rows(0.1, 0.2))
    await opened.until(f"() => window.muro.state.t > {began + 11}")
    chart = speed.locator(".u-over")
    before = await chart.bounding_box()
    assert before is not None
    await chart.hover(position={"x": before["width"] - 3, "y": 20})
    assert await speed.locator(".readout span").all_inner_texts() == [f"{name} 0.30 / 0.40" for name in NAMES]
    shown = await speed.locator("time").inner_text()
    assert shown == time.strftime("%H:%M:%S", time.localtime(began + 5.8))
    assert await chart.bounding_box() == before, "it moved away from under the pointer"
    await opened.page.locator("#panel-plots label", has_text="r2").click()
    await chart.hover(position={"x": before["width"] - 4, "y": 20})
    assert await speed.locator(".readout span").all_inner_texts() == ["r1 0.30 / 0.40"]


# ---- pictures


async def test_a_picture_that_is_old_says_so_and_its_order_says_what_came_of_it(there: There) -> None:
    opened, base = there
    await opened.page.locator("#pictures").click()
    assert "refused there are no cameras" in await opened.notice("Pictures of the cameras on")
    await opened.page.locator("#pictures").click()
    base.send(hello(NAMES, cameras={"north": {"outline": []}, "south": {"outline": []}}))
    await opened.until("() => window.muro.state.t > 0")
    base.answers["picture"] = lambda order: {"outcome": "taken", "reason": ""}
    await opened.page.locator("#pictures").click()
    assert "taken" in await opened.notice("Pictures of the cameras on: taken")
    base.sends = False
    taken = base.t
    base.send({"kind": "picture", "camera": "north", "t": taken, "jpeg": PICTURE, "area": [-1.0, -1.0, 1.0, 1.0]})
    said = opened.page.locator("#silent")
    base.state(t=taken + 4.0)
    await said.filter(has_text="camera north: picture 4 s old; camera south: no picture yet").wait_for()
    await opened.page.locator("#pictures").click()
    await said.wait_for(state="hidden")


# ---- processes


async def test_only_what_says_that_it_is_well_is_green(there: There) -> None:
    opened, base = there
    report = {"role": "agent", "alive": True, "state": "x", "age": 0.5, "reasons": [], "complaints": [], "cpu": 1.0}
    report |= {"memory": 40.0, "rates": {}, "ages": {}, "drops": 0, "rejects": 0}
    rows = {
        "r1": ("alive", {}),
        "r2": ("silent", {"age": 9.0}),
        "muro": ("silent", {"age": None, "cpu": None}),
        "r3": ("dead", {"alive": False}),
        "r4": ("dead", {"alive": False, "state": "missing", "age": None}),
    }
    base.state(processes={name: {**report, **more} for name, (_, more) in rows.items()})
    await opened.page.locator("#tab-health").click()
    await opened.page.locator("#panel-health tr", has_text="r4").wait_for()
    signs = [sign for sign, _ in rows.values()]
    await becomes(opened, "[...document.querySelectorAll('.process > span')].map(sign => sign.className)", signs)
    assert await opened.page.locator(".process > span").all_inner_texts() == ["", "", "", "gone", "missing"]
    said = await opened.page.locator("#panel-health .more p:visible").all_inner_texts()
    assert said == ["it lives, and is silent", "lives; it reports nothing of itself"]


# ---- what is old


GREY = """[...document.querySelectorAll("#floor, #robots, #panel-health, #receipt")].map(
    part => getComputedStyle(part).filter.includes("grayscale"))"""


async def test_what_is_old_looks_old_everywhere(there: There) -> None:
    opened, base = there
    report = {"role": "agent", "alive": True, "state": "x", "age": 0.5, "drops": 0, "rejects": 0}
    base.answers["stop"] = lambda order: {"outcome": "taken", "reason": "", "receipt": receipt(*NAMES)}
    await opened.page.keyboard.press("Escape")
    await opened.page.locator("#receipt.good").wait_for()
    await opened.page.locator("#tab-health").click()
    base.state(processes={"r1": report, "router": {**report, "role": "router"}})
    await opened.page.locator("#panel-health .alive").nth(1).wait_for()
    await becomes(opened, GREY, [False] * 4)
    base.state(processes={"r1": report, "router": {**report, "role": "router", "alive": False}})
    await opened.page.locator("#link", has_text="Old").wait_for()
    await opened.page.locator("#veil", has_text="its router is gone").wait_for()
    base.state(processes={"r1": report})
    await opened.page.locator("#link", has_text="Live").wait_for()
    base.sends = False
    await opened.page.locator("#link", has_text="Old").wait_for()
    await becomes(opened, GREY, [True] * 4)
    await becomes(opened, "document.querySelectorAll('#panel-health .alive').length", 0)
    await becomes(opened, "document.querySelector('#panel-health td').innerText", "old")


# ---- without libraries


async def test_without_its_libraries_nothing_on_the_page_looks_alive(there: There) -> None:
    opened, _ = there
    await opened.page.route("**/vendor/*.js", lambda route: route.fulfill(body=""))
    await opened.page.reload()
    await opened.page.locator("#veil", has_text="make setup").wait_for()
    assert await opened.page.locator("#stop").is_disabled()
    assert await opened.page.locator("#stop").inner_text() == "Stop does not work here"
    assert await opened.page.locator("#link-words").inner_text() == "Not working"


# ---- little room


UNDER = """what => { const box = document.querySelector(what).getBoundingClientRect();
    return document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2).id; }"""


async def test_nothing_lies_over_the_floor_or_its_buttons(there: There) -> None:
    opened, base = there
    page = opened.page
    await page.set_viewport_size({"width": 844, "height": 390})
    await page.locator("#robots strong", has_text="r1").click()
    base.tell("r1", behaviour="circle")
    await page.locator("#hint", has_text="Click the floor").wait_for()
    hint, buttons = await page.locator("#hint").bounding_box(), await page.locator("#look").bounding_box()
    assert hint is not None
    assert buttons is not None
    assert hint["x"] + hint["width"] <= buttons["x"] or hint["y"] >= buttons["y"] + buttons["height"]
    await page.locator("#pictures").click()
    await opened.notice("there are no cameras")
    assert await page.evaluate(UNDER, ".notice") == "floor"


async def test_many_missing_robots_leave_the_tabs_in_sight_of_a_phone(there: There) -> None:
    opened, base = there
    await opened.page.set_viewport_size({"width": 390, "height": 844})
    names = [f"r{k}" for k in range(12)]
    base.send(hello(names))
    base.state(details={name: {**DETAILS, "state": "absent", "reason": "no agent is running for it"} for name in names})
    await opened.page.locator("#aside li").nth(11).wait_for()
    tabs = await opened.page.locator("#tabs").bounding_box()
    stop = await opened.page.locator("#stopping").bounding_box()
    assert tabs is not None
    assert stop is not None
    assert tabs["y"] + tabs["height"] <= stop["y"]


async def test_a_viewer_sees_why_nothing_can_be_broken_and_symbols_are_those_of_the_laws(there: There) -> None:
    opened, base = there
    number = {"type": "number", "default": 1.0}
    keys = {"k_o": "k_o", "rho_0": "rho_0", "v_min": "v_min", "turning_radius": "turning radius"}
    fault = {"doc": "", "targets": ["r1"], "parameters": dict.fromkeys(keys, number)}
    base.send(hello(NAMES, may_steer=False, simulated=True, faults={"carry": fault}))
    await opened.page.locator("#tab-faults").click()
    await opened.page.locator("#panel-faults", has_text="You may watch, and stop.").wait_for()
    assert await opened.page.locator("#panel-faults .fields span").all_inner_texts() == list(keys.values())
