"""A clock that tests move by hand."""

from __future__ import annotations


class ManualClock:
    """A :class:`~muro_zenoh.runtime.clock.Clock` that stands until it is moved.

    Args:
        start: what it says first [s].
    """

    def __init__(self, start: float = 1000.0) -> None:
        self._now = start

    def now(self) -> float:
        """What it says [s]."""
        return self._now

    def advance(self, by: float) -> None:
        """Move it forward [s]."""
        self._now += by
