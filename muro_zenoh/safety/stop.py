"""The stop latch: whether a robot may drive, from the stop orders that it received."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

MAX_REVISION: Final = 2**53
"""A greater revision is ignored: integers above it are not exact in every language, and no count of orders reaches it.
If it were accepted, no later order could lift the stop."""


MAX_REVISION_GAP: Final = 2**20
"""Revisions further apart than this belong to different counts: no robot misses a million orders."""


def may_be_of_count(revision: int, newest: int) -> bool:
    """Whether a revision can have been reached by the count whose newest revision is known.

    Args:
        revision: the one in question.
        newest: the count's.
    """
    return revision < newest + MAX_REVISION_GAP


def is_newer(revision: int, than: int) -> bool:
    """Whether an order is newer than another one.

    An order whose revision is far behind counts as newer: the other one is from a base station that has lost its file
    since, or from a foreign program, and must not block the current orders.

    Args:
        revision: the order's revision.
        than: the other's revision.
    """
    return revision > than or not may_be_of_count(than, revision)


@dataclass(frozen=True, slots=True)
class StopLatch:
    """A robot's stop state. A robot that has received no order since it started must not drive.

    A stop is accepted from any sender, at any revision. An order of revision 0 comes from an operator who has not
    received the state either: it stops the robots that it names and has no effect on the others. One of a revision that
    no count can have reached since the newest received is treated alike.

    Only a revision of the same count that is newer than the newest received lifts a stop. An order from far behind
    begins another count and lifts nothing: its sender may not have received the stop, and takes it over from the
    robot's health. At a tie the stop wins, so the base station's repetition of an old state does not lift an operator's
    stop that it has not received.

    Attributes:
        received: an order was received.
        stopped: a stop is latched.
        all_robots: the latched stop was one to all robots.
        revision: the newest revision received.
    """

    received: bool = False
    stopped: bool = False
    all_robots: bool = False
    revision: int = -1

    def receive(self, me: str, *, all_robots: bool, names: Collection[str], revision: int) -> StopLatch:
        """The latch after an order.

        Args:
            me: this robot's name.
            all_robots: the order stops all robots.
            names: the robots that it stops.
            revision: the order's revision.
        """
        if revision > MAX_REVISION or (self.received and not may_be_of_count(revision, self.revision)):
            revision = 0
        newer = revision > 0 and is_newer(revision, self.revision)
        newest = revision if newer else max(self.revision, 0)
        if all_robots or me in names:
            # A newer order is the whole state: one that names some robots replaces an order to all.
            return StopLatch(True, True, all_robots or (self.all_robots and not newer), newest)
        if newer and (revision > self.revision or not self.stopped):
            return StopLatch(True, False, False, newest)
        return StopLatch(self.received, self.stopped, self.all_robots, newest)

    @property
    def may_drive(self) -> bool:
        """Whether driving is allowed."""
        return self.received and not self.stopped

    @property
    def reason(self) -> str:
        """Why driving is not allowed; empty when it is."""
        if not self.received:
            return "no stop state received yet: waiting for the base station"
        if self.stopped:
            return "stopped by order (all robots)" if self.all_robots else "stopped by order"
        return ""
