"""What a process sends itself is handed over within it. On the in-memory bus and on Zenoh alike."""

from __future__ import annotations

import asyncio

import pytest

from muro_zenoh import channels
from muro_zenoh.messages import (
    Calibration,
    PoseFix,
)
from tests.contract.conftest import Network
from tests.contract.helpers import linked, odometry, plain, speed, until
from tests.support.clock import ManualClock
from tests.support.waiting import within

COVARIANCE = (1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 1e-5)


async def test_what_a_bus_sends_itself_is_handed_over_once(network: Network) -> None:
    bus, other = await network.open(), await network.open()
    out = bus.publisher(channels.VELOCITY, "r1")
    here, there = bus.every(channels.VELOCITY, "r1"), other.every(channels.VELOCITY, "r1")
    await linked(lambda v: out.put(speed(v)), there)
    here.drain()
    counters = bus.counters["velocity"]
    received = counters.received
    sent = [out.put(speed(i)) for i in range(3)]
    assert [got.message for got in here.drain()] == sent
    for message in sent:
        assert (await within(2, there.next(), "the other bus")).message == message
    # what had come back through the router would have come before this one
    out.put(speed(9.0))
    assert (await within(2, there.next(), "the other bus")).message.speed == 9.0
    assert [got.message.speed for got in here.drain()] == [9.0]
    assert counters.received == received + 4


async def test_a_kept_value_is_handed_over_once_too(network: Network) -> None:
    bus, other = await network.open(), await network.open()
    box = bus.every(channels.CAL_OMEGA, "r1")
    out = bus.publisher(channels.CAL_OMEGA, "r1")
    out.put(Calibration(value=1.0, sigma=0.1))
    others = other.latest(channels.CAL_OMEGA, "r1")
    await within(2, others.next(), "the kept value")  # the late joiner's question has come to us and been answered
    other.publisher(channels.CAL_OMEGA, "r1").put(Calibration(value=2.0, sigma=0.1))
    got = [await within(2, box.next(), "a value") for _ in range(2)]
    assert [item.message.value for item in got] == [1.0, 2.0]
    assert box.drain() == []


async def test_what_an_outsider_sent_before_is_older(network: Network) -> None:
    bus = await network.open()
    box = bus.latest(channels.VELOCITY, "r1")
    out = bus.publisher(channels.VELOCITY, "r1")
    await linked(lambda v: network.put(f"{network.realm}/velocity/r1", plain(v)), box)
    received = bus.counters["velocity"].received
    network.put(f"{network.realm}/velocity/r1", plain(1.0))
    await until(lambda: bus.counters["velocity"].received == received + 1, "the stranger's")
    out.put(speed(2.0))
    assert (await within(1, box.next(), "the newest")).message.speed == 2.0


@pytest.mark.parametrize("order", ["mailbox first", "publisher first"])
async def test_a_wildcard_mailbox_takes_part_in_the_hand_over(network: Network, order: str) -> None:
    bus = await network.open()
    if order == "mailbox first":
        box = bus.every(channels.VELOCITY, "*")
        out = bus.publisher(channels.VELOCITY, "r1")
    else:
        out = bus.publisher(channels.VELOCITY, "r1")
        box = bus.every(channels.VELOCITY, "*")
    out.put(speed(1.0))
    assert [(got.name, got.message.speed) for got in box.drain()] == [("r1", 1.0)]


@pytest.mark.parametrize("order", ["mailbox first", "publishers first"])
async def test_two_publishers_of_one_key_hand_over_each_message_once(network: Network, order: str) -> None:
    bus = await network.open()
    if order == "mailbox first":
        box = bus.every(channels.VELOCITY, "*")
    outs = [bus.publisher(channels.VELOCITY, "r1") for _ in range(2)]
    if order == "publishers first":
        box = bus.every(channels.VELOCITY, "*")
    for i, out in enumerate(outs):
        out.put(speed(i))
    got = box.drain()
    assert [one.message.speed for one in got] == [0.0, 1.0]
    assert [one.message.seq for one in got] == [1, 2]  # they are one writer


async def test_a_hand_over_wakes_the_waiting_task(network: Network) -> None:
    bus = await network.open()
    box = bus.latest(channels.VELOCITY, "r1")
    waiting = asyncio.create_task(box.next())
    await asyncio.sleep(0)
    bus.publisher(channels.VELOCITY, "r1").put(speed(0.4))
    got = await within(1, waiting, "the hand-over")
    assert (got.message.speed, got.delay) == (0.4, 0.0)


async def test_a_closed_mailbox_or_publisher_takes_and_gives_nothing(network: Network) -> None:
    bus = await network.open()
    out = bus.publisher(channels.VELOCITY, "r1")
    gone, there = bus.every(channels.VELOCITY, "r1"), bus.every(channels.VELOCITY, "*")
    gone.close()
    gone.close()
    out.put(speed(1.0))
    assert gone.drain() == []
    assert len(there.drain()) == 1
    out.close()
    out.close()
    out.put(speed(2.0))
    assert there.drain() == []


async def test_what_was_sent_is_stamped_once_and_the_callers_message_stays(network: Network) -> None:
    clock = ManualClock(42.0)
    bus = await network.open(clock)
    out = bus.publisher(channels.POSE, "r1")
    measured = PoseFix(stamp=40.0, age=0.05, x=0.0, y=0.0, theta=0.0, covariance=COVARIANCE, camera="north")
    assert out.put(measured).stamp == 40.0
    assert (measured.seq, measured.epoch) == (0, 0)
    mine = speed(1.0)
    velocity = bus.publisher(channels.VELOCITY, "r1")
    assert [velocity.put(mine).seq, velocity.put(mine).seq] == [1, 2]
    assert velocity.put(mine).stamp == 42.0
    assert mine == speed(1.0)


async def test_what_is_handed_over_and_displaced_unread_is_counted(network: Network) -> None:
    bus = await network.open()
    newest, bounded = bus.latest(channels.VELOCITY, "r1"), bus.every(channels.ODOMETRY, "r1", depth=4)
    velocity, odometer = bus.publisher(channels.VELOCITY, "r1"), bus.publisher(channels.ODOMETRY, "r1")
    for i in range(10):
        velocity.put(speed(i))
        odometer.put(odometry(i))
    velocities, rows = bus.counters["velocity"], bus.counters["odometry"]
    assert (velocities.replaced, velocities.dropped) == (9, 0)
    assert (rows.replaced, rows.dropped) == (0, 6)
    assert (newest.get(), len(bounded.drain())) != (None, 0)
    velocity.put(speed(10.0))
    odometer.put(odometry(10.0))
    assert (velocities.replaced, rows.dropped) == (9, 6)  # the last ones were read
