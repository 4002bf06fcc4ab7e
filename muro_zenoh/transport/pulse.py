"""Whether this process was frozen: it must not carry out the orders that piled up meanwhile.

Their senders have given up waiting. A message's age is known from its writer's earlier ones; an order has none, so the
process that takes it looks at itself: a timer of its loop beats, and a gap between two beats was a pause.
"""

from __future__ import annotations

import asyncio
import math
from typing import Final

from muro_zenoh.runtime.clock import Clock

_BEAT: Final = 0.2
LONGEST_WAIT: Final = 0.7
"""A loop that has not come to its orders for this time was frozen or blocked [s]; askers wait for 1 s."""

_SETTLING: Final = 0.5
"""What was on its way during a pause has come by this time after it [s]."""


class Pulse:
    """The beat of one process's loop.

    Args:
        loop: the loop.
        clock: for the time between two beats.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, clock: Clock) -> None:
        self._loop = loop
        self._now = clock.now
        self._beaten = clock.now()
        self._woke = -math.inf
        self._timer = loop.call_later(_BEAT, self._beat)

    def paused(self) -> bool:
        """Whether the process is just waking from a pause. Callable from any thread."""
        now = self._now()
        return now - self._beaten > LONGEST_WAIT or now - self._woke < _SETTLING

    def close(self) -> None:
        """Beat no more."""
        self._timer.cancel()

    def _beat(self) -> None:
        now = self._now()
        if now - self._beaten > LONGEST_WAIT:
            self._woke = now
        self._beaten = now
        self._timer = self._loop.call_later(_BEAT, self._beat)
