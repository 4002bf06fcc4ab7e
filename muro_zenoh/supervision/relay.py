"""A TCP relay between a process and the router, whose link can be delayed, stalled, partitioned or reset.

A stream of TCP loses and reorders nothing, so neither can the relay. What waits in it stays in order: a piece that is
delayed by less than the one before it leaves with that one, as in a real network. An idle relay costs nothing, and one
without faults hands each piece on as it comes.
"""

from __future__ import annotations

import asyncio
import contextlib
import enum
import random
from collections import deque
from dataclasses import dataclass
from types import TracebackType

HOST = "127.0.0.1"

_MOST_WAITING = 32_000_000
"""The relay reads no further while this much waits in one direction [bytes]."""


class Passage(enum.IntEnum):
    """What passes a link, the worst last."""

    OPEN = 0
    """Everything."""
    STALLED = 1
    """Nothing for now; everything late, when it opens again."""
    PARTITIONED = 2
    """Nothing, and neither side is notified. What was under way is lost: when it opens again, connections are reset."""
    RESET = 3
    """Nothing: connections are reset, and new ones as soon as they are made."""


@dataclass(frozen=True, slots=True)
class Conditions:
    """The state of a link, the same in both directions.

    Attributes:
        delay: mean delay of each piece [s].
        jitter: each piece's own delay differs from it by up to this [s].
        passage: what passes.
    """

    delay: float = 0.0
    jitter: float = 0.0
    passage: Passage = Passage.OPEN


GOOD = Conditions()
"""A link without faults."""


class Relay:
    """Relays the connections of one process while its ``async with`` block runs.

    Args:
        seed: of the jitter.
    """

    def __init__(self, seed: int = 1) -> None:
        self.conditions = GOOD
        self.ends: set[_End] = set()
        self._random = random.Random(seed)
        self._router = HOST, 0
        self._connecting: set[asyncio.Task[None]] = set()

    @property
    def endpoint(self) -> str:
        """The endpoint that the process connects to."""
        host, port = self._server.sockets[0].getsockname()
        return f"tcp/{host}:{port}"

    def lead_to(self, host: str, port: int) -> None:
        """Connect the process to this router from now on.

        Args:
            host: the router's host.
            port: its port.
        """
        self._router = host, port

    def set(self, conditions: Conditions) -> None:
        """Change the state of the link.

        Args:
            conditions: its state from now on.
        """
        before, self.conditions = self.conditions, conditions
        healed = before.passage is Passage.PARTITIONED and conditions.passage is not Passage.PARTITIONED
        if healed or conditions.passage is Passage.RESET:
            self._reset()
        for end in list(self.ends):
            end.adapt()

    def delay(self) -> float:
        """The delay of one piece, drawn anew each time [s]."""
        delay, jitter = self.conditions.delay, self.conditions.jitter
        return max(0.0, delay + self._random.uniform(-jitter, jitter)) if jitter else delay

    async def __aenter__(self) -> Relay:
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(self._accepted, HOST, 0)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.close()
        self._reset()
        if self._connecting:
            await asyncio.wait(self._connecting)

    def _accepted(self) -> _End:
        return _End(self)

    def connect(self, end: _End) -> None:
        """Connect a new connection of the process to the router.

        Args:
            end: its end at the process.
        """
        task = asyncio.create_task(self._connect(end), name="relay connects")
        self._connecting.add(task)
        task.add_done_callback(self._connecting.discard)

    async def _connect(self, end: _End) -> None:
        loop = asyncio.get_running_loop()
        try:
            await loop.create_connection(lambda: _End(self, end), *self._router)
        except OSError:  # no router there: as if it had refused the process itself
            end.abort()

    def _reset(self) -> None:
        for task in self._connecting:
            task.cancel()
        for end in list(self.ends):
            end.abort()


class _End(asyncio.Protocol):
    """One of the two ends of a connection, and what waits to leave through it."""

    def __init__(self, relay: Relay, other: _End | None = None) -> None:
        self._relay = relay
        self._other = other
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[tuple[float, bytes]] = deque()
        self._size = 0
        self._latest = 0.0
        self._timer: asyncio.TimerHandle | None = None
        self._choked = False
        self._ending = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._relay.ends.add(self)
        other = self._other
        if other is None:  # the process has connected
            if self._relay.conditions.passage is Passage.RESET:
                self.abort()
                return
            transport.pause_reading()
            if self._relay.conditions.passage is not Passage.PARTITIONED:
                self._relay.connect(self)
        elif other not in self._relay.ends:  # the process has left
            self.abort()
        else:
            other._other = self
            self.adapt()
            other.adapt()

    def data_received(self, data: bytes) -> None:
        if self._other is not None:
            self._other.send(data)

    def connection_lost(self, error: Exception | None) -> None:
        self._relay.ends.discard(self)
        self._stop_timer()
        self._waiting.clear()
        if self._other is not None:
            self._other.end(error)

    def pause_writing(self) -> None:
        self._choked = True
        self._adapt_other()

    def resume_writing(self) -> None:
        self._choked = False
        self._adapt_other()

    # ---- called by the other end and the relay

    def send(self, data: bytes) -> None:
        """Send a piece through this end when it is due."""
        if not self._waiting and self._relay.conditions == GOOD:
            self._transport.write(data)
            return
        # Not before the piece before it: a stream keeps its order.
        self._latest = max(self._latest, self._loop.time() + self._relay.delay())
        self._waiting.append((self._latest, data))
        self._size += len(data)
        if self._size > _MOST_WAITING:
            self._adapt_other()
        self._set_timer()

    def end(self, error: Exception | None) -> None:
        """The other end has been closed: close this one after what waits has left."""
        self._ending = True
        if error is not None:
            self.abort()
        elif not self._waiting:
            self._transport.close()

    def abort(self) -> None:
        """Reset the connection; what waits is lost."""
        self._transport.abort()

    def adapt(self) -> None:
        """Adapt to the state of the link, and of the other end."""
        passage, other = self._relay.conditions.passage, self._other
        if passage is Passage.PARTITIONED:
            self._waiting.clear()
            self._size = 0
        if passage is Passage.OPEN and other is not None and not other._choked and other._size <= _MOST_WAITING:
            self._transport.resume_reading()
        else:
            self._transport.pause_reading()
        self._stop_timer()
        self._set_timer()

    # ---- the queue

    def _adapt_other(self) -> None:
        if self._other is not None and self._other in self._relay.ends:
            self._other.adapt()

    def _set_timer(self) -> None:
        if self._timer is None and self._waiting and self._relay.conditions.passage is Passage.OPEN:
            self._timer = self._loop.call_at(self._waiting[0][0], self._flush)

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _flush(self) -> None:
        self._timer = None
        now, was_full = self._loop.time(), self._size > _MOST_WAITING
        while self._waiting and self._waiting[0][0] <= now:
            _, data = self._waiting.popleft()
            self._size -= len(data)
            self._transport.write(data)
        if was_full and self._size <= _MOST_WAITING:
            self._adapt_other()
        if self._ending and not self._waiting:
            self._transport.close()
        self._set_timer()
