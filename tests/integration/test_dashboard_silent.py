"""Clients of the page that do not read, and connections on which nothing is asked: they cost little, and go."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from basestation.dashboard import client as client_module
from basestation.dashboard import connections, server
from basestation.dashboard.client import Client
from basestation.dashboard.connections import WebSocketConnection
from muro_zenoh.config import parse_scenario
from tests.integration.test_dashboard_clients import TABLE, gets_states
from tests.support.page import PageClient, PageFleet, page_fleet
from tests.support.waiting import seconds


@pytest.fixture
async def fleet() -> AsyncIterator[PageFleet]:
    async with page_fleet(parse_scenario(TABLE, "lab.toml", name="lab")) as there:
        yield there


class Sleeper:
    """A client that does not read, by a socket: nothing reads it behind our back.

    Attributes:
        socket: what it may send with.
        client: what the page has of it.
        connection: what uvicorn has of it.
    """

    socket: socket.socket
    client: Client
    connection: WebSocketConnection

    @classmethod
    @contextlib.asynccontextmanager
    async def connected(cls, fleet: PageFleet, other: PageClient) -> AsyncIterator[Sleeper]:
        """One that is connected, as another client sees."""
        request = (
            f"GET /ws HTTP/1.1\r\nHost: {fleet.address.text}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
        )
        there, loop = cls(), asyncio.get_running_loop()
        with socket.socket() as there.socket:
            there.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            there.socket.setblocking(False)
            await loop.sock_connect(there.socket, tuple(fleet.address))
            await loop.sock_sendall(there.socket, request.encode())
            await other.until(lambda: len(fleet.dashboard.clients) == 2, 5.0, "two clients")
            there.client = max(fleet.dashboard.clients, key=lambda one: one.number)
            there.connection = opened[-1]
            yield there

    @property
    def buffered(self) -> int:
        """What waits for it in the process besides what the page knows of [bytes]."""
        return self.connection.transport.get_write_buffer_size()

    @property
    def is_gone(self) -> bool:
        """Whether the server has nothing of it any more."""
        return self.connection not in self.connection.connections and self.connection.transport.is_closing()

    def fill(self) -> None:
        """Give it more than it could be sent in a second."""
        for _ in range(100):
            self.client.picture("north", b"\x00" * 100_000)
            self.client.reply(id=1, order="stop", outcome="taken", reason="")
            self.client.tick()


opened: list[WebSocketConnection] = []
"""The WebSockets of this test, as uvicorn has them."""


@pytest.fixture(autouse=True)
def _noted(monkeypatch: pytest.MonkeyPatch) -> None:
    class Noted(WebSocketConnection):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            super().connection_made(transport)
            opened.append(self)

    opened.clear()
    monkeypatch.setattr(server, "WebSocketConnection", Noted)


async def test_a_client_that_stops_reading_costs_a_bounded_buffer(fleet: PageFleet) -> None:
    """It is not read from at all: what the system and the server have for it fills up, and that is all."""
    async with fleet.client() as other, Sleeper.connected(fleet, other) as sleeper:
        for _ in range(50):  # more than all that it could be sent in a minute
            sleeper.fill()
            assert sleeper.client.waiting <= 100_000 + 64 * 200
            await asyncio.sleep(0.0)
        await gets_states(other, 20)
        assert 100_000 < sleeper.client.waiting <= 100_000 + 64 * 200, "it is still asleep"
        assert 0 < sleeper.buffered <= 65_536 + 2 * 100_000
        assert len(fleet.dashboard.clients) == 2


async def test_a_client_that_does_not_read_is_forgotten_with_all_that_waits_for_it(
    fleet: PageFleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client_module, "_SEND_TIMEOUT", 0.3)
    monkeypatch.setattr(connections, "_CLOSE_TIMEOUT", 0.2)
    async with fleet.client() as other, Sleeper.connected(fleet, other) as sleeper:

        def is_gone() -> bool:
            sleeper.fill()
            return sleeper.is_gone

        await other.until(is_gone, 10.0, "the sleeper is gone")
        assert sleeper.buffered == 0
        assert len(fleet.dashboard.clients) == 1
        await gets_states(other)


@pytest.mark.parametrize(
    "frame",
    [b"\x89\xe4mask" + bytes(100), b"\x8a\xe4mask" + bytes(100), b"\x00\x80mask"],
    ids=["pings", "pongs", "empty parts of a message"],
)
async def test_frames_that_are_no_message_are_counted(fleet: PageFleet, frame: bytes) -> None:
    """Also of a client that does not read: the answers to its pings would wait without end."""
    async with fleet.client() as other, Sleeper.connected(fleet, other) as sleeper:
        loop = asyncio.get_running_loop()
        await loop.sock_sendall(sleeper.socket, b"\x02\x80mask")  # a message that goes on
        sent, most = 0, 0
        with contextlib.suppress(ConnectionError):
            async with asyncio.timeout(seconds(10.0)):
                while True:
                    await loop.sock_sendall(sleeper.socket, 100 * frame)
                    sent, most = sent + 100, max(most, sleeper.buffered)
                    await asyncio.sleep(0.0)
        assert sent <= 20_000
        assert most <= 65_536
        await other.until(lambda: sleeper.is_gone, 5.0, "the sleeper is gone")
        await gets_states(other)


async def test_a_connection_without_a_request_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    """And one of a page that sends nothing is not."""
    monkeypatch.setattr(connections, "_REQUEST_TIMEOUT", 0.5)
    monkeypatch.setattr(connections, "_MOST_LOOKS", 1_000_000)
    async with page_fleet(parse_scenario(TABLE, "lab.toml", name="lab")) as fleet, fleet.client() as client:
        await gets_states(client)
        for said in (b"", b"GET /ws HTTP/1.1\r\n"):
            reader, writer = await asyncio.open_connection(*fleet.address)
            writer.write(said)
            async with asyncio.timeout(seconds(10.0)):
                assert await reader.read() == b""
            writer.close()
        reader, writer = await asyncio.open_connection(*fleet.address)
        writer.write(f"GET / HTTP/1.1\r\nHost: {fleet.address.text}\r\n\r\n".encode())
        async with asyncio.timeout(seconds(10.0)):
            head = await reader.readuntil(b"\r\n\r\n")
            await reader.readexactly(int(head.lower().partition(b"content-length: ")[2].split()[0]))
            writer.write(b"G")  # of another request, of which nothing else comes
            assert await reader.read() == b""
        writer.close()
        await gets_states(client)


async def test_an_answer_that_nobody_reads_is_dropped(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "large").write_bytes(bytes(20_000_000))
    monkeypatch.setattr(server, "STATIC", tmp_path)
    monkeypatch.setattr(connections, "_REQUEST_TIMEOUT", 0.1)
    async with page_fleet(parse_scenario(TABLE, "lab.toml", name="lab")) as fleet, fleet.client() as client:
        await gets_states(client)
        with socket.create_connection(tuple(fleet.address)) as asleep:
            asleep.sendall(f"GET /large HTTP/1.1\r\nHost: {fleet.address.text}\r\n\r\n".encode())
            await client.until(lambda: len(opened[0].connections) == 2, 5.0, "another connection")
            await client.until(lambda: len(opened[0].connections) == 1, 10.0, "it is gone")
        await gets_states(client)
