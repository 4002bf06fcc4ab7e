"""Keeps a camera's pictures within what its network carries: worse pictures first, then fewer."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

_WINDOW: Final = 1.0
"""What was sent is counted over this time [s]."""
_WORST: Final = 40
"""Quality below which pictures are left out instead: the corners of tags suffer."""
_STEP: Final = 5
_ROOM: Final = 0.7
"""Below this part of the limit pictures become better again."""


class Bandwidth:
    """Counts what is sent.

    Args:
        quality: of the JPEG as it was chosen, 1 to 100; 0 for raw frames, which only become fewer.
        limit: of what is sent [kB/s].

    Attributes:
        quality: of the next picture.
    """

    def __init__(self, quality: int, limit: float = math.inf) -> None:
        self.quality = quality
        self._chosen = quality
        self._limit = limit
        self._sent: deque[tuple[float, float]] = deque()

    def used(self, now: float) -> float:
        """What was sent within the last second [kB/s].

        Args:
            now: the time [s].
        """
        while self._sent and self._sent[0][0] <= now - _WINDOW:
            self._sent.popleft()
        return sum(size for _, size in self._sent) / _WINDOW

    def takes(self, size: int, now: float) -> bool:
        """Whether a picture is sent; counts it then, and chooses the quality of the next one.

        Args:
            size: of its message [bytes].
            now: the time [s].
        """
        used = self.used(now) + 1e-3 * size / _WINDOW
        fits = used <= self._limit
        if fits:
            self._sent.append((now, 1e-3 * size))
        if self._chosen:
            if not fits:
                self.quality = max(min(_WORST, self._chosen), self.quality - _STEP)
            elif used < _ROOM * self._limit and now - self._sent[0][0] > 0.9 * _WINDOW:
                self.quality = min(self._chosen, self.quality + 1)
        return fits
