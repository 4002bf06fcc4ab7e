"""uvicorn's connections, which let go of clients that ask for nothing, do not read, or send what is no message."""

from __future__ import annotations

import asyncio
from typing import Any, Final

from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame

from basestation.dashboard.allowance import Allowance

_REQUEST_TIMEOUT: Final = 5.0
"""A connection on which no request has come for this time is closed [s]."""

_MOST_LOOKS: Final = 12
"""It is looked at as often as that, a time of :data:`_REQUEST_TIMEOUT` apart, until its client has read an answer."""

_CLOSE_TIMEOUT: Final = 2.0
"""What is left for a client that is disconnected is dropped after this time [s]."""

_FRAME_RATE: Final = 5.0
_FRAME_BURST: Final = 50.0
"""Frames that are no message and are taken [1/s], and at once."""


class HttpConnection(H11Protocol):
    """A connection with requests. Each counts against the most that there may be, so none may last for ever."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._look_later(0)

    def connection_lost(self, exc: Exception | None) -> None:
        self._looking.cancel()
        super().connection_lost(exc)

    def _look_later(self, looks: int) -> None:
        self._looking = self.loop.call_later(_REQUEST_TIMEOUT, self._look, self.cycle, looks)

    def _look(self, before: object, looks: int) -> None:
        """Close it when no other request has come since the last look. uvicorn itself closes it when nothing comes, but
        takes any byte for the beginning of a request."""
        if self.transport.get_protocol() is not self:  # it is a WebSocket by now
            return
        looks = looks + 1 if self.cycle is before else 0
        if looks >= _MOST_LOOKS:
            self.transport.abort()
        elif looks and (self.cycle is None or self.cycle.response_complete):
            self.transport.close()
        self._look_later(looks)


class WebSocketConnection(WebSocketsSansIOProtocol):
    """A connection with a WebSocket.

    uvicorn answers pings whether anybody reads the answers or not, and when it closes, it waits without end until the
    client has read what is left.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._allowance = Allowance(_FRAME_RATE, _FRAME_BURST)

    def handle_ping(self) -> None:
        if self._allows():
            super().handle_ping()

    def handle_pong(self, event: Frame) -> None:
        if self._allows():
            super().handle_pong(event)

    def handle_cont(self, event: Frame) -> None:
        if self._allows():
            super().handle_cont(event)

    def on_task_complete(self, task: asyncio.Task[None]) -> None:
        super().on_task_complete(task)
        self.loop.call_later(_CLOSE_TIMEOUT, self.transport.abort)

    def _allows(self) -> bool:
        allowed = self._allowance.take()
        if not allowed:
            self.transport.abort()
        return allowed
