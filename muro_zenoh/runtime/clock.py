"""Time, injected."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A clock that never goes back."""

    def now(self) -> float:
        """Seconds since 1970; it never decreases within one process. Callable from any thread."""
        ...


_CLOCK = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
"""A monotonic clock; on Linux it includes the time while the machine is suspended, so ages are right afterwards."""


class SystemClock:
    """The wall clock at the start plus a monotonic clock since then, so that an NTP step does not affect it."""

    __slots__ = ("_offset",)

    def __init__(self) -> None:
        self._offset = time.time() - time.clock_gettime(_CLOCK)

    def now(self) -> float:
        """Seconds since 1970."""
        return self._offset + time.clock_gettime(_CLOCK)
