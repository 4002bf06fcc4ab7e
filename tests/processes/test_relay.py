"""The relay between a process and the router, on real sockets: what passes, when, and what is lost."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any
from unittest import mock

import pytest

from muro_zenoh.supervision.relay import GOOD, HOST, Conditions, Passage, Relay
from tests.support.waiting import within

Test = Callable[..., Coroutine[Any, Any, None]]

_TICK = 0.001
"""By so much a delay may fall short in one direction: uvloop's clock counts whole milliseconds [s]."""


def on_both_loops(test: Test) -> Any:
    """Run a test on asyncio's loop and on uvloop, which `muro run` takes where it is installed."""

    @pytest.mark.parametrize("loop", ["asyncio", "uvloop"])
    def run(loop: str, **given: Any) -> None:
        make = asyncio.new_event_loop if loop == "asyncio" else pytest.importorskip("uvloop").new_event_loop
        with asyncio.Runner(loop_factory=make) as runner:
            runner.run(test(**given))

    return run


class Echo:
    """A server that sends back what it receives, and counts it."""

    def __init__(self) -> None:
        self.received = b""
        self.connections = 0
        self.writers: list[asyncio.StreamWriter] = []

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.connections += 1
        self.writers.append(writer)
        try:
            while data := await reader.read(65536):
                self.received += data
                writer.write(data)
                await writer.drain()
        except ConnectionError:
            pass
        finally:
            writer.close()


Dial = Callable[[], Awaitable[tuple[asyncio.StreamReader, asyncio.StreamWriter]]]


@asynccontextmanager
async def relayed() -> AsyncIterator[tuple[Echo, Relay, Dial]]:
    """An echo behind a relay, and how to connect to it; all connections are closed at the end of the block."""
    echo = Echo()
    server = await asyncio.start_server(echo.serve, HOST, 0)
    writers: list[asyncio.StreamWriter] = []
    async with Relay(seed=3) as relay:
        relay.lead_to(*server.sockets[0].getsockname())

        async def dial() -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
            host, _, port = relay.endpoint.removeprefix("tcp/").partition(":")
            reader, writer = await asyncio.open_connection(host, int(port))
            writers.append(writer)
            return reader, writer

        try:
            yield echo, relay, dial
        finally:
            for writer in (*writers, *echo.writers):
                writer.close()
            server.close()
            await asyncio.sleep(0.01)


async def ended(reader: asyncio.StreamReader) -> bool:
    """Whether a connection has ended, with or without a reset."""
    try:
        return await within(5, reader.read(), "the end of the connection") == b""
    except ConnectionError:
        return True


async def echoed(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, data: bytes) -> float:
    """Send, and receive it back; how long that took [s]."""
    began = time.monotonic()
    writer.write(data)
    assert await within(10, reader.readexactly(len(data)), "an echo") == data
    return time.monotonic() - began


@on_both_loops
async def test_a_good_link_passes_everything_and_waits_for_nothing() -> None:
    async with relayed() as (echo, relay, dial):
        reader, writer = await dial()
        large = bytes(range(256)) * 40_000  # 10 MB: more than all buffers of the sockets
        await echoed(reader, writer, large)
        assert echo.received == large
        assert all(end._timer is None and not end._waiting for end in relay.ends)
        writer.close()
        await within(5, until(lambda: not relay.ends), "both ends are closed")


def both(relay: Relay, conditions: Conditions) -> None:
    relay.set(conditions, conditions)


async def until(condition: Callable[[], bool]) -> None:
    while not condition():  # noqa: ASYNC110 - nothing here could set an event
        await asyncio.sleep(0.005)


@on_both_loops
async def test_a_delay_applies_in_both_directions_and_jitter_keeps_the_order() -> None:
    async with relayed() as (_, relay, dial):
        reader, writer = await dial()
        both(relay, Conditions(delay=0.05, jitter=0.04))
        assert await echoed(reader, writer, b"there and back") >= 0.1 - 2 * _TICK
        both(relay, Conditions(delay=0.1))
        assert await echoed(reader, writer, b"there and back") >= 0.2 - 2 * _TICK
        both(relay, Conditions(delay=0.02, jitter=0.02))
        expected = b""
        for number in range(60):
            piece = f"{number}\n".encode()
            writer.write(piece)
            expected += piece
            await asyncio.sleep(0.001)
        # Without the delay what comes next must still not overtake what is under way.
        relay.set(GOOD, GOOD)
        writer.write(b"last")
        expected += b"last"
        assert await within(10, reader.readexactly(len(expected)), "everything in order") == expected


def test_the_same_seed_draws_the_same_delays_within_their_limits() -> None:
    drawn = []
    for seed in (1, 1, 2):
        relay = Relay(seed)
        drawn.append([relay.delay(Conditions(delay=0.1, jitter=0.05)) for _ in range(500)])
    assert drawn[0] == drawn[1] != drawn[2]
    assert 0.1 <= min(drawn[0]) < 0.11
    assert 0.14 < max(drawn[0]) <= 0.15


