"""Time, injected."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A clock that never goes back."""

    def now(self) -> float:
        """Seconds since 1970; within one process it only ever moves forward. Callable from any thread."""
        ...


_CLOCK = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
"""It only ever grows; on Linux it goes on while the machine is suspended, and so do the ages that it gives."""


class SystemClock:
    """The wall clock as it was at the start, plus a steady clock since: a step of NTP does not disturb it."""

    __slots__ = ("_offset",)

    def __init__(self) -> None:
        self._offset = time.time() - time.clock_gettime(_CLOCK)

    def now(self) -> float:
        """Seconds since 1970."""
        return self._offset + time.clock_gettime(_CLOCK)
