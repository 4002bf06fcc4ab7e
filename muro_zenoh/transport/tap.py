"""An undecoded view of the bus: any key's bytes."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from typing import NamedTuple

from muro_zenoh.errors import TransportError
from muro_zenoh.runtime.clock import Clock
from muro_zenoh.transport.link import Declared, call_on


class Sample(NamedTuple):
    """Bytes of some key. ``arrival`` is by our clock [s]."""

    key: str
    payload: bytes
    encoding: str | None
    arrival: float


class Waiting(Declared):
    """One waiter, woken from any thread."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__()
        self._loop = loop
        self._event = asyncio.Event()

    def _notify(self) -> None:
        self._event.set()

    async def _wait(self) -> None:
        await self._event.wait()
        if not self._closed:
            self._event.clear()
        else:
            raise TransportError("the bus was closed while a task waited on it")


class Tap(Waiting):
    """Samples of any key, in a bounded queue; the oldest goes when it is full, and is counted in ``dropped``."""

    def __init__(self, loop: asyncio.AbstractEventLoop, clock: Clock, depth: int) -> None:
        super().__init__(loop)
        self.dropped = 0
        self._clock = clock
        self._lock = threading.Lock()
        self._queue: deque[Sample] = deque(maxlen=depth)
        self._awake = False

    def file(self, key: str, payload: bytes, encoding: str | None) -> None:
        """Take a sample from the middleware; from any thread."""
        with self._lock:
            if len(self._queue) == self._queue.maxlen:
                self.dropped += 1
            self._queue.append(Sample(key, payload, encoding, self._clock.now()))
            wake = not self._awake
            self._awake = True
        if wake:
            call_on(self._loop, self._notify)

    def __aiter__(self) -> Tap:
        return self

    async def __anext__(self) -> Sample:
        while True:
            with self._lock:
                if self._queue:
                    return self._queue.popleft()
                self._awake = False
            await self._wait()
