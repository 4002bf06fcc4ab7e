"""Mailboxes between the middleware's threads and the event loop.

A callback files bytes and leaves. A loop whose task waits is woken once for all that was filed meanwhile; a mailbox
that nobody waits at wakes nothing. Decoding is done on the loop, after coalescing. Every mailbox is bounded, and counts
what it drops and what it rejects.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Self, TypeVar

from msgspec import Struct

from muro_zenoh.channels import NAME_PATTERN
from muro_zenoh.errors import MessageError, TransportError
from muro_zenoh.messages import Message, check_encoding, decoder, encoding_of
from muro_zenoh.runtime.clock import Clock
from muro_zenoh.transport.delay import DelayTracker

log = logging.getLogger(__name__)

T = TypeVar("T", bound=Message)

_MAX_KEYS = 1024
"""Keys a mailbox of many remembers; a stranger who writes on ever new ones fills no memory."""

MAX_PAYLOAD = 8 * 2**20
"""A payload above this is rejected unread [bytes]; a 1080p grey frame is 2 MB."""


_Filed = tuple[bytes, str | None, float]
"""Payload, encoding, arrival."""


@dataclass(slots=True)
class Counters:
    """What became of the messages of one channel.

    Attributes:
        received: samples filed.
        dropped: good or not, they were displaced by newer ones before anybody read them.
        rejected: they were not what their key promises.
        arrival: when the newest good one came [s, our clock]; 0 before the first.
        delay: the newest one's extra delay [s].
    """

    received: int = 0
    dropped: int = 0
    rejected: int = 0
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
        """When it was stamped, by our clock [s], given the least latency of the way here [s]."""
        return self.message.stamp + self.least - latency


class Inbox(ABC, Generic[T]):
    """What :class:`Latest` and :class:`Every` share: filing, waking, counting.

    Args:
        kind: the message type.
        prefix: length of the key up to the name.
        clock: for arrival times.
        loop: where it is read.
        counters: shared by all mailboxes of a channel.
        where: the key, for error messages.
        depth: raw samples of a key that wait for the loop at most.
    """

    def __init__(
        self,
        kind: type[T],
        prefix: int,
        clock: Clock,
        loop: asyncio.AbstractEventLoop,
        counters: Counters,
        where: str,
        depth: int,
    ) -> None:
        self._kind = kind
        self._encoding = encoding_of(kind)
        self._decode = decoder(kind)
        self._prefix = prefix
        self._now = clock.now
        self._loop = loop
        self._counters = counters
        self._where = where
        self._depth = depth
        self._thread = threading.get_ident()
        self._lock = threading.Lock()
        self._raw: dict[str, list[_Filed]] = {}
        self._awake = False
        self._delays: dict[str, DelayTracker] = {}
        self._waiter: asyncio.Future[None] | None = None
        self._episode = False
        self._closers: list[Callable[[], None]] = []
        self._closed = False

    # ---- from any thread

    def file(self, key: str, payload: bytes, encoding: str | None) -> None:
        """Take a sample from the middleware; from any thread."""
        arrival = self._now()
        with self._lock:
            if self._closed:
                return
            self._counters.received += 1
            filed = self._raw.get(key)
            if filed is None:
                if len(self._raw) >= _MAX_KEYS:
                    self._counters.rejected += 1
                    return
                self._raw[key] = [(payload, encoding, arrival)]
            else:
                if len(filed) >= self._depth:
                    self._counters.dropped += 1
                    del filed[0]
                filed.append((payload, encoding, arrival))
            if self._awake or self._waiter is None:
                return
            self._awake = True
        if threading.get_ident() == self._thread:  # an in-memory link's: nobody sleeps who must be woken
            self._wake()
            return
        try:  # noqa: SIM105 - suppress() costs a microsecond on the way of every message
            self._loop.call_soon_threadsafe(self._wake)
        except RuntimeError:
            pass  # Zenoh calls back after undeclare() until its backlog is drained; a closed loop wants none of it

    # ---- on the loop

    def hand(self, key: str, message: T) -> None:
        """Take a message that this very process sends; it was never bytes."""
        if self._raw:
            self._sort()  # what others sent before it is older
        now = self._now()
        self._counters.received += 1
        self._counters.arrival = now
        self._accept(Received(key[self._prefix :], message, now, 0.0, 0.0))
        self._notify()

    async def next(self) -> Received[T]:
        """Wait for a message that was not read yet.

        Raises:
            TransportError: the mailbox was closed, or another task waits here already.
        """
        while True:
            if self._raw:
                self._sort()
            item = self._take()
            if item is not None:
                return item
            if self._closed:
                raise TransportError(f"{self._where}: the mailbox is closed")
            if self._waiter is not None:
                raise TransportError(f"{self._where}: two tasks wait at one mailbox; give each its own")
            self._waiter = self._loop.create_future()
            try:
                if not self._raw:  # else filed since, and perhaps nobody was woken for it
                    await self._waiter
            finally:
                self._waiter = None

    def __aiter__(self) -> Self:
        return self

    __anext__ = next

    def close(self) -> None:
        """Undeclare it; a task that waits here gets a :class:`TransportError`."""
        if self._closed:
            return
        self._closed = True
        for close in self._closers:
            close()
        self._notify()

    def on_close(self, close: Callable[[], None]) -> None:
        """Have ``close`` called when the mailbox is closed."""
        self._closers.append(close)

    def _wake(self) -> None:
        """Let the task that waits sort what was filed."""
        self._awake = False
        self._notify()

    def _sort(self) -> None:
        """Decode what was filed."""
        with self._lock:
            raw, self._raw = self._raw, {}
        if not self._closed:
            for key, filed in raw.items():
                self._sort_key(key, filed)

    @abstractmethod
    def _sort_key(self, key: str, filed: list[_Filed]) -> None:
        """Decode one key's samples."""

    @abstractmethod
    def _accept(self, item: Received[T]) -> None:
        """Keep a decoded message."""

    @abstractmethod
    def _take(self) -> Received[T] | None:
        """The next unread message, or None."""

    def _open(self, key: str, payload: bytes, encoding: str | None, arrival: float) -> Received[T] | None:
        """The message in a sample, or None when it is none: counted, and said once per episode."""
        tracker = self._delays.get(key)
        try:
            if len(payload) > MAX_PAYLOAD:
                raise MessageError(f"got {len(payload)} bytes, expected at most {MAX_PAYLOAD}")
            if tracker is None:
                self._check_key(key)
            if encoding != self._encoding:
                check_encoding(encoding, self._kind)
            message = self._decode(payload)
        except MessageError as error:
            self._counters.rejected += 1
            if not self._episode:
                self._episode = True
                log.warning("%s: dropped a message: %s (said once until a good one comes)", key, error)
            return None
        self._episode = False
        if tracker is None:
            tracker = self._delays[key] = DelayTracker()
        delay = tracker.observe(message.epoch, message.stamp, arrival)
        self._counters.delay = delay
        self._counters.arrival = arrival
        return Received(key[self._prefix :], message, arrival, delay, tracker.least)

    def _check_key(self, key: str) -> None:
        name = key[self._prefix :]
        if name and not NAME_PATTERN.fullmatch(name):
            raise MessageError(f"got the name {name!r} in the key, expected one such as 'r1'")
        if len(self._delays) >= _MAX_KEYS:
            raise MessageError(f"got a {_MAX_KEYS + 1}th writer's key, expected at most {_MAX_KEYS}")

    def _notify(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)


