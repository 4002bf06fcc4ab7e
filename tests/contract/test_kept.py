"""Late joiners get what was kept. On the in-memory bus and on Zenoh alike."""

from __future__ import annotations

import asyncio

import pytest

from muro_zenoh import channels
from muro_zenoh.channels import Priority
from muro_zenoh.messages import (
    Behaviour,
    Calibration,
    Circle,
    decode,
    encoding_of,
)
from muro_zenoh.transport import MemoryNetwork
from tests.contract.conftest import Network
from tests.contract.helpers import linked, speed
from tests.support.waiting import seconds, within


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


@pytest.mark.parametrize("how", ["mailbox", "tap"])
async def test_a_late_joiner_gets_what_one_process_keeps_on_each_of_its_keys(network: Network, how: str) -> None:
    writer = await network.open()
    for number in (1, 2, 3, 4, 5):
        writer.publisher(channels.BEHAVIOUR, f"r{number}").put(Behaviour(behaviour="circle", revision=number))
    writer.publisher(channels.CIRCLE).put(Circle(x=0.0, y=0.0, radius=1.0))
    reader = await network.open()
    got: set[tuple[str, int]] = set()
    if how == "mailbox":
        box = reader.every(channels.BEHAVIOUR, "*")
        while len(got) < 5:
            received = await within(3, box.next(), f"the others, not only {got}")
            got.add((received.name, received.message.revision))
    else:
        tap = reader.tap(f"{network.realm}/behaviour/*", keep=True)
        while len(got) < 5:
            sample = await within(3, anext(aiter(tap)), f"the others, not only {got}")
            got.add((sample.key.rpartition("/")[2], decode(sample.payload, Behaviour).revision))
    assert got == {(f"r{number}", number) for number in (1, 2, 3, 4, 5)}


async def test_a_reader_that_was_there_first_gets_it_too(network: Network) -> None:
    reader = await network.open()
    box = reader.latest(channels.CIRCLE)
    writer = await network.open()
    writer.publisher(channels.CIRCLE).put(Circle(x=0.1, y=0.2, radius=0.8))
    assert (await within(3, box.next(), "the value")).message.radius == 0.8


@pytest.mark.parametrize("ends", ["process", "publisher"])
async def test_a_kept_value_is_not_kept_beyond_its_writer(network: Network, ends: str) -> None:
    writer = await network.open()
    out = writer.publisher(channels.CIRCLE)
    out.put(Circle(x=0.1, y=0.2, radius=0.8))
    # It is kept while the writer lives ...
    assert (await within(3, (await network.open()).every(channels.CIRCLE).next(), "the value")).message.radius == 0.8
    if ends == "process":
        await writer.close()
    else:
        out.close()
    successor = await network.open()
    reader = await network.open()
    box = reader.every(channels.CIRCLE)
    # ... and no longer: what comes first is the successor's.
    successor.publisher(channels.CIRCLE).put(Circle(x=0.0, y=0.0, radius=1.2))
    assert (await within(3, box.next(), "the successor's value")).message.radius == 1.2
    assert reader.counters["circle"].received == 1


@pytest.mark.parametrize("key", ["cal0/r1", "cal0/*", "**"])
async def test_a_tap_begins_with_what_was_kept_where_it_is_asked_to(network: Network, key: str) -> None:
    writer, reader = await network.open(), await network.open()
    writer.publisher(channels.CAL_OMEGA, "r1").put(Calibration(value=1.1, sigma=0.1))
    writer.publisher(channels.VELOCITY, "r1").put(speed(0.3))  # not kept
    sample = await within(3, anext(aiter(reader.tap(f"{network.realm}/{key}", keep=True))), "the kept value")
    assert sample.key == f"{network.realm}/cal0/r1"
    assert decode(sample.payload, Calibration).value == 1.1
    assert sample.encoding == encoding_of(Calibration)


async def test_a_tap_begins_with_the_next_message_where_it_is_not(network: Network) -> None:
    writer, reader = await network.open(), await network.open()
    out = writer.publisher(channels.CAL_OMEGA, "r1")
    out.put(Calibration(value=1.1, sigma=0.1))
    other = (await network.open()).latest(channels.CAL_OMEGA, "r1")
    await within(3, other.next(), "the value")  # it is not on its way any more
    tap = reader.tap(f"{network.realm}/cal0/r1")

    async def send() -> None:
        while True:
            await asyncio.sleep(0.02)
            out.put(Calibration(value=1.2, sigma=0.1))

    sending = asyncio.create_task(send())
    try:
        sample = await within(3, anext(aiter(tap)), "the next value")
        assert decode(sample.payload, Calibration).value == 1.2
    finally:
        sending.cancel()


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


async def test_a_writer_may_keep_nothing(network: Network) -> None:
    """Such as an operator's stop, which the base station keeps: its own is gone by the time somebody resumes."""
    writer = await network.open()
    there = (await network.open()).latest(channels.CIRCLE)
    passing, keeping = writer.publisher(channels.CIRCLE, keep=False), writer.publisher(channels.CIRCLE)
    for publisher, radius in ((keeping, 0.8), (passing, 0.9)):  # the second one when the reader is known at the writer
        publisher.put(Circle(x=0.0, y=0.0, radius=radius))
        while (await within(3, there.next(), f"the value {radius}")).message.radius != radius:
            pass
    newcomer = await network.open()
    late = newcomer.every(channels.CIRCLE)
    assert (await within(3, late.next(), "the kept value")).message.radius == 0.8
    await newcomer.roster().complete(timeout=seconds(2))  # by then everything has come that was kept
    assert not late.drain()


async def test_what_a_killed_process_kept_in_memory_goes_with_its_link() -> None:
    """It has closed no publisher. Over Zenoh the cache is in the process itself."""
    network, heard = MemoryNetwork(), []
    link = network.link()
    assert link.publisher("muro/circle", encoding="", priority=Priority.DATA, keep=True).put(b"kept")

    def join() -> None:
        network.link().subscribe("muro/circle", lambda _, payload, __: heard.append(payload), encoding="", keep=True)

    join()
    assert heard == [b"kept"]
    await link.close()
    join()
    assert heard == [b"kept"]
