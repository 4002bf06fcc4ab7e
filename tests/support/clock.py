"""A clock that tests move by hand."""

from __future__ import annotations


class ManualClock:
    """A :class:`~muro_zenoh.runtime.clock.Clock` that changes only when a test moves it.

    Args:
        start: its initial time [s].
    """

    def __init__(self, start: float = 1000.0) -> None:
        self._now = start

    def now(self) -> float:
        """Its time [s]."""
        return self._now

    def advance(self, by: float) -> None:
        """Move it forward [s]."""
        self._now += by
