"""How late a message is, when no two clocks agree.

Per writer a reader keeps the least (arrival - stamp) of about the last minute: the clocks' offset plus the quickest way
through. What a later message exceeds it by is its extra delay. A backlog that arrives after a freeze is late by that
measure, though it has just arrived.
"""

from __future__ import annotations

import math

_HALF_WINDOW = 30.0


class DelayTracker:
    """The least (arrival - stamp) of one writer.

    Two half-minute buckets that turn only when a message comes: silence does not make it forget, so the backlog that
    ends a long freeze is still late.
    """

    __slots__ = ("_began", "_epoch", "_newer", "_older")

    def __init__(self) -> None:
        self._epoch = -1
        self._began = -math.inf
        self._newer = math.inf
        self._older = math.inf

    @property
    def least(self) -> float:
        """The least (arrival - stamp) [s]; infinite before the first message."""
        return min(self._newer, self._older)

    def observe(self, epoch: int, stamp: float, arrival: float) -> float:
        """Take a message into account.

        Args:
            epoch: the writer's process; another one starts anew.
            stamp: the message's stamp [s, the writer's clock].
            arrival: when it came [s, our clock].

        Returns:
            Its extra delay [s], zero or more.
        """
        if epoch != self._epoch:
            self._epoch = epoch
            self._began = arrival
            self._newer = self._older = math.inf
        elif arrival - self._began > _HALF_WINDOW:
            self._older, self._newer = self._newer, math.inf
            self._began = arrival
        offset = arrival - stamp
        self._newer = min(self._newer, offset)
        return offset - self.least
