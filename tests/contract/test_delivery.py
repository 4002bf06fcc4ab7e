"""Messages find their readers, and nobody starves another. On the in-memory bus and on Zenoh alike."""

from __future__ import annotations

import asyncio
import os
import time

import msgpack
import pytest

from muro_zenoh import channels
from muro_zenoh.messages import (
    Health,
    StopOrder,
    encoding_of,
)
from tests.contract.conftest import Network
from tests.contract.helpers import linked, plain, speed, until
from tests.support.waiting import seconds, within

# ---- delivery


async def test_a_message_arrives_as_it_was_sent(network: Network) -> None:
    writer, reader = await network.open(), await network.open()
    box = reader.latest(channels.VELOCITY, "r1")
    out = writer.publisher(channels.VELOCITY, "r1")
    await linked(lambda v: out.put(speed(v)), box)
    sent = out.put(speed(0.25))
    got = await within(2, box.next(), "the message")
    assert got.message == sent
    assert got.name == "r1"
    assert got.message.epoch == writer.epoch
    assert got.message.stamp == pytest.approx(time.time(), abs=seconds(2))


async def test_seq_counts_one_writers_messages(network: Network) -> None:
    writer, reader = await network.open(), await network.open()
    box = reader.every(channels.VELOCITY, "r1")
    out = writer.publisher(channels.VELOCITY, "r1")
    await linked(lambda v: out.put(speed(v)), box)
    sent = [out.put(speed(i)).seq for i in range(5)]
    got = [(await within(2, box.next(), "a message")).message.seq for _ in range(5)]
    assert got == sent == list(range(sent[0], sent[0] + 5))


async def test_a_slow_consumer_gets_the_newest_and_starves_nobody(network: Network) -> None:
    writer, reader = await network.open(), await network.open()
    slow = reader.latest(channels.VELOCITY, "r1")
    quick = reader.every(channels.VELOCITY, "r2", depth=1000)
    out1, out2 = writer.publisher(channels.VELOCITY, "r1"), writer.publisher(channels.VELOCITY, "r2")
    await linked(lambda v: out1.put(speed(v)), slow)
    await linked(lambda v: out2.put(speed(v)), quick)
    read: list[float] = []

    async def consume() -> None:
        async for got in slow:
            read.append(got.message.speed)
            if got.message.speed == 300.0:
                return
            await asyncio.sleep(0.05)

    consuming = asyncio.create_task(consume())
    for i in range(1, 301):
        out1.put(speed(i))
        out2.put(speed(i))
        await asyncio.sleep(0.001)
    fast = [(await within(2, quick.next(), "the other key")).message.speed for _ in range(300)]
    await within(2, consuming, "the newest")
    assert fast == list(range(1, 301))
    assert read[-1] == 300.0
    assert len(read) < 100
    assert read == sorted(read)


async def test_a_blocked_loop_finds_the_newest_afterwards(network: Network) -> None:
    writer, reader = await network.open(), await network.open()
    box = reader.latest(channels.VELOCITY, "r1")
    out = writer.publisher(channels.VELOCITY, "r1")
    await linked(lambda v: out.put(speed(v)), box)
    for i in range(1, 101):
        out.put(speed(i))
        time.sleep(0.001)  # noqa: ASYNC251 - a task that does not give way, on purpose
    await until(lambda: (got := box.get()) is not None and got.message.speed == 100.0, "the newest")
    assert (await within(1, box.next(), "the newest")).message.speed == 100.0


async def test_an_inbox_that_nobody_reads_starves_nobody(network: Network) -> None:
    writer, reader = await network.open(), await network.open()
    unread = reader.every(channels.VELOCITY, "r1", depth=8)
    box = reader.every(channels.VELOCITY, "r2", depth=1000)
    out1, out2 = writer.publisher(channels.VELOCITY, "r1"), writer.publisher(channels.VELOCITY, "r2")
    await linked(lambda v: out1.put(speed(v)), unread)
    await linked(lambda v: out2.put(speed(v)), box)
    before = reader.counters["velocity"].dropped
    for i in range(500):
        out1.put(speed(i))
        out2.put(speed(i))
        await asyncio.sleep(0.001 if i % 50 == 49 else 0)  # Zenoh drops what is more than it has room for
    assert [(await within(2, box.next(), "the other key")).message.speed for _ in range(500)] == list(range(500))
    await until(lambda: reader.counters["velocity"].dropped == before + 492, "492 dropped of 500, with room for 8")
    assert [got.message.speed for got in unread.drain()] == list(range(492, 500))


async def test_two_mailboxes_of_one_key_each_get_every_message(network: Network) -> None:
    writer, reader = await network.open(), await network.open()
    one, other = reader.every(channels.VELOCITY, "r1"), reader.every(channels.VELOCITY, "*")
    out = writer.publisher(channels.VELOCITY, "r1")
    await linked(lambda v: out.put(speed(v)), one, other)
    one.drain()
    other.drain()
    out.put(speed(1.0))
    assert (await within(2, one.next(), "one")).message.speed == 1.0
    assert (await within(2, other.next(), "the other")).message.speed == 1.0


async def test_a_wildcard_hears_everybody_and_keeps_them_apart(network: Network) -> None:
    writer, reader = await network.open(), await network.open()
    before = writer.publisher(channels.VELOCITY, "r1")
    box = reader.latest(channels.VELOCITY, "*")
    after = writer.publisher(channels.VELOCITY, "r2")
    await linked(lambda v: (before.put(speed(v)), after.put(speed(v))), box)
    before.put(speed(1.0))
    after.put(speed(2.0))
    await until(
        lambda: {n: got.message.speed for n, got in box.values().items()} == {"r1": 1.0, "r2": 2.0},
        "the newest of both",
    )
    for name, value in (("r1", 1.0), ("r2", 2.0)):
        got = box.get(name)
        assert got is not None
        assert got.message.speed == value


