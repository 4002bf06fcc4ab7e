"""Waits of the tests, scaled by one factor: ``MURO_TEST_TIMEOUT_FACTOR`` (for example 3 on a slow machine)."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Awaitable, Callable
from typing import Final, TypeVar

T = TypeVar("T")

FACTOR: Final = float(os.environ.get("MURO_TEST_TIMEOUT_FACTOR", "1"))


SETTLING: Final = 0.6
"""A process refuses orders for so long after it has stood still [s]."""


def seconds(value: float) -> float:
    """A time limit, scaled."""
    return value * FACTOR


async def given_again(give: Callable[[], Awaitable[T]], reason: Callable[[T], str]) -> T:
    """The answer to an order; it is given again while its receiver says that it had just stood still, as any may.

    Args:
        give: gives the order, and waits for the answer.
        reason: of an answer.
    """
    for _ in range(5):
        answer = await give()
        if "give it again" not in reason(answer):
            break
        await asyncio.sleep(SETTLING)
    return answer


async def within(limit: float, awaitable: Awaitable[T], what: str) -> T:
    """The result of ``awaitable``; fails with ``what`` when it takes longer than ``limit`` (scaled) [s]."""
    try:
        async with asyncio.timeout(seconds(limit)):
            return await awaitable
    except TimeoutError:
        raise AssertionError(f"{what}: nothing within {seconds(limit):g} s") from None
