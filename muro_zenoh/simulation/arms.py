"""Arms that reach across a camera's picture now and then."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_LASTS = 1.2
"""From the moment that a hand enters the picture until it has left again [s]."""
_WIDTH = 0.07
"""Width of an arm, in widths of the picture: half a metre above a floor of 4 m, a tenth of a metre looks as wide."""


class Arms:
    """The arms over one camera, in order of time.

    Args:
        rng: draws when they come, from which side and how far they reach.
        every: mean time from one arm to the next [s]; 0 for never.
        width: of the picture [px].
        height: of the picture [px].
    """

    def __init__(self, rng: np.random.Generator, every: float, width: int, height: int) -> None:
        self._rng = rng
        self._every = every
        self._size = np.array((width, height), dtype=np.float64)
        self._begin = -math.inf
        self._root = self._reach = np.zeros(2)
        self._next(0.0)

    def cover(self, t: float) -> Array | None:
        """What an arm covers.

        Args:
            t: time since the start [s]; never less than before.

        Returns:
            (4, 2) corners [px], or None when there is no arm.
        """
        if self._every <= 0.0:
            return None
        while t > self._begin + _LASTS:
            self._next(self._begin + _LASTS)
        if t < self._begin:
            return None
        hand = self._root + math.sin(math.pi * (t - self._begin) / _LASTS) * self._reach
        along = self._reach / float(np.hypot(*self._reach))
        side = 0.5 * _WIDTH * self._size[0] * np.array((-along[1], along[0]))
        return np.stack((self._root + side, self._root - side, hand - side, hand + side))

    def _next(self, after: float) -> None:
        self._begin = after + float(self._rng.exponential(self._every)) if self._every > 0.0 else math.inf
        edge, place = int(self._rng.integers(4)), float(self._rng.uniform())
        root = np.array(((place, 0.0), (place, 1.0), (0.0, place), (1.0, place))[edge]) * self._size
        self._root = root
        self._reach = self._rng.uniform(0.2, 0.8, 2) * self._size - root