async def test_what_is_forgotten_is_gone_until_it_is_heard_again(network: Network) -> None:
    writer, reader = await network.open(), await network.open()
    box = reader.latest(channels.VELOCITY, "*")
    out = writer.publisher(channels.VELOCITY, "r1")
    await linked(lambda v: out.put(speed(v)), box)
    received = reader.counters["velocity"].received
    out.put(speed(1.0))
    await until(lambda: reader.counters["velocity"].received == received + 1, "the message")
    box.forget("r1")
    assert box.get("r1") is None
    assert box.values() == {}
    out.put(speed(2.0))
    assert (await within(2, box.next(), "the next")).message.speed == 2.0


async def test_another_realm_is_separate(network: Network) -> None:
    writer, reader = await network.open(), await network.open()
    box = reader.latest(channels.VELOCITY, "r1")
    out = writer.publisher(channels.VELOCITY, "r1")
    await linked(lambda v: out.put(speed(v)), box)
    received = reader.counters["velocity"].received
    network.put(f"{network.realm}2/velocity/r1", plain(7.0))
    network.put(f"{network.realm}/velocity/r1", plain(8.0))
    assert (await within(2, box.next(), "our realm's")).message.speed == 8.0
    assert reader.counters["velocity"].received == received + 1


async def test_what_was_put_before_closing_arrives(network: Network) -> None:
    writer, reader = await network.open(), await network.open()
    box = reader.latest(channels.VELOCITY, "r1")
    out = writer.publisher(channels.VELOCITY, "r1")
    await linked(lambda v: out.put(speed(v)), box)
    out.put(speed(0.0))
    await writer.close()
    assert (await within(2, box.next(), "the last message")).message.speed == 0.0


async def test_a_big_message_arrives(network: Network) -> None:
    from muro_zenoh.messages import Frame

    writer, reader = await network.open(), await network.open()
    box = reader.latest(channels.CAMERA, "north")
    out = writer.publisher(channels.CAMERA, "north")
    picture = os.urandom(1280 * 720)
    frame = Frame(width=1280, height=720, format="grey", data=picture)

    async def send() -> None:
        while True:
            out.put(frame)
            await asyncio.sleep(0.05)

    sending = asyncio.create_task(send())
    try:
        assert (await within(5, box.next(), "the frame")).message.data == picture
    finally:
        sending.cancel()


# ---- counters and taps


async def test_the_counters_add_up(network: Network) -> None:
    writer, reader = await network.open(), await network.open()
    box = reader.latest(channels.VELOCITY, "r1")
    out = writer.publisher(channels.VELOCITY, "r1")
    await linked(lambda v: out.put(speed(v)), box)
    counters = reader.counters["velocity"]
    received, replaced = counters.received, counters.replaced
    for i in range(1, 201):
        out.put(speed(i))
        if i % 10 == 0:
            await asyncio.sleep(0.001)
    await until(lambda: counters.received == received + 200, "all of them")
    assert (await within(1, box.next(), "the newest")).message.speed == 200.0
    assert counters.replaced == replaced + 199  # one was read; the others were displaced
    assert counters.dropped == 0
    assert counters.rejected == 0
    assert 0.0 <= counters.delay < seconds(1.0)
    numbers = reader.numbers()
    assert numbers["velocity_received"] == counters.received
    assert numbers["velocity_replaced"] == counters.replaced
    assert 0.0 <= numbers["velocity_age_s"] < seconds(2.0)
    assert numbers["velocity_delay_s"] == pytest.approx(counters.delay, abs=1e-4)
    assert "velocity_rejected" not in numbers
    assert "circle_received" not in numbers


async def test_no_delay_that_a_stranger_claims_is_too_large_for_a_health_report(network: Network) -> None:
    writer, reader = await network.open(), await network.open()
    box = reader.latest(channels.VELOCITY, "r1")
    out = writer.publisher(channels.VELOCITY, "r1")
    await linked(lambda v: out.put(speed(v)), box)
    reader.counters["velocity"].delay = 1.0000000000000491e12
    health = Health(role="basestation", state="running", numbers=reader.numbers())
    assert health.numbers["velocity_delay_s"] == 1e12


async def test_what_the_middleware_does_not_take_is_counted(network: Network) -> None:
    writer = await network.open()
    out = writer.publisher(channels.VELOCITY, "r1")
    out.put(speed(0.1))
    assert "velocity_unsent" not in writer.numbers()
    await writer._link.close()
    out.put(speed(0.2))
    of_the_process = ("cpu_s", "memory_mb")  # what it uses; there is none in memory
    assert {what: n for what, n in writer.numbers().items() if what not in of_the_process} == {"velocity_unsent": 1}


async def test_a_tap_sees_the_bytes_of_any_key(network: Network) -> None:
    bus, writer = await network.open(), await network.open()
    tap = bus.tap(f"{network.realm}/**", depth=4)
    stop = writer.publisher(channels.STOP)
    arrived = asyncio.Event()

    async def send() -> None:
        while not arrived.is_set():
            stop.put(StopOrder(all=True, revision=1))
            await asyncio.sleep(0.02)

    sending = asyncio.create_task(send())
    async for sample in tap:
        arrived.set()
        assert sample.key == f"{network.realm}/stop"
        assert sample.encoding == encoding_of(StopOrder)
        assert msgpack.unpackb(sample.payload)["revision"] == 1
        break
    await sending
    for _ in range(50):
        stop.put(StopOrder(all=False))
    await until(lambda: tap.dropped >= 46, "the oldest dropped, with room for 4")
