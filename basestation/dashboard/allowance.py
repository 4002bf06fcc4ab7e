"""How much of something a client may send."""

from __future__ import annotations

import asyncio


class Allowance:
    """So many a second, and some more at once.

    Args:
        rate: how many [1/s].
        burst: how many at once.
    """

    def __init__(self, rate: float, burst: float) -> None:
        self._rate = rate
        self._burst = burst
        self._left = burst
        self._loop = asyncio.get_running_loop()
        self._at = self._loop.time()

    def take(self) -> bool:
        """Take one; returns whether it was allowed."""
        now = self._loop.time()
        self._left = min(self._burst, self._left + self._rate * (now - self._at)) - 1.0
        self._at = now
        return self._left >= 0.0
