"""What arrives late is stale, though it has just arrived. On the in-memory bus and on Zenoh alike."""

from __future__ import annotations

import msgspec
import pytest

from muro_zenoh import channels
from muro_zenoh.messages import Odometry, StopOrder
from muro_zenoh.transport import Received
from tests.contract.conftest import Network
from tests.contract.helpers import odometry, odometry_linked, until
from tests.support.clock import ManualClock
from tests.support.waiting import within


async def test_a_backlog_that_arrives_after_a_freeze_is_stale(network: Network) -> None:
    wall = ManualClock()
    offset = ManualClock(5000.0)  # the reader's clock: no two clocks agree
    writer, reader = await network.open(wall), await network.open(offset)
    box = reader.every(channels.ODOMETRY, "r1")
    out = writer.publisher(channels.ODOMETRY, "r1")
    await odometry_linked(out.put, box)
    offset.advance(0.5 + 2.0)  # they arrive at once, two seconds after the last of them was sent
    stamps = []
    for _ in range(5):
        wall.advance(0.1)
        stamps.append(out.put(odometry(1.0)).stamp)
    late = [await within(2, box.next(), "the backlog") for _ in range(5)]
    assert [got.message.stamp for got in late] == stamps
    ages = [got.age(offset.now()) for got in late]
    assert ages == pytest.approx([2.4, 2.3, 2.2, 2.1, 2.0], abs=1e-6)
    assert all(age > (channels.ODOMETRY.stale_after or 0.0) for age in ages)
    wall.advance(2.1)
    offset.advance(0.1)
    out.put(odometry(2.0))
    fresh = await within(2, box.next(), "a fresh one")
    assert fresh.age(offset.now()) == pytest.approx(0.0, abs=1e-6)
    assert fresh.captured() == pytest.approx(offset.now(), abs=1e-6)
    offset.advance(0.3)
    assert fresh.age(offset.now()) == pytest.approx(0.3, abs=1e-6)


async def test_two_writers_of_one_key_have_a_delay_each(network: Network) -> None:
    one, other, here = ManualClock(100.0), ManualClock(900.0), ManualClock(500.0)
    first, second, reader = await network.open(one), await network.open(other), await network.open(here)
    box = reader.every(channels.ODOMETRY, "r1")
    out1, out2 = first.publisher(channels.ODOMETRY, "r1"), second.publisher(channels.ODOMETRY, "r1")
    await odometry_linked(out1.put, box)
    await odometry_linked(out2.put, box)
    here.advance(1.0)  # both of these come a second late
    out1.put(odometry(1.0))
    assert (await within(2, box.next(), "the first's")).delay == pytest.approx(1.0)
    out2.put(odometry(2.0))
    assert (await within(2, box.next(), "the second's")).delay == pytest.approx(1.0)
    out1.put(odometry(1.0))
    assert (await within(2, box.next(), "the first's again")).delay == pytest.approx(1.0)


async def test_a_stamp_that_leaps_ahead_is_rejected_and_forgotten(network: Network) -> None:
    wall, here = ManualClock(100.0), ManualClock(5000.0)
    writer, reader = await network.open(wall), await network.open(here)
    box = reader.every(channels.ODOMETRY, "r1")
    out = writer.publisher(channels.ODOMETRY, "r1")
    await odometry_linked(out.put, box)

    async def send() -> Received[Odometry]:
        wall.advance(0.05)
        here.advance(0.05)
        out.put(odometry(1.0))
        return await within(2, box.next(), "a message")

    for _ in range(20):
        await send()
    counters = reader.counters["odometry"]
    assert counters.rejected == 0
    out.put(msgspec.structs.replace(odometry(1.0), stamp=wall.now() + 40.0))
    await until(lambda: not box.drain() and counters.rejected == 1, "one rejected")
    for _ in range(20):
        received = await send()
        assert received.delay == pytest.approx(0.0, abs=1e-6)
        assert received.captured() == pytest.approx(here.now(), abs=1e-6)
    assert counters.rejected == 1


async def test_what_is_stale_when_it_comes_is_counted_as_late(network: Network) -> None:
    wall, here = ManualClock(), ManualClock()
    writer, reader = await network.open(wall), await network.open(here)
    box = reader.every(channels.ODOMETRY, "r1")
    out = writer.publisher(channels.ODOMETRY, "r1")
    await odometry_linked(out.put, box)
    counters = reader.counters["odometry"]
    for late, count in ((0.14, 0), (0.02, 1), (0.5, 2)):
        here.advance(late)
        out.put(odometry(1.0))
        await within(2, box.next(), "it")
        assert counters.late == count
    assert reader.numbers()["odometry_late"] == 2


async def test_a_stop_is_taken_whatever_its_stamp(network: Network) -> None:
    wall, here = ManualClock(), ManualClock()
    writer, reader = await network.open(wall), await network.open(here)
    box = reader.every(channels.STOP)
    out = writer.publisher(channels.STOP)
    for revision in range(1, 20):
        wall.advance(0.5)
        here.advance(0.5)
        out.put(StopOrder(all=False, revision=revision))
        await within(2, box.next(), "a state")
    for stamp in (wall.now() + 1e6, 1.0, 1e10):
        out.put(StopOrder(all=True, revision=20, stamp=stamp))
        assert (await within(2, box.next(), "a stop")).message.all
    assert reader.counters["stop"].rejected == 0
