"""The web server: the page's files, and a WebSocket for each browser that has it open."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import msgspec
import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.responses import PlainTextResponse
from starlette.routing import Mount, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from basestation.dashboard.access import PROTOCOL, Access, Right
from basestation.dashboard.client import MOST_BYTES, NOT_ADMITTED, Client, Taker
from basestation.dashboard.connections import HttpConnection, WebSocketConnection
from basestation.dashboard.frames import Frames

STATIC: Final = Path(__file__).parent / "static"

_MOST_CLIENTS: Final = 64

_FOR_OPERATORS: Final = 8
"""Of these, the places that viewers leave free."""

_PING_PERIOD: Final = 5.0
"""A client that is gone without a word is noticed within twice this time [s]."""

_LEAVE_TIMEOUT: Final = 1.0

_HEADERS: Final = (
    # What the page runs is its own; it connects to nobody else, and no other page may frame it.
    (
        b"content-security-policy",
        b"default-src 'self'; connect-src 'self'; img-src 'self' blob: data:; "
        b"style-src 'self' 'unsafe-inline'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    ),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cache-control", b"no-cache"),
)


class Clients:
    """The browsers that are connected.

    Args:
        access: who may.
        frames: the states.
        hello: what a client gets first, without what it may do.
        taker: takes what they send.
    """

    def __init__(self, access: Access, frames: Frames, hello: dict[str, Any], taker: Taker) -> None:
        self._access = access
        self._frames = frames
        self._hello = hello
        self._taker = taker
        self._clients: set[Client] = set()

    def __iter__(self) -> Iterator[Client]:
        return iter(self._clients)

    def __len__(self) -> int:
        return len(self._clients)

    def tick(self) -> None:
        """There is a new state."""
        for client in self._clients:
            client.tick()

    def change_hello(self, **values: Any) -> None:
        """Change what is said first, and say it to everyone again.

        Args:
            values: what has changed.
        """
        if all(self._hello.get(key) == value for key, value in values.items()):
            return
        self._hello = {**self._hello, **values}
        for client in self._clients:
            client.greet(self._greeting(client.right))

    def _greeting(self, right: Right) -> bytes:
        return msgspec.msgpack.encode({**self._hello, "may_steer": right is Right.STEER})

    async def serve(self, websocket: WebSocket) -> None:
        """Serve one browser until it is gone.

        Args:
            websocket: its connection.
        """
        right = self._access.right(websocket.scope.get("subprotocols", ()))
        await websocket.accept(PROTOCOL if PROTOCOL in websocket.scope.get("subprotocols", ()) else None)
        if right is Right.NONE:
            await websocket.close(NOT_ADMITTED, "a token is required: open the link that was printed at the start")
            return
        most = _MOST_CLIENTS - (_FOR_OPERATORS if right is Right.VIEW else 0)
        if len(self._clients) >= most:
            await websocket.close(NOT_ADMITTED, f"{len(self._clients)} pages are open, which is the most")
            return
        client = Client(websocket, right, self._frames, self._greeting(right))
        self._clients.add(client)
        client.tick()
        try:
            await client.serve(self._taker)
        finally:
            self._clients.discard(client)


class _Checked:
    """Refuses requests to other hosts and WebSockets of other pages, and adds headers to answers."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app = app
        self._access = access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {key: value.decode("latin-1") for key, value in scope["headers"]}
        host, origin = headers.get(b"host", ""), headers.get(b"origin")
        admitted = self._access.admits_host(host) and (
            scope["type"] == "http" or self._access.admits_origin(origin, host)
        )
        if not admitted:
            if scope["type"] == "websocket":
                await receive()
                await send({"type": "websocket.close", "code": 1008})
                return
            text = f"got the host {host!r}, expected {self._access.address.text}: open {self._access.address.url}\n"
            await PlainTextResponse(text, 403)(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *_HEADERS]
            await send(message)

        await self._app(scope, receive, with_headers)


def make_app(clients: Clients, access: Access) -> Starlette:
    """The application.

    Args:
        clients: the browsers that are connected.
        access: who may.
    """
    files = StaticFiles(directory=STATIC, html=True)
    routes = [WebSocketRoute("/ws", clients.serve), Mount("/", files)]
    return Starlette(routes=routes, middleware=[Middleware(_Checked, access=access)])


class _Server(uvicorn.Server):
    """uvicorn, whose signals are the process's: the main task is cancelled, and everything with it."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


async def serve(app: ASGIApp, listening: socket.socket) -> None:
    """Serve until cancelled.

    Args:
        app: the application.
        listening: the socket.
    """
    config = uvicorn.Config(
        app,
        lifespan="off",
        log_config=None,
        http=HttpConnection,
        access_log=False,
        ws=WebSocketConnection,
        ws_max_size=4 * MOST_BYTES,
        ws_per_message_deflate=False,
        ws_ping_interval=_PING_PERIOD,
        ws_ping_timeout=_PING_PERIOD,
        limit_concurrency=4 * _MOST_CLIENTS,
        timeout_graceful_shutdown=1,
        date_header=False,
        server_header=False,
    )
    server = _Server(config)
    try:
        await server.serve(sockets=[listening])
    finally:
        await _leave(server)
        listening.close()


async def _leave(server: uvicorn.Server) -> None:
    """Close what a server that was cancelled has open: uvicorn itself would wait for its clients."""
    for one in getattr(server, "servers", ()):
        one.close()
    for connection in list(server.server_state.connections):
        connection.shutdown()
    tasks = set(server.server_state.tasks)
    if tasks:  # each ends by itself once its connection is closed
        _, left = await asyncio.wait(tasks, timeout=_LEAVE_TIMEOUT)
        for task in left:
            task.cancel()
