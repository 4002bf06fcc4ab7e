"""Time, injected."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A clock that never goes back."""

    def now(self) -> float:
        """Seconds since 1970; within one process it only ever moves forward. Callable from any thread."""
        ...


class SystemClock:
    """The wall clock as it was at the start, plus the monotonic clock since: a step of NTP does not disturb it."""

    __slots__ = ("_offset",)

    def __init__(self) -> None:
        self._offset = time.time() - time.monotonic()

    def now(self) -> float:
        """Seconds since 1970."""
        return self._offset + time.monotonic()