class Latest(Inbox[T]):
    """Keeps the newest message of each key, and wakes its reader once for all that came meanwhile."""

    def __init__(
        self,
        kind: type[T],
        prefix: int,
        clock: Clock,
        loop: asyncio.AbstractEventLoop,
        counters: Counters,
        where: str,
        depth: int = 4,
    ) -> None:
        # depth: garbage behind a good message does not displace it, unless there is a lot of it
        super().__init__(kind, prefix, clock, loop, counters, where, depth)
        self._newest: dict[str, Received[T]] = {}
        self._unread: dict[str, Received[T]] = {}
        self._unseen: set[str] = set()  # names whose newest nobody has looked at, by next() or get()

    def get(self, name: str = "") -> Received[T] | None:
        """The newest message of a name, read or not, without waiting. On a mailbox of one key leave ``name`` out."""
        if self._raw:
            self._sort()
        if not name and self._newest:
            name = next(iter(self._newest))
        self._unseen.discard(name)
        return self._newest.get(name)

    def values(self) -> dict[str, Received[T]]:
        """The newest message of each name."""
        if self._raw:
            self._sort()
        self._unseen.clear()
        return dict(self._newest)

    def forget(self, name: str) -> None:
        """Drop what is known of a name."""
        if self._raw:
            self._sort()
        self._unseen.discard(name)
        self._newest.pop(name, None)
        self._unread.pop(name, None)

    def _sort_key(self, key: str, filed: list[_Filed]) -> None:
        # From the newest on: those behind the first good one are not worth their decoding.
        while filed:
            item = self._open(key, *filed.pop())
            if item is not None:
                self._counters.dropped += len(filed)
                self._accept(item)
                return

    def _accept(self, item: Received[T]) -> None:
        if item.name in self._unseen:
            self._counters.dropped += 1
        self._unseen.add(item.name)
        self._unread.pop(item.name, None)  # so that the longest unread name comes first
        self._newest[item.name] = self._unread[item.name] = item

    def _take(self) -> Received[T] | None:
        for name in self._unread:
            self._unseen.discard(name)
            return self._unread.pop(name)
        return None


class Every(Inbox[T]):
    """A bounded queue; when it is full the oldest goes, and is counted."""

    def __init__(
        self,
        kind: type[T],
        prefix: int,
        clock: Clock,
        loop: asyncio.AbstractEventLoop,
        counters: Counters,
        where: str,
        depth: int = 64,
    ) -> None:
        super().__init__(kind, prefix, clock, loop, counters, where, depth)
        self._queue: deque[Received[T]] = deque(maxlen=depth)

    def drain(self) -> list[Received[T]]:
        """All that waits, oldest first, without waiting."""
        if self._raw:
            self._sort()
        items = list(self._queue)
        self._queue.clear()
        return items

    def _sort_key(self, key: str, filed: list[_Filed]) -> None:
        for sample in filed:
            item = self._open(key, *sample)
            if item is not None:
                self._accept(item)

    def _accept(self, item: Received[T]) -> None:
        if len(self._queue) == self._queue.maxlen:
            self._counters.dropped += 1
        self._queue.append(item)

    def _take(self) -> Received[T] | None:
        return self._queue.popleft() if self._queue else None
