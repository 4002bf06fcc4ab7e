"""What is no message is counted and dropped; a stranger's message is taken. On the in-memory bus and on Zenoh alike."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import os

import msgpack
import msgspec
import pytest

from muro_zenoh import channels
from muro_zenoh.errors import NoReply
from muro_zenoh.messages import Frame, Reply, SetBehaviour, SpeedReference, encode, encoding_of
from muro_zenoh.transport import Bus, MemoryNetwork, make_bus
from tests.contract.conftest import Network
from tests.contract.helpers import Box, linked, plain, until
from tests.support.clock import ManualClock
from tests.support.waiting import seconds, within

_NOW = 1.7e9
BAD = {
    "noise": os.urandom(200),
    "a megabyte of noise": os.urandom(2**20),
    "nothing": b"",
    "not a map": msgpack.packb([1.0, 2.0]),
    "an unknown field": msgpack.packb({"stamp": _NOW, "speed": 0.1, "colour": "red"}),
    "a missing field": msgpack.packb({"stamp": _NOW}),
    "text for a number": msgpack.packb({"stamp": _NOW, "speed": "fast"}),
    "NaN": msgpack.packb({"stamp": _NOW, "speed": math.nan}),
    "infinity": msgpack.packb({"stamp": _NOW, "speed": -math.inf}),
    "a stamp of infinity": msgpack.packb({"stamp": math.inf, "speed": 0.1}),
    "no stamp": msgpack.packb({"speed": 0.1}),
    "a stamp of zero": msgpack.packb({"stamp": 0.0, "speed": 0.1}),
    "a negative seq": msgpack.packb({"stamp": _NOW, "seq": -1, "speed": 0.1}),
    "half a message": msgpack.packb({"stamp": _NOW, "speed": 0.1})[:-3],
    "two messages": 2 * msgpack.packb({"stamp": _NOW, "speed": 0.1}),
    "an array a thousand deep": b"\x91" * 1000,
    "an array a million deep": b"\x91" * 1_000_000,
}


@pytest.mark.parametrize("kind", ["latest", "every"])
@pytest.mark.parametrize("what", BAD)
async def test_an_invalid_message_is_counted_and_dropped(network: Network, what: str, kind: str) -> None:
    reader = await network.open()
    key = f"{network.realm}/velocity/r1"
    box: Box = reader.latest(channels.VELOCITY, "r1") if kind == "latest" else reader.every(channels.VELOCITY, "r1")
    await linked(lambda v: network.put(key, plain(v)), box)
    counters = reader.counters["velocity"]
    received, rejected = counters.received, counters.rejected
    waiting = asyncio.create_task(box.next())
    network.put(key, BAD[what])
    await until(lambda: counters.rejected == rejected + 1, "one rejected")
    network.put(key, plain(0.5))
    assert (await within(2, waiting, "the good one after it")).message.speed == 0.5
    assert counters.received == received + 2
    assert counters.rejected == rejected + 1


@pytest.mark.parametrize(
    "encoding",
    ["application/msgpack;SpeedReference.2", "application/msgpack;Goal.1", "application/json", "text/plain"],
)
async def test_another_version_or_encoding_is_refused(network: Network, encoding: str) -> None:
    reader = await network.open()
    key = f"{network.realm}/velocity/r1"
    box = reader.every(channels.VELOCITY, "r1")
    await linked(lambda v: network.put(key, plain(v)), box)
    network.put(key, plain(0.1), encoding)
    network.put(key, plain(0.2), encoding_of(SpeedReference))
    assert (await within(2, box.next(), "the good one")).message.speed == 0.2
    assert reader.counters["velocity"].rejected == 1


@pytest.mark.parametrize("encoding", [None, "application/msgpack", "application/octet-stream"])
async def test_a_writer_that_sends_no_version_is_accepted(network: Network, encoding: str | None) -> None:
    reader = await network.open()
    key = f"{network.realm}/velocity/r1"
    box = reader.latest(channels.VELOCITY, "r1")
    await linked(lambda v: network.put(key, plain(v), encoding), box)
    network.put(key, plain(0.3), encoding)
    got = await within(2, box.next(), "the stranger's message")
    assert (got.name, got.message.speed, got.message.seq) == ("r1", 0.3, 0)
    assert reader.counters["velocity"].rejected == 0


async def test_garbage_in_the_same_burst_does_not_displace_a_good_message(network: Network) -> None:
    reader = await network.open()
    key = f"{network.realm}/velocity/r1"
    box = reader.latest(channels.VELOCITY, "r1")
    await linked(lambda v: network.put(key, plain(v)), box)
    counters = reader.counters["velocity"]
    received = counters.received
    network.put(key, plain(0.7))
    for _ in range(3):
        network.put(key, b"garbage")
    await until(lambda: counters.received == received + 4, "all four, in a mailbox that nobody waits at yet")
    assert (await within(2, box.next(), "the good one")).message.speed == 0.7
    assert counters.rejected == 3


async def test_a_rejected_message_is_logged_once_per_episode(
    network: Network, caplog: pytest.LogCaptureFixture
) -> None:
    reader = await network.open()
    key = f"{network.realm}/velocity/r1"
    box = reader.every(channels.VELOCITY, "r1")
    await linked(lambda v: network.put(key, plain(v)), box)
    with caplog.at_level(logging.WARNING):
        for episode in (1, 2):  # of less than ten seconds each: one for the log
            for _ in range(20):
                network.put(key, b"garbage")
            network.put(key, plain(episode))
            await within(2, box.next(), "the good one")
    (said,) = [r for r in caplog.records if r.name.startswith("muro_zenoh")]
    assert "velocity/r1" in said.getMessage()


async def test_garbage_under_a_wildcard_on_ever_new_keys_fills_no_memory(network: Network) -> None:
    reader = await network.open()
    box = reader.every(channels.VELOCITY, "*")
    await linked(lambda v: network.put(f"{network.realm}/velocity/r1", plain(v)), box)
    counters = reader.counters["velocity"]
    received = counters.received
    for i in range(3000):
        network.put(f"{network.realm}/velocity/x{i}", b"garbage")
        if i % 100 == 0:
            await asyncio.sleep(0.002)
    await until(lambda: counters.received == received + 3000, "all of them")
    assert len(box._raw) <= 1024
    assert box.drain() == []
    assert counters.rejected == 3000
    assert len(box._delays) == 1
    network.put(f"{network.realm}/velocity/r1", plain(0.5))
    assert (await within(2, box.next(), "the good one")).message.speed == 0.5


async def test_good_messages_on_ever_new_keys_fill_no_memory(network: Network) -> None:
    reader = await network.open()
    box = reader.latest(channels.VELOCITY, "*")
    await linked(lambda v: network.put(f"{network.realm}/velocity/r1", plain(v)), box)
    counters = reader.counters["velocity"]
    received = counters.received
    for i in range(1500):
        network.put(f"{network.realm}/velocity/x{i}", plain(0.1))
        if i % 100 == 0:
            await asyncio.sleep(0.002)
    await until(lambda: counters.received == received + 1500, "all of them")
    assert len(box.values()) == 1024
    network.put(f"{network.realm}/velocity/r1", plain(0.5))
    await until(lambda: (got := box.get("r1")) is not None and got.message.speed == 0.5, "the one that was known")
    assert len(box._delays) == len(box.values()) == 1024


async def test_a_key_that_was_silent_for_a_minute_gives_way_to_a_new_one(network: Network) -> None:
    clock = ManualClock()
    reader = await network.open(clock)
    box = reader.latest(channels.VELOCITY, "*")
    await linked(lambda v: network.put(f"{network.realm}/velocity/r1", plain(v)), box)
    counters = reader.counters["velocity"]

    async def put(names: list[str]) -> None:
        received = counters.received
        for i, name in enumerate(names):
            network.put(f"{network.realm}/velocity/{name}", plain(0.1))
            if i % 100 == 0:
                await asyncio.sleep(0.002)
        await until(lambda: counters.received == received + len(names), "all of them")
        box.values()

    await put([f"x{i}" for i in range(1100)])
    assert len(box.values()) == 1024
    clock.advance(59.0)
    await put(["r1", "r2"])
    assert "r2" not in box.values()  # who was there a moment ago is still there
    clock.advance(2.0)
    await put(["r3"])
    assert set(box.values()) == {"r1", "r3"}


async def test_silence_alone_makes_a_mailbox_forget_nobody(network: Network) -> None:
    clock = ManualClock()
    reader = await network.open(clock)
    box = reader.every(channels.VELOCITY, "*")
    await linked(lambda v: network.put(f"{network.realm}/velocity/r1", plain(v)), box)
    key = f"{network.realm}/velocity/r1"
    network.put(key, plain(0.1, stamp=1000.0))
    await within(2, box.next(), "the one before the freeze")
    clock.advance(600.0)
    network.put(f"{network.realm}/velocity/r2", plain(0.2))
    network.put(key, plain(0.1, stamp=1001.0))
    backlog = [await within(2, box.next(), "what was sent in the freeze") for _ in range(2)]
    assert {got.name: got.delay > 500.0 for got in backlog} == {"r1": True, "r2": False}


@pytest.mark.parametrize(("size", "rejected"), [(8 * 2**20, 0), (8 * 2**20 + 1, 1)])
async def test_a_payload_is_taken_up_to_8_mib(size: int, rejected: int) -> None:
    network, unread = MemoryNetwork(), []
    async with make_bus(network.link()) as reader:
        box = reader.every(channels.CAMERA, "north")
        frame = Frame(stamp=_NOW, width=4096, height=2048, format="grey", data=b"")
        payload = encode(msgspec.structs.replace(frame, data=bytes(size - len(encode(frame)) - 3)))
        assert len(payload) == size
        network.put("muro/camera/north", payload)
        unread = box.drain()
        assert (len(unread), reader.counters["camera"].rejected) == (1 - rejected, rejected)


async def test_an_order_of_more_than_8_mib_is_refused_unread(network: Network) -> None:
    base, operator = await network.open(), await network.open()
    base.answer(channels.SET_BEHAVIOUR, lambda order: Reply(accepted=True))
    await asked(operator)
    order = SetBehaviour(behaviour="x" * (8 * 2**20))
    reply = await within(10, operator.ask(channels.SET_BEHAVIOUR, order, timeout=seconds(5)), "the answer")
    assert not reply.accepted
    assert "expected at most 8388608" in reply.reason


async def asked(bus: Bus) -> None:
    """Return when small orders are answered."""
    while True:
        with contextlib.suppress(NoReply):
            await bus.ask(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="hold"))
            return


@pytest.mark.parametrize("name", ["R1", "a b", "x" * 33, "9"])
async def test_an_invalid_name_is_refused(network: Network, name: str) -> None:
    reader = await network.open()
    box = reader.every(channels.VELOCITY, "*")
    await linked(lambda v: network.put(f"{network.realm}/velocity/r1", plain(v)), box)
    network.put(f"{network.realm}/velocity/{name}", plain(0.1))
    network.put(f"{network.realm}/velocity/r1", plain(0.2))
    assert (await within(2, box.next(), "the good one")).message.speed == 0.2
    assert reader.counters["velocity"].rejected == 1


async def test_messages_made_by_the_codec_and_by_msgpack_are_the_same(network: Network) -> None:
    reader = await network.open()
    key = f"{network.realm}/velocity/r1"
    box = reader.every(channels.VELOCITY, "r1")
    await linked(lambda v: network.put(key, plain(v)), box)
    message = SpeedReference(stamp=_NOW, seq=4, epoch=7, speed=0.5)
    network.put(key, encode(message))
    network.put(key, msgpack.packb({"speed": 0.5, "epoch": 7, "seq": 4, "stamp": _NOW}))
    assert [(await within(2, box.next(), "it")).message for _ in range(2)] == [message, message]
