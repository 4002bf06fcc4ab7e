"""What the page says of the fleet, and of how old that is, against a base station that the test plays."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator
from typing import Any

import pytest
import pytest_asyncio
from playwright.async_api import Browser

from tests.support.browser import Visit
from tests.support.played_base import NAMES, PlayedBase, played

pytestmark = [pytest.mark.asyncio(loop_scope="package")]

There = tuple[Visit, PlayedBase]


@pytest_asyncio.fixture(loop_scope="package")
async def there(browser: Browser) -> AsyncIterator[There]:
    async with played(browser) as opened:
        yield opened


def rows(v: float, wanted: float) -> dict[str, Any]:
    """Robots that drive at a speed, and are to drive at another [m/s]."""
    return {name: [0.5 * turn, 0.0, 0.0, v, 0.0, 0.05, wanted, 0.0] for turn, name in enumerate(NAMES)}


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
