"""How late a message is, when no two clocks agree.

Per writer a reader keeps the least (arrival - stamp) of about the last minute: the clocks' offset plus the shortest
time that the path took. What a later message exceeds it by is its extra delay. A backlog that arrives after a freeze is
late by that measure, though it has just arrived.
"""

from __future__ import annotations

import math

_HALF_WINDOW = 30.0

_DRIFT = 0.03
"""Two clocks part by at most so much in half a minute [s]: a thousandth, ten times what quartz does."""

_MOST_WRITERS = 4


class DelayTracker:
    """The least (arrival - stamp) of each writer of one key.

    Mostly that is one process. Where there are more (a stop from the base station and from an operator; a restart that
    overlaps), each has a clock of its own; the four heard last are remembered.

    Attributes:
        least: the least (arrival - stamp) of the writer heard last [s]; infinite before the first message.
    """

    __slots__ = ("_epoch", "_last", "_writers", "least")

    def __init__(self) -> None:
        self.least = math.inf
        self._epoch = -1
        self._last = _Window(-math.inf)
        self._writers: dict[int, _Window] = {}

    def observe(self, epoch: int, stamp: float, arrival: float) -> float:
        """Take a message into account.

        Args:
            epoch: the writer's process; another one starts from scratch.
            stamp: the message's stamp [s, the writer's clock].
            arrival: when it came [s, our clock].

        Returns:
            Its extra delay [s], zero or more.
        """
        if epoch != self._epoch:
            self._epoch = epoch
            window = self._writers.pop(epoch, None) or _Window(arrival)
            self._writers[epoch] = self._last = window  # the one heard last comes last
            if len(self._writers) > _MOST_WRITERS:
                del self._writers[next(iter(self._writers))]
        window = self._last
        if arrival - window.began > _HALF_WINDOW:
            # Clocks drift, so the least may rise; but no more than they do. A path that grew by two seconds, a radio
            # link with full buffers, stays late and does not become the measure of what is quick.
            window.older, window.newer = min(window.newer, min(window.older, window.newer) + _DRIFT), math.inf
            window.began = arrival
        offset = arrival - stamp
        if offset < window.newer:
            window.newer = offset
        self.least = window.newer if window.newer < window.older else window.older
        return offset - self.least


class _Window:
    """The least offset of one writer, in two half-minute buckets that turn only when a message comes: silence does not
    make it forget, so the backlog that ends a long freeze is still late."""

    __slots__ = ("began", "newer", "older")

    def __init__(self, began: float) -> None:
        self.began = began
        self.newer = math.inf
        self.older = math.inf
