"""How late a message is, when no two clocks agree. This is the one home of that question.

Per writer a reader keeps the least (arrival - stamp) of about the last minute: the clocks' offset plus the quickest way
through. What a later message exceeds it by is its extra delay. A backlog that arrives after a freeze is late by that
measure, though it has just arrived.

No message alone moves that measure, or one wrong stamp would make every later message late for good. It is learned from
_SPANS spans of time in a row, each with a message, and each counted at its latest one:

* It falls to what all of these came up to. A stamp so far ahead that no way through could have shrunk by that much is
  not believed until then; it may be a clock that was set forward.
* It rises by the little that clocks drift, and only while messages come so close to it that drift explains them.
  Otherwise it rises only when stamps have gone back and the messages since agree with each other: a clock was set back.
  Lateness alone never makes it rise, however long it lasts.
* It begins anew when it is certain that a clock was set, ours or the writer's, because that was measured.

That takes the least time on the way for a part of the clocks' offset, so a way that is slow from the beginning would
count as quick. Where the offset itself was measured (:mod:`muro_zenoh.transport.clock_offset`), a message is as late as
the later of the two says. Until then a process that takes another's place on a key is judged by that one's clock: a
camera that was restarted on the same computer, on a link that has become slow by then, is late from its first picture.
"""

from __future__ import annotations

import math
from collections import deque

from muro_zenoh.transport.clock_offset import DRIFT

_HALF_WINDOW = 30.0

_MOST_DRIFT = 0.1
"""Two clocks are taken to part at DRIFT, which is therefore also the fastest that lateness can creep in, and no farther
than this during one silence [s]. A writer that has been silent for an hour may come back on a slow
path; what is taken for drift must stay well below the age at which poses and commands are stale."""

_NEAR = 0.03
"""A half minute whose quickest messages are later than the least by more than this is late, and has not drifted [s]. It
has to cover the drift that could not be followed during a few late half minutes (3 ms each at 100 ppm), and what the
quickest of 600 messages on Wi-Fi vary by, a few milliseconds. A path longer by less is taken in, and matters to nobody.
"""

UNMEASURED = 5.0
"""A writer is judged by the clock of the one before it for this time [s]; a process that measures clocks has done so by
then, even if it had just asked a base station that is gone, and one that does not may have another clock."""

_MOST_WRITERS = 4

_SPANS = 5

_SPAN = 0.04
"""The shortest span [s]: a burst is a single one, and each message at 20 Hz is one of its own."""

_AGREE = 0.1
"""Spans agree when their offsets are no farther apart than this; a stamp that is this far back has gone back [s]."""

LEAP = 0.5
"""No way through shrinks by more than this from one message to the next [s]."""


class DelayTracker:
    """The least (arrival - stamp) of each writer of one key.

    Mostly that is one process. Where there are more (a stop from the base station and from an operator; a restart that
    overlaps), each has a clock of its own; the four heard last are remembered.

    Attributes:
        least: the least (arrival - stamp) of the writer heard last, its last message included [s]; infinite before
            the first one.
        measured: (our clock - the writer's) as it was measured, or that of the writer before it [s]; else infinite.
        heard: when the last message came [s, our clock].
    """

    __slots__ = ("_clock", "_epoch", "_last", "_writers", "heard", "least", "measured")

    def __init__(self) -> None:
        self.least = math.inf
        self.measured = math.inf
        self._clock = math.inf  # the last one that was measured
        self.heard = -math.inf
        self._epoch = -1
        self._last = _Window(0.0, 0)
        self._writers: dict[int, _Window] = {}

    def observe(self, epoch: int, stamp: float, arrival: float, measured: float = math.inf, steps: int = 0) -> float:
        """Take a message into account.

        Args:
            epoch: the writer's process; another one starts anew.
            stamp: the message's stamp [s, the writer's clock].
            arrival: when it came [s, our clock].
            measured: (our clock - the writer's) as far as it was measured [s]; infinite when it was not.
            steps: how often it was certain that one of the two was set.

        Returns:
            Its extra delay [s], zero or more; below zero when its stamp leaps ahead of the writer's clock, by as much.
        """
        self.heard = arrival
        if epoch != self._epoch:
            self._change_writer(epoch, arrival)
        if steps != self._last.steps:
            self._last = self._writers[epoch] = _Window(arrival, steps)
        if measured < math.inf:
            self._clock = measured
        elif arrival - self._last.first < UNMEASURED:
            measured = self._clock
        self.measured = measured
        measure, offset = self._last.observe(stamp, arrival), arrival - stamp
        self.least = least = measure if measure < offset else offset
        if measure - offset > LEAP:
            return offset - measure
        return offset - (least if least < measured else measured)  # never younger than either says

    def _change_writer(self, epoch: int, arrival: float) -> None:
        self._epoch = epoch
        writers = self._writers
        window = writers.pop(epoch, None) or _Window(arrival, 0)
        if len(writers) >= _MOST_WRITERS:
            # One that was heard only briefly goes first: a stranger with ever new epochs displaces nobody.
            brief = (other for other, known in writers.items() if not known.confirmed)
            del writers[next(brief, next(iter(writers)))]
        writers[epoch] = self._last = window  # the one heard last stands last


