"""A message as it came in, and what became of all those of a channel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Generic, TypeVar

from msgspec import Struct

from muro_zenoh.messages import Message

T = TypeVar("T", bound=Message)

_AT_ONCE = 0.1
"""A message may arrive between looking at the clock and reading it: it then came so much later than now at most [s]."""


@dataclass(slots=True)
class Counters:
    """What became of the messages of one channel.

    Attributes:
        received: samples filed.
        dropped: good or not, there was no room for them: nobody had read those before them.
        replaced: the same, where only the newest is kept anyway: a reader that looks now and then misses nothing.
        rejected: they were not what their key promises, or their stamps leapt ahead.
        late: good ones that were stale when they came.
        unsent: the middleware did not take them.
        arrival: when the newest good one came [s, our clock]; 0 before the first.
        delay: the newest one's extra delay [s].
    """

    received: int = 0
    dropped: int = 0
    replaced: int = 0
    rejected: int = 0
    late: int = 0
    unsent: int = 0
    arrival: float = 0.0
    delay: float = 0.0


class Received(Struct, Generic[T], frozen=True, gc=False):
    """A message as it came in.

    Attributes:
        name: the name in its key (a robot's, a camera's); empty where the channel has none.
        message: the message.
        arrival: when it came [s, our clock].
        delay: its extra delay: how much later it came than this writer's quickest [s]; where the writer's clock was
            measured, its whole delay, when that is more.
        least: the least (arrival - stamp) of this writer [s].
        measured: (our clock - the writer's) as far as it was measured [s]; infinite when it was not.
    """

    name: str
    message: T
    arrival: float
    delay: float
    least: float
    measured: float = math.inf

    def age(self, now: float) -> float:
        """What staleness is judged by: the time since it came plus its extra delay [s]; infinite for a message that
        came later than now, because the clock was set back since."""
        since = now - self.arrival
        return since + self.delay if not since < -_AT_ONCE else math.inf

    def captured(self, latency: float = 0.0) -> float:
        """When it was captured, by our clock [s], given the least latency from there to here [s].

        A link that is slow from the beginning is not in that latency, so a measured clock may say that it was earlier.
        """
        return self.message.stamp + min(self.least - latency, self.measured)
