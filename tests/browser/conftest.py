"""One browser and one run of real processes for all tests: what the page is tried against."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest
import pytest_asyncio
from playwright.async_api import Browser

from tests.support.browser import PagedRun, Visit, browser_missing, chromium, paged_run, visit
from tests.support.played_base import There, played


@pytest_asyncio.fixture(scope="package", loop_scope="package")
async def browser() -> AsyncIterator[Browser]:
    """Debian's chromium."""
    if missing := browser_missing():
        pytest.skip(missing)
    async with chromium() as opened:
        yield opened


@pytest_asyncio.fixture(scope="package", loop_scope="package")
async def run(tmp_path_factory: pytest.TempPathFactory, browser: Browser) -> AsyncIterator[PagedRun]:
    """``muro run pursuit`` with three robots. Pulled in by the browser: without one there is nothing to start."""
    async with paged_run(tmp_path_factory.mktemp("run"), "pursuit", robots=3) as started:
        yield started


@pytest_asyncio.fixture(loop_scope="package")
async def operator(browser: Browser, run: PagedRun) -> AsyncIterator[Visit]:
    """The page of somebody who may steer, with every robot in it."""
    async with visit(browser, run.url) as opened:
        await opened.sees(run.robots)
        yield opened


@pytest_asyncio.fixture(loop_scope="package")
async def there(browser: Browser) -> AsyncIterator[There]:
    """A page, and the base station that the test plays for it."""
    async with played(browser) as opened:
        yield opened
