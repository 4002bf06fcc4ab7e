"""A message as it came in, and what became of all those of a channel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

from msgspec import Struct

from muro_zenoh.messages import Message

T = TypeVar("T", bound=Message)


@dataclass(slots=True)
class Counters:
    """What became of the messages of one channel.

    Attributes:
        received: samples filed.
        dropped: good or not, they were displaced by newer ones before anybody read them.
        rejected: they were not what their key promises, or their stamps leapt ahead.
        late: good ones that were stale when they came.
        unsent: the middleware did not take them.
        arrival: when the newest good one came [s, our clock]; 0 before the first.
        delay: the newest one's extra delay [s].
    """

    received: int = 0
    dropped: int = 0
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
        delay: its extra delay: how much later it came than this writer's quickest [s].
        least: the least (arrival - stamp) of this writer [s].
    """

    name: str
    message: T
    arrival: float
    delay: float
    least: float

    def age(self, now: float) -> float:
        """What staleness is judged by: the time since it came plus its extra delay [s]."""
        return now - self.arrival + self.delay

    def captured(self, latency: float = 0.0) -> float:
        """When it was stamped, by our clock [s], given the least latency on the path here [s]."""
        return self.message.stamp + self.least - latency
