"""Late joiners get what was kept. On the in-memory bus and on Zenoh alike."""

from __future__ import annotations

import pytest

from muro_zenoh import channels
from muro_zenoh.messages import (
    Calibration,
    Circle,
)
from tests.contract.conftest import Network
from tests.contract.helpers import linked, speed
from tests.support.waiting import within


@pytest.mark.parametrize("name", ["r1", "*"])
async def test_a_late_joiner_gets_what_was_kept(network: Network, name: str) -> None:
    writer = await network.open()
    out = writer.publisher(channels.CAL_OMEGA, "r1")
    out.put(Calibration(value=0.9, sigma=0.1))
    out.put(Calibration(value=1.1, sigma=0.1))
    reader = await network.open()
    got = await within(3, reader.latest(channels.CAL_OMEGA, name).next(), "the kept value")
    assert got.message.value == 1.1
    assert got.name == "r1"


async def test_a_reader_that_was_there_first_gets_it_too(network: Network) -> None:
    reader = await network.open()
    box = reader.latest(channels.CIRCLE)
    writer = await network.open()
    writer.publisher(channels.CIRCLE).put(Circle(x=0.1, y=0.2, radius=0.8))
    assert (await within(3, box.next(), "the value")).message.radius == 0.8


async def test_a_kept_value_is_not_kept_beyond_its_writer(network: Network) -> None:
    writer = await network.open()
    writer.publisher(channels.CIRCLE).put(Circle(x=0.1, y=0.2, radius=0.8))
    await writer.close()
    successor = await network.open()
    reader = await network.open()
    box = reader.latest(channels.CIRCLE)
    successor.publisher(channels.CIRCLE).put(Circle(x=0.0, y=0.0, radius=1.2))
    assert (await within(3, box.next(), "the successor's value")).message.radius == 1.2


async def test_a_later_mailbox_of_the_same_bus_gets_what_was_kept(network: Network) -> None:
    bus = await network.open()
    out = bus.publisher(channels.CIRCLE)
    out.put(Circle(x=0.0, y=0.0, radius=0.8))
    box = bus.every(channels.CIRCLE)
    assert (await within(2, box.next(), "the kept value")).message.radius == 0.8
    out.put(Circle(x=0.0, y=0.0, radius=0.9))
    assert (await within(2, box.next(), "the next value")).message.radius == 0.9
    assert not box.drain()


async def test_what_is_not_kept_is_gone(network: Network) -> None:
    writer = await network.open()
    out = writer.publisher(channels.VELOCITY, "r1")
    out.put(speed(1.0))
    reader = await network.open()
    box = reader.latest(channels.VELOCITY, "r1")
    await linked(lambda v: out.put(speed(v)), box)
    assert box.get() is not None
    assert reader.counters["velocity"].rejected == 0
    assert box.get().message.speed < 0.0  # type: ignore[union-attr]  # a probe, not the old value
