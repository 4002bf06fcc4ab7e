"""A TCP relay between a process and the router, whose link can be delayed, stalled and partitioned.

A stream of TCP loses and reorders nothing, so neither can the relay. What waits in it stays in order: a piece that is
delayed by less than the one before it leaves with that one, as in a real network. An idle relay costs nothing, and one
without faults hands each piece on as it comes.
"""

from __future__ import annotations

import asyncio
import enum
import random
from collections import deque
from dataclasses import dataclass
from types import TracebackType
from typing import cast

HOST = "127.0.0.1"

_MOST_WAITING = 32_000_000
"""The relay reads no further while this much waits in one direction [bytes]."""


class Passage(enum.IntEnum):
    """What passes a link in one direction, the worst last."""

    OPEN = 0
    """Everything."""
    STALLED = 1
    """Nothing for now; everything late, when it opens again."""
    PARTITIONED = 2
    """Nothing, and neither side is notified. What was under way is lost: when it opens again, connections are reset."""


@dataclass(frozen=True, slots=True)
class Conditions:
    """The state of a link in one direction.

    Attributes:
        delay: least delay of each piece, to a tick of the loop's clock, which is 1 ms with uvloop [s].
        jitter: the longest of the random, uniform times that are added to it [s].
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

    Attributes:
        inward: the state of the link from the router to the process.
        outward: the same, from the process to the router.
        ends: the ends of its connections, for :class:`_End` and for tests.
    """

    def __init__(self, seed: int = 1) -> None:
        self.inward = self.outward = GOOD
        self.ends: set[_End] = set()
        self._random = random.Random(seed)
        self._router = HOST, 0
        self._connecting: set[asyncio.Task[None]] = set()

    @property
    def endpoint(self) -> str:
        """The endpoint that the process connects to."""
        host, port = self._server.sockets[0].getsockname()
        return f"tcp/{host}:{port}"

    @property
    def partitioned(self) -> bool:
        """Whether what is sent in one of the directions is lost."""
        return Passage.PARTITIONED in (self.inward.passage, self.outward.passage)

    def lead_to(self, host: str, port: int) -> None:
        """Connect the process to this router from now on.

        Args:
            host: the router's host.
            port: its port.
        """
        self._router = host, port

    def set(self, inward: Conditions, outward: Conditions) -> None:
        """Change the state of the link.

        Args:
            inward: from the router to the process, from now on.
            outward: from the process to the router, from now on.
        """
        was_partitioned = self.partitioned
        self.inward, self.outward = inward, outward
        if was_partitioned and not self.partitioned:
            self._reset()
        for end in list(self.ends):
            end.adapt()

    def delay(self, conditions: Conditions) -> float:
        """The delay of one piece, drawn anew each time [s].

        Args:
            conditions: of its direction.
        """
        return conditions.delay + self._random.uniform(0.0, conditions.jitter)

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
        self._inward = other is None
        self._early: list[bytes] = []
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[tuple[float, bytes]] = deque()
        self._size = 0
        self._latest = 0.0
        self._timer: asyncio.TimerHandle | None = None
        self._choked = False
        self._ending = False
        self._gone = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        # uvloop's transports have the interface, not the class.
        self._transport = transport = cast(asyncio.Transport, transport)
        self._relay.ends.add(self)
        other = self._other
        if other is None:  # the process has connected
            transport.pause_reading()
            if not self._relay.partitioned:
                self._relay.connect(self)
        elif other not in self._relay.ends:  # the process has left
            self.abort()
        else:
            other._other = self
            for data in other._early:
                self.send(data)
            other._early.clear()
            self.adapt()
            other.adapt()

    def data_received(self, data: bytes) -> None:
        if self._other is not None:
            self._other.send(data)
        else:  # not yet connected; uvloop reads on although connection_made() has paused it
            self._early.append(data)
            self._transport.pause_reading()

    def connection_lost(self, error: Exception | None) -> None:
        self._gone = True
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
        if self._gone:
            return
        conditions = self._conditions
        if not self._waiting and conditions == GOOD:
            self._transport.write(data)
            return
        # Not before the piece before it: a stream keeps its order.
        self._latest = max(self._latest, self._loop.time() + self._relay.delay(conditions))
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
        """Reset the connection; what waits is lost. Its end is noted later; from now on nothing is sent."""
        self._gone = True
        self._stop_timer()
        self._transport.abort()

    def adapt(self) -> None:
        """Adapt to the state of the link, and of the other end."""
        if self._gone:
            return
        other = self._other
        if self._conditions.passage is Passage.PARTITIONED:
            self._waiting.clear()
            self._size = 0
        if other is not None and other._takes_more:
            self._transport.resume_reading()
        else:
            self._transport.pause_reading()
        self._stop_timer()
        self._set_timer()

    # ---- the queue

    @property
    def _conditions(self) -> Conditions:
        """Those of what leaves through this end."""
        return self._relay.inward if self._inward else self._relay.outward

    @property
    def _takes_more(self) -> bool:
        open_ = self._conditions.passage is Passage.OPEN
        return open_ and not self._choked and self._size <= _MOST_WAITING

    def _adapt_other(self) -> None:
        if self._other is not None and self._other in self._relay.ends:
            self._other.adapt()

    def _set_timer(self) -> None:
        if self._timer is None and self._waiting and self._conditions.passage is Passage.OPEN:
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
