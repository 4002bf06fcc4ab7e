"""Clients of the page that are slow, gone, hostile or many: none of them delays the page, a robot or another client."""

from __future__ import annotations

import asyncio
import contextlib
import random
from collections.abc import AsyncIterator
from typing import Any

import msgpack
import pytest
from websockets.exceptions import ConnectionClosed

from basestation.dashboard import hands, server
from basestation.dashboard.client import MOST_BYTES
from muro_zenoh.config import parse_scenario
from tests.support.page import TOKENS, PageClient, PageFleet, page_fleet
from tests.support.waiting import seconds

ORDERS: list[dict[str, Any]] = [
    {"order": "stop", "id": 1, "names": ["r1"]},
    {"order": "resume", "id": 2, "names": [], "revision": 7},
    {"order": "goal", "id": 3, "name": "r1", "x": 0.5, "y": -0.25, "theta": None},
    {"order": "behaviour", "id": 4, "behaviour": "circle", "parameters": {"speed": 0.1}, "names": ["r2"]},
    {"order": "circle", "id": 5, "x": 0.1, "y": 0.0, "radius": 0.7, "clockwise": True},
    {"order": "clear", "id": 6, "name": "r2"},
    {"order": "drive", "id": 7, "name": "r1", "v": 0.1, "omega": -0.2, "t": 1.7e9},
    {"order": "picture", "id": 8, "camera": "north", "on": True},
    {"order": "break", "id": 9, "kind": "delay", "target": "r1/agent", "duration": 1.0, "numbers": {"delay": 0.1}},
]

ODD: list[Any] = [
    None,
    True,
    -1,
    2**64 - 1,
    1e308,
    float("nan"),
    float("inf"),
    "",
    "r1",
    "x" * 200,
    b"\x00" * 20,
    [],
    {},
]


def mutated(rng: random.Random) -> bytes:
    """An order with something wrong: a value, a key, or its bytes."""
    order = dict(rng.choice(ORDERS))
    for _ in range(rng.randint(1, 3)):
        how = rng.randrange(4)
        key = rng.choice(list(order)) if order else "order"
        if how == 0:
            order[key] = rng.choice(ODD)
        elif how == 1:
            order.pop(key, None)
        elif how == 2:
            order[rng.choice(["x", "names", "__class__", "operator", "epoch"])] = rng.choice(ODD)
        else:
            order = {key: order}
    data = bytearray(msgpack.packb(order))
    for _ in range(rng.choice((0, 0, 1, 2, 8))):
        how, at = rng.randrange(3), rng.randrange(len(data))
        if how == 0:
            data[at] = rng.randrange(256)
        elif how == 1:
            del data[at:]
        else:
            data[at:at] = rng.randbytes(rng.randint(1, 40))
        if not data:
            break
    return bytes(data)


TABLE = {
    "robots": 2,
    "camera": {"north": {"width": 640, "height": 480}},
    "behaviour": {"name": "pursuit"},
}


@pytest.fixture
async def fleet() -> AsyncIterator[PageFleet]:
    async with page_fleet(parse_scenario(TABLE, "lab.toml", name="lab")) as there:
        yield there


async def gets_states(client: PageClient, number: int = 10) -> None:
    before = client.states
    await client.until(lambda: client.states >= before + number or client.closed, 10.0, "states")
    assert not client.closed


async def test_ten_thousand_mutated_frames(fleet: PageFleet) -> None:
    """Over as many connections as it takes: a client that sends more than a few is disconnected."""
    rng, sent, connections = random.Random(10), 0, 0
    async with fleet.client(TOKENS.viewer) as bystander:
        await gets_states(bystander)
        while sent < 10_000:
            connections += 1
            async with fleet.client() as client:
                for _ in range(100):
                    try:
                        await client.socket.send(mutated(rng))
                    except ConnectionClosed:
                        break
                    sent += 1
                else:
                    await asyncio.sleep(0)
            if connections % 20 == 0:
                await gets_states(bystander, 1)
        assert connections >= 100
        await gets_states(bystander)
        assert len(fleet.dashboard.clients) == 1
    async with fleet.client() as client:
        reply = await client.order("stop")
        assert reply["receipt"]["confirmed"]
        assert (await client.resume())["outcome"] == "taken"
        assert not fleet.processes["basestation"].done()


async def test_ten_thousand_mutated_orders_are_read(fleet: PageFleet) -> None:
    """All of them by the desk itself, without a limit of how many: the fleet goes on, and each is answered."""
    rng = random.Random(11)
    async with fleet.client() as client:
        await gets_states(client)
        inner = next(iter(fleet.dashboard.clients))
        wrong = 0
        for number in range(10_000):
            try:
                fleet.dashboard.desk.take(inner, mutated(rng))
            except Exception as error:
                assert type(error).__name__ == "BadMessage", repr(error)  # noqa: PT017 - any other is the failure
                wrong += 1
            if number % 200 == 0:
                await asyncio.sleep(0)
        assert wrong > 5_000
        await gets_states(client)
        client.ids = 1000  # above those of the mutated ones
        reply = await client.order("stop")
        assert reply["receipt"]["confirmed"]


