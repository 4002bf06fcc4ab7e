"""What arrives late is stale, though it has just arrived. On the in-memory bus and on Zenoh alike."""

from __future__ import annotations

import pytest

from muro_zenoh import channels
from tests.contract.conftest import Network
from tests.contract.helpers import odometry, odometry_linked
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
