"""Mailboxes between the middleware's threads and the event loop.

A callback files bytes and returns. A waiting task is woken once for everything filed in the meantime; a mailbox where
no task waits wakes nothing. Decoding is done on the loop, after coalescing. Every mailbox is bounded, and counts
what it drops and what it rejects.
"""

from __future__ import annotations

import asyncio
import logging
import math
import threading
from abc import abstractmethod
from collections.abc import Coroutine
from typing import Any, Generic, NamedTuple, Self, TypeVar

from muro_zenoh.channels import NAME_PATTERN
from muro_zenoh.errors import MessageError, TransportError
from muro_zenoh.messages import Message, check_encoding, decoder, encoding_of
from muro_zenoh.runtime.clock import Clock
from muro_zenoh.transport.clock_offset import KnownClocks
from muro_zenoh.transport.delay import DelayTracker
from muro_zenoh.transport.link import Declared
from muro_zenoh.transport.received import Counters, Received

log = logging.getLogger(__name__)

T = TypeVar("T", bound=Message)

_MAX_KEYS = 1024
"""Keys that a mailbox of ``*`` remembers at most: a writer of ever new keys must not fill the memory ..."""

_SILENT = 60.0
"""... nor keep others out for good: a key that has been silent for longer than this gives way to a new one [s]. While
there is room, silence makes a mailbox forget nobody: the backlog that ends a long freeze would count as fresh."""

_EPISODE = 10.0
"""Bad messages of a key are logged once in this time at most [s]."""

_MAX_STRANGERS = 32
"""Keys whose bad messages are logged before they have sent a good one: a writer of ever new keys must fill neither the
memory nor the log."""

Filed = tuple[bytes, str | None, float]
"""Payload, encoding, arrival."""


class Slot(NamedTuple, Generic[T]):
    """What a mailbox is put up for.

    ``kind`` of its messages; ``prefix``: length of the key up to the name; ``clock`` for arrival times; ``loop``: where
    it is read; ``counters``, shared by all mailboxes of a channel; ``where``: the key, for error messages;
    ``stale_after``: age at which a message no longer counts [s], infinite where its stamp does not matter; ``clocks``:
    other processes', as far as they were measured.
    """

    kind: type[T]
    prefix: int
    clock: Clock
    loop: asyncio.AbstractEventLoop
    counters: Counters
    where: str
    stale_after: float
    clocks: KnownClocks


class Inbox(Declared, Generic[T]):
    """What :class:`Latest` and :class:`Every` share: filing, waking, counting.

    Args:
        slot: what it is put up for.
        depth: raw samples of a key that wait for the loop at most.
    """

    def __init__(self, slot: Slot[T], depth: int) -> None:
        super().__init__()
        self._kind = slot.kind
        self._encoding = encoding_of(slot.kind)
        self._decode = decoder(slot.kind)
        self._prefix = slot.prefix
        self._now = slot.clock.now
        self._loop = slot.loop
        self._counters = slot.counters
        self._where = slot.where
        self._stale_after = slot.stale_after
        self._clocks = slot.clocks
        self._depth = depth
        self._loop_thread = threading.get_ident()
        self._lock = threading.Lock()
        self._raw: dict[str, list[Filed]] = {}
        self._awake = False
        self._delays: dict[str, DelayTracker] = {}
        self._waiter: asyncio.Future[None] | None = None
        self._episodes: dict[str, float] = {}  # keys of which a bad message was logged: when

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
                    self._displaced()
                    del filed[0]
                filed.append((payload, encoding, arrival))
            if self._awake or self._waiter is None:
                return
            self._awake = True
        if threading.get_ident() == self._loop_thread:  # from an in-memory link: the loop is awake
            self._wake()
            return
        try:  # noqa: SIM105 - suppress() costs a microsecond on the path of every message
            self._loop.call_soon_threadsafe(self._wake)
        except RuntimeError:
            pass  # Zenoh calls back after undeclare() until its backlog is drained; a closed loop wants none of it

    # ---- on the loop

    def hand(self, key: str, message: T) -> None:
        """Take a message that this process itself sends, without encoding."""
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
                if not self._raw:  # else something was filed before there was a waiter to wake
                    await self._waiter
            finally:
                self._waiter = None

    def __aiter__(self) -> Self:
        return self

    def __anext__(self) -> Coroutine[Any, Any, Received[T]]:
        return self.next()

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
    def _displaced(self) -> None:
        """Count a message that gave way to newer ones before anybody read it."""

    @abstractmethod
    def _sort_key(self, key: str, filed: list[Filed]) -> None:
        """Decode one key's samples."""

    @abstractmethod
    def _accept(self, item: Received[T]) -> None:
        """Keep a decoded message."""

    @abstractmethod
    def _take(self) -> Received[T] | None:
        """The next unread message, or None."""

    def _open(self, key: str, payload: bytes, encoding: str | None, arrival: float) -> Received[T] | None:
        """The message in a sample, or None when it is none: counted, and logged once per episode of its key.

        An episode ends with a good message, but lasts at least :data:`_EPISODE`, so that good and bad ones in turn do
        not fill the log.
        """
        tracker = self._delays.get(key)
        counters = self._counters
        try:
            if tracker is None:
                self._check_key(key)
            if encoding != self._encoding:
                check_encoding(encoding, self._kind)
            message = self._decode(payload)
            if tracker is None:
                self._make_room(arrival)
                tracker = self._delays[key] = DelayTracker()
            epoch, clocks = message.epoch, self._clocks
            delay = tracker.observe(epoch, message.stamp, arrival, clocks.offset(epoch, arrival), clocks.steps(epoch))
            if delay < 0.0:
                if self._stale_after < math.inf:
                    raise MessageError(f"got a stamp {-delay:.3g} s ahead of its writer's clock, expected its time")
                delay = 0.0
        except MessageError as error:
            counters.rejected += 1
            if key not in self._episodes and (tracker is not None or len(self._episodes) < _MAX_STRANGERS):
                self._episodes[key] = arrival
                log.warning("%s: dropped a message: %s (logged once until good ones come)", key, error)
            return None
        if self._episodes and abs(arrival - self._episodes.get(key, arrival)) > _EPISODE:
            del self._episodes[key]
        if delay > self._stale_after:
            counters.late += 1
        counters.delay = delay
        counters.arrival = arrival
        return Received(key[self._prefix :], message, arrival, delay, tracker.least, tracker.measured)

    def _check_key(self, key: str) -> None:
        name = key[self._prefix :]
        if name and not NAME_PATTERN.fullmatch(name):
            raise MessageError(f"got the name {name!r} in the key, expected one such as 'r1'")

    def _make_room(self, now: float) -> None:
        """For one more key, in place of those that have been silent for long."""
        if len(self._delays) < _MAX_KEYS:
            return
        for key in [key for key, tracker in self._delays.items() if now - tracker.heard > _SILENT]:
            del self._delays[key]
            self._episodes.pop(key, None)
            self._forget(key[self._prefix :])
        if len(self._delays) >= _MAX_KEYS:
            raise MessageError(f"got a {_MAX_KEYS + 1}th writer's key, expected at most {_MAX_KEYS}")

    def _forget(self, name: str) -> None:
        """Drop what is known of a name."""

    def _notify(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)