class _Window:
    """The least offset of one writer, in two half-minute buckets that turn only when a message comes: silence does not
    make it forget, so the backlog that ends a long freeze is still late.

    Until five spans have agreed, the least of all counts: a value that was kept for late joiners, or a start in the
    midst of a backlog, is corrected by the first message that is quicker.
    """

    __slots__ = (
        "_began",
        "_drift",
        "_least",
        "_newer",
        "_newest",
        "_older",
        "_span_began",
        "_spans",
        "_went_back",
        "confirmed",
        "first",
        "steps",
    )

    def __init__(self, began: float, steps: int) -> None:
        self.confirmed = False
        self.first = began
        self.steps = steps
        self._began = began
        self._newer = math.inf
        self._older = math.inf
        self._least = math.inf  # of both buckets
        self._drift = 0.0  # what the clocks may have parted by from the older bucket to the newer one
        self._newest = -math.inf  # stamp of a message on time
        self._went_back = False
        self._spans: deque[tuple[float, float]] = deque(maxlen=_SPANS)  # least and greatest offset
        self._span_began = -math.inf

    def observe(self, stamp: float, arrival: float) -> float:
        """The least offset before this message, which is taken into account [s]; of the first one its own."""
        offset = arrival - stamp
        new_span = arrival - self._span_began >= _SPAN
        if new_span:
            self._learn()  # before the turn: what was learned before a silence says nothing about the time since
        if arrival - self._began > _HALF_WINDOW:
            self._turn(arrival)
        if new_span:
            self._span_began = arrival
            self._spans.append((offset, offset))
        else:
            low, high = self._spans[-1]
            self._spans[-1] = min(low, offset), max(high, offset)
        least = self._least
        if not self.confirmed and offset < least:
            self._newer = self._least = least = offset
        on_time = offset <= least + _AGREE
        if on_time:
            self._went_back = False
        elif stamp < self._newest - _AGREE:
            self._went_back = True
        elif self.confirmed and stamp > self._newest:
            # Late, but in order: the old stamp was a message that came twice or was overtaken. A clock that was set
            # back stays behind.
            self._went_back = False
        # In a backlog nothing has gone back when one message overtakes others.
        if offset >= least - _AGREE and stamp > self._newest and (on_time or not self.confirmed):
            self._newest = stamp
        return least

    def _turn(self, arrival: float) -> None:
        """Half a minute is over, and the bucket of the one before it is forgotten.

        Clocks drift, so the least may rise; but by no more than they do, and only when the messages are near it. On a
        way that grew two seconds longer, a radio link with full buffers, they stay late, and do not become the measure
        of what is quick, neither at once nor by small steps.
        """
        if self._newer > self._least + self._drift + _NEAR:
            self._older = self._least
        else:
            self._older = min(self._newer, self._least + self._drift)
        self._drift = min(DRIFT * (arrival - self._began), _MOST_DRIFT)
        self._least, self._newer, self._began = self._older, math.inf, arrival

    def _learn(self) -> None:
        """From the spans that have passed."""
        if len(self._spans) < _SPANS:
            return
        if self.confirmed and not self._went_back and self._spans[-1][1] >= self._newer:
            return  # most of the time: the highest of all is at least as high
        lows, highs = zip(*self._spans, strict=True)
        low, high = min(lows), max(highs)
        if self._went_back:
            if high - low <= _AGREE:
                self._begin_anew(high)
        elif not self.confirmed:
            if high - self._least <= _AGREE:
                self._begin_anew(high)
        elif high < self._newer:
            self._newer = high
            self._least = min(high, self._older)

    def _begin_anew(self, least: float) -> None:
        self.confirmed, self._went_back = True, False
        self._newer = self._least = least
        self._older, self._newest = math.inf, -math.inf
