"""What is no message is counted and dropped; a stranger's message is taken. On the in-memory bus and on Zenoh alike."""

from __future__ import annotations

import asyncio
import logging
import math
import os

import msgpack
import pytest

from muro_zenoh import channels
from muro_zenoh.messages import (
    SpeedReference,
    encode,
    encoding_of,
)
from tests.contract.conftest import Network
from tests.contract.helpers import Box, linked, plain, until
from tests.support.waiting import within

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
        for episode in (1, 2):
            for _ in range(20):
                network.put(key, b"garbage")
            network.put(key, plain(episode))
            await within(2, box.next(), "the good one")
            said = [r for r in caplog.records if r.name.startswith("muro_zenoh")]
            assert len(said) == episode
            assert "velocity/r1" in said[-1].getMessage()


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
