"""The stop latch: whether a robot may drive, from the stop orders that it heard."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

MOST_REVISION: Final = 2**53
"""Whoever says a greater one is not believed: whole numbers above it are not exact in every language, and no count of
orders reaches it. Believed, nothing could ever lift the next stop."""


@dataclass(frozen=True, slots=True)
class StopLatch:
    """What a robot knows of the stop order. A robot that heard nothing since it started stands still.

    A stop is taken from anybody, at any revision. An order of revision 0 is an operator's who has not heard the state
    either: it stops those that it names and tells nobody else anything. Only a newer revision than the newest heard
    lifts it: at a tie the stop wins, so the base station's repetition of an old state does not lift an operator's stop
    that it has not heard.

    Attributes:
        heard: any order was heard.
        stopped: a stop is latched.
        everybody: ... and it was one to everybody.
        revision: the newest revision heard.
    """

    heard: bool = False
    stopped: bool = False
    everybody: bool = False
    revision: int = -1

    def hear(self, me: str, *, everybody: bool, names: Collection[str], revision: int) -> StopLatch:
        """The latch after an order.

        Args:
            me: this robot's name.
            everybody: the order stops all.
            names: the robots that it stops.
            revision: of the order.
        """
        if revision > MOST_REVISION:
            revision = 0
        newest = max(self.revision, revision)
        if everybody or me in names:
            # A newer order is the whole state: one that names some is no order to everybody any more.
            return StopLatch(True, True, everybody or (self.everybody and revision <= self.revision), newest)
        if revision > 0 and (revision > self.revision or not self.heard):
            return StopLatch(True, False, False, newest)
        return StopLatch(self.heard, self.stopped, self.everybody, newest)

    @property
    def may_drive(self) -> bool:
        """Whether driving is allowed."""
        return self.heard and not self.stopped

    @property
    def reason(self) -> str:
        """Why it is not; empty when it is."""
        if not self.heard:
            return "no stop state heard yet"
        if self.stopped:
            return "stop order to everybody" if self.everybody else "stop order"
        return ""
