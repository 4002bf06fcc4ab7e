"""Time, injected."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A clock that never goes back."""

    def now(self) -> float:
        """Seconds since 1970; within one process it only ever moves forward. Callable from any thread."""
        ...


def _steady() -> float:
    """Seconds that only ever grow; on Linux they go on while the machine is suspended, and so do the ages they give."""
    return time.clock_gettime(_CLOCK)


_CLOCK = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)


class SystemClock:
    """The wall clock as it was at the start, plus a steady clock since: a step of NTP does not disturb it."""

    __slots__ = ("_offset",)

    def __init__(self) -> None:
        self._offset = time.time() - _steady()

    def now(self) -> float:
        """Seconds since 1970."""
        return self._offset + _steady()