async def test_garbage_in_place_of_a_websocket(fleet: PageFleet) -> None:
    rng = random.Random(12)
    head = f"GET /ws HTTP/1.1\r\nHost: {fleet.address.text}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    keys = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    async with fleet.client() as bystander:
        for number in range(200):
            reader, writer = await asyncio.open_connection(*fleet.address)
            data = bytearray((head + keys).encode())
            if number % 2:
                data[rng.randrange(len(data))] = rng.randrange(256)
            writer.write(bytes(data) + rng.randbytes(rng.randint(0, 300)))
            writer.close()
            await writer.wait_closed()
        del reader
        await gets_states(bystander)


@pytest.mark.parametrize(
    ("message", "code"), [(b"\x00" * (MOST_BYTES + 1), 4009), (b"\x00" * (8 * MOST_BYTES), 1009), ("text", 4009)]
)
async def test_what_is_too_large_or_text_is_disconnected(fleet: PageFleet, message: bytes | str, code: int) -> None:
    async with fleet.client() as client:
        await client.socket.send(message)
        await client.until(lambda: client.closed, 5.0, "closed")
        assert client.closed is not None
        assert client.closed[0] == code


async def test_a_client_that_floods_is_disconnected_and_others_are_not(fleet: PageFleet) -> None:
    async with fleet.client() as client, fleet.client() as other:
        await gets_states(other)
        with contextlib.suppress(ConnectionClosed):
            for _ in range(100_000):
                await client.socket.send(msgpack.packb({"order": "picture", "id": 1, "camera": "north", "on": False}))
        await client.until(lambda: client.closed, 5.0, "closed")
        assert client.closed is not None
        assert client.closed[0] == 4008
        await gets_states(other)


async def test_a_client_that_is_cut_off_drives_nobody(fleet: PageFleet, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its connection is noticed to be gone, long before what it said last would be over."""
    monkeypatch.setattr(hands, "LASTS", seconds(20.0))
    async with fleet.client() as other:
        async with fleet.client() as client:
            assert (await client.order("behaviour", behaviour="manual", names=["r1"]))["outcome"] == "taken"
            await client.until(lambda: client.details("r1").get("behaviour") == "manual", 5.0, "by hand")
            await client.until(lambda: "nobody has driven it" in client.details("r1")["reason"], 10.0, "it waits")

            async def drive() -> None:
                while True:
                    await client.drive("r1", 0.2, 0.0)
                    await asyncio.sleep(0.1)

            driving = asyncio.create_task(drive())
            await client.until(lambda: fleet.wheels("r1")[0] > 0.1, 10.0, "it drives")
            refused = await other.order("drive", name="r1", v=0.1, omega=0.0, t=other.state["t"])
            assert refused["reason"] == "r1 is driven from another page"
            driving.cancel()
            client.socket.transport.abort()
        await other.until(lambda: fleet.wheels("r1") == (0.0, 0.0), 5.0, "zero wheels")
        await other.until(lambda: other.details("r1")["state"] == "holding", 5.0, "shown as holding")


async def test_a_robot_that_is_not_driven_by_hand_says_so(fleet: PageFleet) -> None:
    async with fleet.client() as client:
        await client.until(lambda: client.details("r1").get("behaviour") == "pursuit", 10.0, "a behaviour")
        reply = await client.order("drive", name="r1", v=0.1, omega=0.0, t=client.state["t"])
        assert (reply["outcome"], reply["reason"]) == ("refused", "r1 runs pursuit: choose the behaviour manual first")
        before = len(client.replies)
        for _ in range(5):
            await client.drive("r1", 0.1, 0.0)
        await gets_states(client)
        assert len(client.replies) <= before + 1  # once a second is enough


async def test_viewers_leave_places_for_operators(fleet: PageFleet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "_MOST_CLIENTS", 4)
    monkeypatch.setattr(server, "_FOR_OPERATORS", 2)
    async with contextlib.AsyncExitStack() as stack:

        async def opens(token: str) -> PageClient:
            client = await stack.enter_async_context(fleet.client(token))
            await client.until(lambda: client.hello or client.closed, 5.0, "a greeting")
            return client

        viewers = [await opens(TOKENS.viewer) for _ in range(3)]
        assert [viewer.closed is None for viewer in viewers] == [True, True, False]
        assert "2 pages are open" in viewers[2].closed[1]  # type: ignore[index]
        operators = [await opens(TOKENS.operator) for _ in range(3)]
        assert [operator.closed is None for operator in operators] == [True, True, False]


async def test_viewers_may_send_less(fleet: PageFleet) -> None:
    """They order nothing but stops, each of which is on the bus, and pictures."""
    async with fleet.client(TOKENS.viewer) as viewer, fleet.client() as operator:
        for client in (viewer, operator):
            with contextlib.suppress(ConnectionClosed):
                for _ in range(100):
                    await client.send("picture", camera="north", on=False)
        await viewer.until(lambda: viewer.closed, 5.0, "closed")
        assert viewer.closed is not None
        assert viewer.closed == (4008, "more than 10 messages a second")
        await gets_states(operator)


async def test_many_clients_get_the_same(fleet: PageFleet) -> None:
    async with asyncio.TaskGroup() as tasks:

        async def look() -> None:
            async with fleet.client() as client:
                await gets_states(client, 20)
                assert client.state["robots"].keys() == {"r1", "r2"}

        for _ in range(10):
            tasks.create_task(look())
    async with asyncio.timeout(seconds(5.0)):
        while len(fleet.dashboard.clients):  # noqa: ASYNC110 - the server notices on its own
            await asyncio.sleep(0.02)
