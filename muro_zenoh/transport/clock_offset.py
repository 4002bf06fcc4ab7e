"""What two clocks differ by, measured with four time stamps a question, as NTP does.

A question and its answer bound the difference: each took no less than no time. Of the last questions the few quickest
count, so that a loop that was busy or a path that was slow for once does not matter; and of these the median, because
a path that becomes slow between a question and its answer makes a quick round trip that is wrong by half of what it
took. Two measurements that exclude each other are a clock that was set in between.

Only a message's *age* is judged by it, together with the least difference of :mod:`muro_zenoh.transport.delay`, and the
later of the two counts. So an answer that is wrong makes messages older than they are, and never younger.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from typing import Final, NamedTuple

DRIFT: Final = 200e-6
"""Two clocks part no faster than this [s/s]: twice the 100 ppm of two poor crystals, 6 ms in half a minute."""

_WINDOW: Final = 16
"""The number of questions of which the quickest count."""

_QUICKEST: Final = 5
"""The median of so many is the offset."""

_STEP: Final = 0.05
"""A clock that was set by less than this makes no message older or younger than matters [s]."""

_MOST_WRITERS: Final = 256


class RoundTrip(NamedTuple):
    """The four time stamps of a question and its answer [s].

    Attributes:
        sent: when it was asked, by the asker's clock.
        received: when it came, by the answerer's.
        replied: when it was answered, by the answerer's.
        returned: when the answer came, by the asker's.
    """

    sent: float
    received: float
    replied: float
    returned: float

    @property
    def offset(self) -> float:
        """What to add to the asker's clock to have the answerer's [s]; wrong by half of what one way takes longer."""
        return 0.5 * ((self.received - self.sent) + (self.replied - self.returned))

    @property
    def duration(self) -> float:
        """The time that both ways took together [s]."""
        return (self.returned - self.sent) - (self.replied - self.received)

    @property
    def is_possible(self) -> bool:
        """Whether nothing came before it was sent, by either clock."""
        return self.received <= self.replied and self.sent <= self.returned and self.duration >= -1e-6


class OffsetEstimate:
    """What our clock and another one differ by, from the last round trips.

    Attributes:
        offset: what to add to our clock to have the other one [s]; 0 before the first round trip.
        steps: how often it was certain that one of the two was set, by 50 ms or more.
    """

    def __init__(self) -> None:
        self.offset = 0.0
        self.steps = 0
        self._trips: deque[RoundTrip] = deque(maxlen=_WINDOW)
        self._best: RoundTrip | None = None

    def add(self, trip: RoundTrip) -> float:
        """Take a round trip into account; one that is impossible is not.

        Args:
            trip: it has ended now.

        Returns:
            By how much the other clock was set against ours since the best one before [s]; 0 unless that is certain.
        """
        if not trip.is_possible:
            return 0.0
        step = 0.0
        if self._best is not None:
            apart = trip.offset - self._best.offset
            if abs(apart) > 0.5 * trip.duration + self.bound(trip.returned):
                step = apart
                self.steps += abs(step) > _STEP
                self._trips.clear()
        self._trips.append(trip)
        quickest = sorted(self._trips, key=lambda known: _bound(known, trip.returned))[:_QUICKEST]
        self._best = quickest[0]
        self.offset = statistics.median(known.offset for known in quickest)
        return step

    @property
    def best(self) -> RoundTrip | None:
        """The round trip that bounds the offset best; None before the first."""
        return self._best

    def bound(self, now: float) -> float:
        """The greatest error of the best round trip's offset [s]; infinite before the first.

        Args:
            now: the time, by our clock [s].
        """
        return _bound(self._best, now) if self._best is not None else math.inf


def _bound(trip: RoundTrip, now: float) -> float:
    return 0.5 * trip.duration + DRIFT * max(0.0, now - trip.sent)


class KnownClocks:
    """The clocks of other processes that were measured against ours, by their epoch."""

    def __init__(self) -> None:
        self._behind: dict[int, tuple[float, float, int]] = {}

    def note(self, epoch: int, behind: float, at: float, steps: int = 0) -> None:
        """Take a measurement.

        Args:
            epoch: the other process; 0, which is nobody's, is ignored.
            behind: what to add to its clock to have ours [s].
            at: when it was measured, by our clock [s].
            steps: how often it was certain that one of the two was set (:attr:`OffsetEstimate.steps`).
        """
        if not epoch or not math.isfinite(behind):
            return
        self._behind.pop(epoch, None)
        self._behind[epoch] = behind, at, steps
        if len(self._behind) > _MOST_WRITERS:
            del self._behind[next(iter(self._behind))]

    def offset(self, epoch: int, now: float) -> float:
        """The greatest that (our clock - its clock) may be by now [s]; infinite for a process that was not measured.

        An answerer that has fallen silent stays known, less what clocks drift: else a path that is slow for good would
        be on time again without it.

        Args:
            epoch: the process.
            now: the time, by our clock [s].
        """
        known = self._behind.get(epoch)
        return math.inf if known is None else known[0] + DRIFT * abs(now - known[1])

    def steps(self, epoch: int) -> int:
        """How often it was certain that our clock or a process's was set.

        Args:
            epoch: the process.
        """
        known = self._behind.get(epoch)
        return 0 if known is None else known[2]
