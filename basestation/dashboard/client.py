"""One browser: what is sent to it, and what comes from it. A slow one gets the newest state and no backlog."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from typing import Any, Final, Protocol

import msgspec
from starlette.websockets import WebSocket, WebSocketDisconnect

from basestation.dashboard.access import Right
from basestation.dashboard.allowance import Allowance
from basestation.dashboard.frames import Frames
from basestation.dashboard.requests import BadMessage

MOST_BYTES: Final = 16_384
"""Size of a message that is taken [bytes]."""

_RATES: Final = {Right.VIEW: (10.0, 50.0), Right.STEER: (100.0, 200.0)}
"""Messages that are taken [1/s], and at once: a viewer's are stops, and pictures."""

_MOST_BAD: Final = 20
"""A client that has sent more invalid messages is disconnected."""

_MOST_REPLIES: Final = 64
"""Replies that wait; the oldest goes, for a client that does not read them."""

_SEND_TIMEOUT: Final = 15.0
"""A client that takes nothing for this time is disconnected [s]."""

TOO_MANY, TOO_LARGE, NOT_ADMITTED, GOING = 4008, 4009, 4401, 1012
"""Codes with which a connection is closed."""


class Taker(Protocol):
    """Takes what a client sends."""

    def take(self, client: Client, data: bytes) -> None:
        """Take a message.

        Args:
            client: whose.
            data: the message.

        Raises:
            BadMessage: it is none.
        """
        ...

    def leave(self, client: Client) -> None:
        """Forget a client that is gone.

        Args:
            client: which.
        """
        ...


class Client:
    """A connected browser.

    Args:
        socket: its WebSocket, accepted.
        right: what it may do.
        frames: the states.
        hello: the message that it gets first.

    Attributes:
        right: what it may do.
        number: counts the clients of this process.
        cameras: the cameras whose pictures it wants.
    """

    _count = 0

    def __init__(self, socket: WebSocket, right: Right, frames: Frames, hello: bytes) -> None:
        Client._count += 1
        self.number = Client._count
        self.right = right
        self.cameras: set[str] = set()
        self._socket = socket
        self._frames = frames
        self._hello: bytes | None = hello
        self._replies: deque[bytes] = deque(maxlen=_MOST_REPLIES)
        self._pictures: dict[str, bytes] = {}
        self._wake = asyncio.Event()
        self._seq = 0
        self._revision = -1
        self._allowance = Allowance(*_RATES[right])
        self._bad = 0

    # ---- what others give it; none of this waits

    def greet(self, hello: bytes) -> None:
        """Send it another greeting, in place of one that it has not got yet.

        Args:
            hello: the message.
        """
        self._hello = hello
        self._wake.set()

    def tick(self) -> None:
        """There is a new state."""
        self._wake.set()

    def reply(self, **values: Any) -> None:
        """Send it a reply.

        Args:
            values: its content.
        """
        self._replies.append(msgspec.msgpack.encode({"kind": "reply", **values}))
        self._wake.set()

    def picture(self, camera: str, packed: bytes) -> None:
        """Send it a picture, in place of an older one that it has not got yet.

        Args:
            camera: whose.
            packed: the message.
        """
        self._pictures[camera] = packed
        self._wake.set()

    @property
    def waiting(self) -> int:
        """The size of what waits for it besides the states, of which none does [bytes]."""
        return sum(map(len, self._replies)) + sum(map(len, self._pictures.values()))

    # ---- its two tasks

    async def serve(self, taker: Taker) -> None:
        """Send and receive until one of the two ends.

        Args:
            taker: takes what it sends.
        """
        sending = asyncio.create_task(self._send(), name=f"send to client {self.number}")
        receiving = asyncio.create_task(self._receive(taker), name=f"receive from client {self.number}")
        try:
            await asyncio.wait({sending, receiving}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            taker.leave(self)
            for task in (sending, receiving):
                task.cancel()
            await asyncio.wait({sending, receiving})
            if not receiving.cancelled():
                receiving.result()
            if not sending.cancelled() and not isinstance(sending.exception(), _CLOSED):
                sending.result()

    async def _send(self) -> None:
        while True:
            await self._wake.wait()
            self._wake.clear()
            if self._hello is not None:
                hello, self._hello = self._hello, None
                await self._put(hello)
            while self._replies:
                await self._put(self._replies.popleft())
            if self._seq != self._frames.seq:
                self._seq, revision, self._revision = self._frames.seq, self._revision, self._frames.revision
                await self._put(self._frames.since(revision))
            while self._pictures:
                await self._put(self._pictures.pop(next(iter(self._pictures))))

    async def _put(self, data: bytes) -> None:
        async with asyncio.timeout(_SEND_TIMEOUT):
            await self._socket.send_bytes(data)

    async def _receive(self, taker: Taker) -> None:
        while True:
            message = await self._socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            if not self._allowance.take():
                await self._end(TOO_MANY, f"more than {_RATES[self.right][0]:g} messages a second")
                return
            data = message.get("bytes")
            if data is None or len(data) > MOST_BYTES:
                await self._end(TOO_LARGE, f"expected binary messages of at most {MOST_BYTES} bytes")
                return
            try:
                taker.take(self, data)
            except BadMessage as error:
                self._bad += 1
                self.reply(id=None, order="", outcome="refused", reason=str(error))
                if self._bad > _MOST_BAD:
                    await self._end(TOO_MANY, f"{self._bad} invalid messages: {error}"[:100])
                    return

    async def _end(self, code: int, reason: str) -> None:
        with contextlib.suppress(*_CLOSED):
            await self._socket.close(code, reason)


_CLOSED: Final = (WebSocketDisconnect, RuntimeError, TimeoutError)
"""What sending raises once a client is gone, or takes nothing."""