@on_both_loops
async def test_a_stall_keeps_everything_and_delivers_it_at_its_end() -> None:
    async with relayed() as (echo, relay, dial):
        reader, writer = await dial()
        await echoed(reader, writer, b"before")
        both(relay, Conditions(passage=Passage.STALLED))
        writer.write(b"during")
        await asyncio.sleep(0.05)
        assert echo.received == b"before"
        relay.set(GOOD, GOOD)
        assert await within(5, reader.readexactly(6), "what was stalled") == b"during"
        assert echo.connections == 1


async def sent_and_under_way(relay: Relay, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Something has arrived, and something else waits in the relay."""
    await echoed(reader, writer, b"before")
    both(relay, Conditions(delay=0.2))
    writer.write(b"under way")
    await within(5, until(lambda: any(end._waiting for end in relay.ends)), "it waits in the relay")


@on_both_loops
async def test_what_waits_when_a_stall_begins_is_kept_too() -> None:
    async with relayed() as (echo, relay, dial):
        reader, writer = await dial()
        await sent_and_under_way(relay, reader, writer)
        both(relay, Conditions(passage=Passage.STALLED))
        await asyncio.sleep(0.3)
        assert echo.received == b"before"
        relay.set(GOOD, GOOD)
        assert await within(5, reader.readexactly(9), "what was under way") == b"under way"


@on_both_loops
async def test_nothing_crosses_a_partition_not_even_what_was_under_way() -> None:
    async with relayed() as (echo, relay, dial):
        reader, writer = await dial()
        await sent_and_under_way(relay, reader, writer)
        both(relay, Conditions(passage=Passage.PARTITIONED))
        writer.write(b"during")
        late_reader, _ = await dial()  # as on a real network, nobody refuses it
        await asyncio.sleep(0.3)
        assert not reader.at_eof(), "neither side is notified"
        assert not late_reader.at_eof()
        relay.set(GOOD, GOOD)
        assert await ended(reader)
        assert await ended(late_reader)
        reader, writer = await dial()
        await echoed(reader, writer, b"after")
        assert echo.received == b"beforeafter"
        assert echo.connections == 2


@on_both_loops
async def test_one_direction_may_be_worse_than_the_other() -> None:
    async with relayed() as (echo, relay, dial):
        reader, writer = await dial()
        await echoed(reader, writer, b"before")
        relay.set(Conditions(passage=Passage.STALLED), GOOD)
        writer.write(b"out")
        await within(5, until(lambda: echo.received == b"beforeout"), "what goes out passes")
        await asyncio.sleep(0.05)
        assert not reader._buffer  # type: ignore[attr-defined]
        relay.set(GOOD, Conditions(passage=Passage.STALLED))
        assert await within(5, reader.readexactly(3), "what came in meanwhile") == b"out"
        writer.write(b"held")
        await asyncio.sleep(0.05)
        assert echo.received == b"beforeout"
        relay.set(Conditions(delay=0.1), Conditions(delay=0.05))
        assert await within(5, reader.readexactly(4), "what was held") == b"held"
        assert await echoed(reader, writer, b"there and back") >= 0.15 - 2 * _TICK


@on_both_loops
async def test_a_process_whose_router_is_down_is_refused_and_may_try_again() -> None:
    async with relayed() as (_, relay, dial):
        there = relay._router
        relay.lead_to(HOST, 1)
        reader, _ = await dial()
        assert await ended(reader)
        relay.lead_to(*there)
        await echoed(*await dial(), b"there it is")


@on_both_loops
async def test_a_router_that_ends_ends_the_connection_and_the_other_way_round() -> None:
    async with relayed() as (echo, relay, dial):
        reader, writer = await dial()
        await echoed(reader, writer, b"before")
        echo.writers[0].close()
        assert await ended(reader)
        reader, writer = await dial()
        await echoed(reader, writer, b"again")
        writer.close()
        await within(5, until(lambda: not relay.ends), "the router's end is closed")


@on_both_loops
async def test_what_comes_for_a_process_that_has_left_is_dropped_quietly() -> None:
    complaints: list[dict[str, Any]] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: complaints.append(context))
    async with relayed() as (echo, relay, dial):
        reader, writer = await dial()
        await echoed(reader, writer, b"before")
        relay.set(Conditions(delay=0.01), Conditions(delay=0.2))
        writer.write(b"last words")
        await within(5, until(lambda: any(end._waiting for end in relay.ends)), "they wait in the relay")
        writer.close()
        await within(5, until(lambda: len(relay.ends) == 1), "the end at the process is closed")
        echo.writers[0].write(b"news")
        await within(5, until(lambda: not relay.ends), "the other one is, too")
    assert not complaints


@on_both_loops
async def test_a_reader_that_does_not_read_slows_its_writer_and_fills_no_memory() -> None:
    for delay in (0.0, 5.0):
        with mock.patch("muro_zenoh.supervision.relay._MOST_WAITING", 100_000):
            await _not_read(delay)


async def _not_read(delay: float) -> None:
    async with relayed() as (_, relay, dial):
        _, writer = await dial()
        await within(5, until(lambda: len(relay.ends) == 2), "it is connected")
        both(relay, Conditions(delay=delay))
        writer.write(bytes(60_000_000))  # nobody reads the echo
        await asyncio.sleep(0.3)
        for end in relay.ends:
            assert end._size <= 100_000 + 65536 * 8
            assert end._transport.get_write_buffer_size() < 1_000_000
        assert writer.transport.get_write_buffer_size() > 10_000_000
        writer.transport.abort()
