"""Pictures of the page for docs/images, from real runs: ``make screenshots``."""

from __future__ import annotations

import asyncio
import sys
import tempfile
from pathlib import Path

from playwright.async_api import Browser

from tests.support.browser import Visit, browser_missing, chromium, paged_run, visit

IMAGES = Path(__file__).parents[1] / "docs" / "images"

DESKTOP = {"viewport": {"width": 1440, "height": 900}}
PHONE = {"viewport": {"width": 390, "height": 844}, "device_scale_factor": 2, "has_touch": True, "is_mobile": True}


async def steering(browser: Browser, folder: Path) -> None:
    """Six robots; one of them was sent to a goal."""
    async with paged_run(folder, "pursuit", robots=6) as run, visit(browser, run.url, **DESKTOP) as opened:
        await opened.sees(run.robots)
        await asyncio.sleep(9.0)
        await opened.page.locator("#robots strong", has_text="r2").click()
        x, y = await opened.pixel("screenAt(1.45, -0.95)")
        await opened.page.mouse.move(x, y)
        await opened.page.mouse.down()
        await opened.page.mouse.move(x + 50, y - 50, steps=3)
        await opened.page.mouse.up()
        await opened.page.locator("#notices button").click()
        await opened.notice("heading 45°: taken")
        await asyncio.sleep(2.5)
        await shoot(opened, "page")


async def dark(browser: Browser, folder: Path) -> None:
    """Robots that stay longer where it is more important, and the plots."""
    scheme = {**DESKTOP, "color_scheme": "dark"}
    async with paged_run(folder, "importance", robots=5) as run, visit(browser, run.url, **scheme) as opened:
        await opened.sees(run.robots)
        await opened.page.locator("#tab-plots").click()
        await asyncio.sleep(60.0)
        await shoot(opened, "page_dark")


async def phone(browser: Browser, folder: Path) -> None:
    """Somebody stopped all."""
    async with paged_run(folder, "pursuit", robots=4) as run, visit(browser, run.url, **PHONE) as opened:
        await opened.sees(run.robots)
        await asyncio.sleep(7.0)
        await opened.page.locator("#stop").tap()
        await opened.page.locator("#receipt.good").wait_for()
        await asyncio.sleep(0.5)
        await shoot(opened, "page_phone")


async def shoot(opened: Visit, name: str) -> None:
    """Take a picture."""
    await opened.page.screenshot(path=IMAGES / f"{name}.png")
    print(IMAGES / f"{name}.png")


async def main() -> None:
    """Take all pictures."""
    async with chromium() as browser:
        for scene in (steering, dark, phone):
            with tempfile.TemporaryDirectory() as folder:
                await scene(browser, Path(folder))


if __name__ == "__main__":
    if missing := browser_missing():
        sys.exit(missing)
    asyncio.run(main())
