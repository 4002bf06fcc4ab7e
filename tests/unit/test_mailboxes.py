"""The mailboxes themselves, without a bus: what they keep, count, refuse, and whom they wake."""

from __future__ import annotations

import asyncio
import itertools
import math
import threading
from collections.abc import Callable
from typing import Any

import pytest

from muro_zenoh.errors import TransportError
from muro_zenoh.messages import SpeedReference, codec, encode, encoding_of
from muro_zenoh.transport import inbox
from muro_zenoh.transport.clock_offset import KnownClocks
from muro_zenoh.transport.inbox import Slot
from muro_zenoh.transport.mailboxes import Every, Latest
from muro_zenoh.transport.received import Counters, Received
from tests.support.clock import ManualClock
from tests.support.waiting import within

PREFIX = len("muro/velocity/")
ENCODING = encoding_of(SpeedReference)
GARBAGE = b"\xc1"


class Box:
    """A mailbox of speeds under test, and the middleware that files into it.

    Args:
        make: its class.
        depth: samples that it holds at most; None for its own choice.
        stale_after: the age at which its messages do not count any longer [s].
    """

    def __init__(self, make: Callable[..., Any], depth: int | None = None, stale_after: float = 0.5) -> None:
        self.clock = ManualClock()
        self.counters = Counters()
        self.clocks = KnownClocks()
        loop = asyncio.get_running_loop()
        options = {} if depth is None else {"depth": depth}
        self.inbox = make(
            Slot(SpeedReference, PREFIX, self.clock, loop, self.counters, "muro/velocity/*", stale_after, self.clocks),
            **options,
        )

    def file(
        self,
        name: str,
        speed: float,
        encoding: str | None = ENCODING,
        stamp: float | None = None,
        *,
        seq: int = 0,
        epoch: int = 3,
    ) -> None:
        stamp = self.clock.now() if stamp is None else stamp
        message = SpeedReference(speed=speed, stamp=stamp, seq=seq, epoch=epoch)
        self.inbox.file(f"muro/velocity/{name}", encode(message), encoding)

    def garble(self, name: str) -> None:
        self.inbox.file(f"muro/velocity/{name}", GARBAGE, ENCODING)

    async def next(self) -> tuple[str, float]:
        received = await within(1, self.inbox.next(), "a message")
        return received.name, received.message.speed

    def counts(self) -> tuple[int, int, int]:
        """Received, displaced, rejected, of all that was sorted by now."""
        self.inbox.values() if isinstance(self.inbox, Latest) else len(self.inbox._raw)
        counters = self.counters
        displaced = counters.replaced if isinstance(self.inbox, Latest) else counters.dropped
        assert counters.replaced + counters.dropped == displaced
        return counters.received, displaced, counters.rejected


def speed(received: Any) -> float | None:
    return received.message.speed if received is not None else None


# ---- the newest of each name


async def test_the_newest_of_each_name_is_kept() -> None:
    box = Box(Latest)
    assert box.inbox.get() is None
    assert box.inbox.values() == {}
    for name, v in (("r1", 0.1), ("r2", 0.2), ("r1", 0.3)):
        box.file(name, v)
    assert (speed(box.inbox.get("r1")), speed(box.inbox.get("r2")), box.inbox.get("r3")) == (0.3, 0.2, None)
    assert {name: speed(received) for name, received in box.inbox.values().items()} == {"r1": 0.3, "r2": 0.2}
    assert speed(box.inbox.get("r1")) == 0.3  # read or not
    box.file("r1", 0.4)
    assert speed(box.inbox.get("r1")) == 0.4
    box.file("r2", 0.5)
    assert speed(box.inbox.values()["r2"]) == 0.5


async def test_on_a_mailbox_of_one_key_no_name_is_needed() -> None:
    box = Box(Latest)
    box.file("r1", 0.1)
    assert speed(box.inbox.get()) == 0.1
    box.file("r1", 0.2)
    assert speed(box.inbox.get()) == 0.2
    box.file("r1", 0.3)
    assert box.counts() == (3, 0, 0)  # each was read by get()


async def test_a_name_that_is_forgotten_is_not_waited_for_nor_kept() -> None:
    box = Box(Latest)
    box.file("r1", 0.1)
    box.file("r2", 0.2)
    box.inbox.forget("r1")
    box.inbox.forget("r9")
    assert set(box.inbox._newest) == {"r2"}
    assert await box.next() == ("r2", 0.2)
    assert box.inbox._take() is None
    box.file("r1", 0.3)
    assert box.counts() == (3, 0, 0)  # what was forgotten is not dropped for it


async def test_the_reader_gets_each_name_once_and_the_longest_unread_first() -> None:
    box = Box(Latest)
    for name, v in (("r1", 0.1), ("r2", 0.2)):
        box.file(name, v)
        box.inbox.values()
    box.file("r1", 0.3)
    assert [await box.next(), await box.next()] == [("r2", 0.2), ("r1", 0.3)]
    assert box.inbox._take() is None


@pytest.mark.parametrize("read", ["next", "get", "values", "not"])
async def test_a_message_that_is_displaced_unread_is_counted(read: str) -> None:
    box = Box(Latest)
    box.file("r1", 0.1)
    if read == "next":
        await box.next()
    elif read == "get":
        box.inbox.get("r1")
    elif read == "values":
        box.inbox.values()
    else:
        box.inbox.get("r2")
    box.file("r1", 0.2)
    assert box.counts() == (2, 1 if read == "not" else 0, 0)
    box.inbox.get("r1")
    for v in (0.3, 0.4, 0.5):
        box.file("r1", v)
        box.inbox.get("r2")
    assert box.counters.replaced == (3 if read == "not" else 2)


async def test_those_behind_the_newest_good_one_are_dropped_undecoded() -> None:
    box = Box(Latest, depth=4)
    for v in (0.1, 0.2, 0.3):
        box.file("r1", v)
    box.garble("r1")
    assert speed(box.inbox.get("r1")) == 0.3
    assert box.counts() == (4, 2, 1)
    for v in (0.4, 0.5):
        box.file("r1", v)
    assert speed(box.inbox.get("r1")) == 0.5
    assert box.counts() == (6, 3, 1)


@pytest.mark.parametrize(("garbled", "kept"), [(3, 0.1), (4, None)])
async def test_three_samples_of_garbage_behind_a_good_one_do_not_displace_it(garbled: int, kept: float | None) -> None:
    box = Box(Latest)
    box.file("r1", 0.1)
    for _ in range(garbled):
        box.garble("r1")
    assert speed(box.inbox.get("r1")) == kept
    assert box.counts() == (1 + garbled, garbled - 3, garbled)


# ---- every one


async def test_every_message_comes_in_order() -> None:
    box = Box(Every)
    for name, v in (("r1", 0.1), ("r2", 0.2), ("r1", 0.3)):
        box.file(name, v)
        assert await box.next() == (name, v)
    for v in (0.4, 0.5):
        box.file("r1", v)
    box.garble("r1")
    assert [speed(received) for received in box.inbox.drain()] == [0.4, 0.5]
    assert box.inbox.drain() == []
    assert box.inbox._take() is None
    assert box.counts() == (6, 0, 1)


async def test_a_full_queue_drops_the_oldest_and_counts_it() -> None:
    box = Box(Every, depth=2)
    for v in (0.1, 0.2):
        box.file("r1", v)
    assert await box.next() == ("r1", 0.1)
    for v in (0.3, 0.4):
        box.file("r2", v)
    box.file("r3", 0.5)
    assert [speed(received) for received in box.inbox.drain()] == [0.4, 0.5]
    assert box.counts() == (5, 2, 0)


async def test_what_waits_for_the_loop_is_bounded_too() -> None:
    box = Box(Every, depth=2)
    for v in (0.1, 0.2, 0.3, 0.4):
        box.file("r1", v)
    assert box.counts() == (4, 2, 0)
    assert [speed(received) for received in box.inbox.drain()] == [0.3, 0.4]


async def test_a_queue_holds_64_messages_where_nothing_else_is_said() -> None:
    box = Box(Every)
    for k in range(65):
        box.file("r1", float(k))
    assert len(box.inbox.drain()) == 64
    assert box.counts() == (65, 1, 0)


# ---- what a message carries


@pytest.mark.parametrize("make", [Latest, Every])
async def test_a_message_carries_its_name_its_arrival_and_its_delay(make: Callable[..., Any]) -> None:
    box = Box(make)
    box.file("r1", 0.1, stamp=box.clock.now() - 7.0)
    assert await box.next() == ("r1", 0.1)
    box.clock.advance(2.0)
    box.file("r1", 0.2, stamp=box.clock.now() - 7.5)
    box.clock.advance(1.0)  # before it is read
    received = await within(1, box.inbox.next(), "a message")
    assert (received.name, received.arrival, received.delay, received.least) == ("r1", 1002.0, 0.5, 7.0)
    assert (box.counters.arrival, box.counters.delay) == (1002.0, 0.5)


async def test_delays_are_measured_for_each_key() -> None:
    box = Box(Every)
    for name, behind in (("r1", 1.0), ("r2", 5.0), ("r1", 1.5), ("r2", 5.25)):
        box.file(name, 0.1, stamp=box.clock.now() - behind)
    assert [received.delay for received in box.inbox.drain()] == [0.0, 0.5, 0.0, 0.25]


async def test_a_message_of_this_process_is_handed_over_as_it_is() -> None:
    box = Box(Every)
    box.file("r2", 0.1)
    box.clock.advance(1.0)
    message = SpeedReference(speed=0.2)
    box.inbox.hand("muro/velocity/r1", message)
    box.file("r2", 0.3)
    first, second, third = box.inbox.drain()
    assert (speed(first), speed(third)) == (0.1, 0.3)  # in the order in which they were sent
    assert second.message is message
    assert (second.name, second.arrival, second.delay, second.least) == ("r1", 1001.0, 0.0, 0.0)
    assert box.counts() == (3, 0, 0)


async def test_what_is_handed_over_wakes_the_reader() -> None:
    box = Box(Latest)
    reading = asyncio.create_task(box.next())
    await asyncio.sleep(0)
    box.inbox.hand("muro/velocity/r1", SpeedReference(speed=0.2))
    assert await within(1, reading, "the message") == ("r1", 0.2)
    assert box.counters.arrival == 1000.0


# ---- what is refused


@pytest.mark.parametrize("name", ["R1", "r 1", "1", "r1/x", "a" * 33])
async def test_a_name_that_is_none_is_rejected(name: str, caplog: pytest.LogCaptureFixture) -> None:
    box = Box(Latest)
    box.file(name, 0.1)
    assert box.counts() == (1, 0, 1)
    assert f"got the name {name!r}" in caplog.text


async def test_a_key_without_a_name_has_none() -> None:
    box = Box(Latest)
    box.inbox.file("muro/velocity/", encode(SpeedReference(speed=0.1, stamp=1000.0)), ENCODING)
    assert speed(box.inbox.get()) == 0.1


@pytest.mark.parametrize(
    ("encoding", "good"),
    [(ENCODING, True), (None, True), ("application/msgpack;Frame.1", False), ("text/plain", False)],
)
async def test_an_encoding_of_something_else_is_rejected(encoding: str | None, good: bool) -> None:
    box = Box(Latest)
    box.file("r1", 0.1, encoding)
    assert (speed(box.inbox.get("r1")) == 0.1) == good
    assert box.counters.rejected == (not good)


@pytest.mark.parametrize(("limit", "good"), [(0, True), (-1, False)])
async def test_a_payload_above_the_limit_is_rejected(limit: int, good: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    box = Box(Latest)
    payload = encode(SpeedReference(speed=0.1, stamp=1000.0))
    monkeypatch.setattr(codec, "MAX_PAYLOAD", len(payload) + limit)
    box.inbox.file("muro/velocity/r1", payload, ENCODING)
    assert (speed(box.inbox.get("r1")) == 0.1) == good
    assert box.counters.rejected == (not good)


async def test_a_key_that_was_silent_for_a_minute_makes_room_for_another(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inbox, "_MAX_KEYS", 2)
    box = Box(Latest)
    box.file("r1", 0.1)
    box.file("r2", 0.2)
    assert set(box.inbox.values()) == {"r1", "r2"}
    box.clock.advance(1.0)
    box.file("r2", 0.2)
    assert speed(box.inbox.get("r2")) == 0.2
    box.clock.advance(59.0)  # r1 has been silent for 60 s
    box.file("r3", 0.3)
    assert box.inbox.get("r3") is None
    box.clock.advance(0.5)
    box.file("r3", 0.3)
    assert speed(box.inbox.get("r3")) == 0.3
    assert (set(box.inbox.values()), box.counters.rejected) == ({"r2", "r3"}, 1)


async def test_a_thousand_keys_are_kept_and_no_more() -> None:
    box = Box(Latest)
    for k in range(1025):
        box.file(f"r{k}", 0.1)
    assert box.counts() == (1025, 0, 1)
    assert len(box.inbox.values()) == 1024


@pytest.mark.parametrize(("stale_after", "good"), [(0.5, False), (math.inf, True)])
async def test_a_stamp_ahead_of_its_writers_clock_is_rejected_where_age_matters(
    stale_after: float, good: bool, caplog: pytest.LogCaptureFixture
) -> None:
    box = Box(Every, stale_after=stale_after)
    for _ in range(10):
        box.file("r1", 0.1)
        box.clock.advance(0.05)
    box.inbox.drain()
    box.file("r1", 0.2, stamp=box.clock.now() + 40.0)
    found = box.inbox.drain()
    assert [(speed(received), received.delay) for received in found] == ([(0.2, 0.0)] if good else [])
    assert box.counts() == (11, 0, 0 if good else 1)
    assert ("got a stamp 40 s ahead of its writer's clock" in caplog.text) == (not good)


@pytest.mark.parametrize(("late", "counted"), [(0.49, 0), (0.5, 0), (0.51, 2)])
async def test_messages_that_were_stale_on_arrival_are_counted(late: float, counted: int) -> None:
    box = Box(Every)
    box.file("r1", 0.1)
    box.clock.advance(1.0)
    for _ in range(2):
        box.file("r1", 0.2, stamp=box.clock.now() - late)
    assert len(box.inbox.drain()) == 3
    assert box.counters.late == counted


def test_a_payload_may_have_eight_mebibytes() -> None:
    assert codec.MAX_PAYLOAD == 8_388_608


async def test_keys_are_bounded_while_they_wait_and_afterwards(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inbox, "_MAX_KEYS", 2)
    box = Box(Latest)
    for name in ("r1", "r2", "r3", "r4"):  # the last two do not even wait
        box.file(name, 0.1)
    assert box.counters.rejected == 2
    assert box.counts() == (4, 0, 2)
    assert set(box.inbox.values()) == {"r1", "r2"}
    box.file("r3", 0.1)
    box.file("r2", 0.2)
    assert speed(box.inbox.get("r2")) == 0.2
    assert (box.inbox.get("r3"), box.counters.rejected) == (None, 3)


async def test_garbage_is_logged_once_until_good_messages_come(caplog: pytest.LogCaptureFixture) -> None:
    box = Box(Every)
    for _ in range(2):
        for _ in range(3):
            box.clock.advance(20.0)
            box.garble("r1")
            box.inbox.drain()
        box.clock.advance(20.0)
        box.file("r1", 0.1)
        box.inbox.drain()
    assert [record.levelname for record in caplog.records] == ["WARNING", "WARNING"]
    assert box.counts() == (8, 0, 6)
    assert "muro/velocity/r1: dropped a message: " in caplog.text


async def test_garbage_and_good_messages_in_turn_do_not_fill_the_log(caplog: pytest.LogCaptureFixture) -> None:
    box = Box(Every)
    for _ in range(100):
        box.clock.advance(0.2)
        box.garble("r1")
        box.file("r1", 0.1)
        box.inbox.drain()
    assert len(caplog.records) == 2  # in 20 s


async def test_a_good_message_of_another_key_does_not_end_the_episode(caplog: pytest.LogCaptureFixture) -> None:
    box = Box(Every)
    for _ in range(200):
        for name in ("r1", "r3"):
            box.garble(name)
        box.file("r2", 0.1)
        box.inbox.drain()
    assert [record.getMessage()[:17] for record in caplog.records] == ["muro/velocity/r1:", "muro/velocity/r3:"]
    assert box.counts() == (600, 0, 400)


async def test_garbage_on_ever_new_keys_fills_neither_the_log_nor_the_memory(caplog: pytest.LogCaptureFixture) -> None:
    box = Box(Every)
    box.file("r1", 0.1)
    for k in range(2000):
        box.garble(f"x{k}")
        box.inbox.drain()
    assert len(caplog.records) == len(box.inbox._episodes) == 32
    box.garble("r1")  # a known key's is logged all the same
    box.inbox.drain()
    assert "muro/velocity/r1: dropped a message: " in caplog.text


async def test_the_episode_of_a_key_that_gave_way_is_forgotten(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(inbox, "_MAX_KEYS", 2)
    box = Box(Every)
    for k in range(100):
        box.file(f"x{k}", 0.1)
        box.inbox.drain()
        box.garble(f"x{k}")
        box.inbox.drain()
        box.clock.advance(61.0)
    assert len(box.inbox._episodes) <= 2


# ---- waiting


async def test_the_reader_waits_until_something_comes_from_another_thread() -> None:
    box = Box(Latest)
    reading = asyncio.create_task(box.next())
    await asyncio.sleep(0)
    thread = threading.Thread(target=box.file, args=("r1", 0.1))
    thread.start()
    assert await within(5, reading, "the message") == ("r1", 0.1)
    thread.join()


async def test_a_burst_from_another_thread_wakes_the_loop_once() -> None:
    box = Box(Every)
    woken: list[Callable[[], None]] = []

    class Loop:
        create_future = staticmethod(asyncio.get_running_loop().create_future)
        call_soon_threadsafe = staticmethod(woken.append)

    box.inbox._loop = Loop()

    def burst() -> None:
        for k in range(10):
            box.file("r1", float(k))

    async def from_a_thread() -> None:
        await asyncio.to_thread(burst)

    await from_a_thread()
    assert woken == []  # nobody waits
    box.inbox.drain()
    for _ in range(2):
        reading = asyncio.create_task(box.next())
        await asyncio.sleep(0)
        await from_a_thread()
        (wake,) = woken
        woken.clear()
        wake()
        assert (await within(1, reading, "the first of the burst"))[1] == 0.0
        box.inbox.drain()


async def test_a_closed_loop_is_not_woken_and_nobody_is_told() -> None:
    box = Box(Latest)
    closed = asyncio.new_event_loop()
    closed.close()
    reading = asyncio.create_task(box.next())
    await asyncio.sleep(0)
    box.inbox._loop = closed
    await asyncio.to_thread(box.file, "r1", 0.1)
    box.inbox.close()
    with pytest.raises(TransportError, match="closed"):
        await reading


async def test_what_comes_from_the_loops_own_thread_wakes_the_reader_without_a_detour() -> None:
    box = Box(Latest)
    reading = asyncio.create_task(box.next())
    await asyncio.sleep(0)
    box.file("r1", 0.1)
    assert box.inbox._waiter.done()
    assert await reading == ("r1", 0.1)


async def test_garbage_wakes_nobody_for_good() -> None:
    box = Box(Latest)
    reading = asyncio.create_task(box.next())
    await asyncio.sleep(0)
    box.garble("r1")
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert not reading.done()
    box.file("r1", 0.1)
    assert await within(1, reading, "the message") == ("r1", 0.1)


async def test_a_second_reader_is_refused_and_the_first_goes_on() -> None:
    box = Box(Latest)
    first = asyncio.create_task(box.next())
    await asyncio.sleep(0)
    with pytest.raises(TransportError, match=r"^muro/velocity/\*: two tasks wait at one mailbox"):
        await box.next()
    box.file("r1", 0.1)
    assert await within(1, first, "the message") == ("r1", 0.1)
    box.file("r1", 0.2)  # one after the other is fine
    assert await box.next() == ("r1", 0.2)


async def test_a_reader_that_is_cancelled_makes_room_for_the_next() -> None:
    box = Box(Latest)
    first = asyncio.create_task(box.next())
    await asyncio.sleep(0)
    first.cancel()
    await asyncio.wait({first})
    second = asyncio.create_task(box.next())
    await asyncio.sleep(0)
    box.file("r1", 0.1)
    assert await within(1, second, "the message") == ("r1", 0.1)


async def test_a_mailbox_is_read_by_iteration_too() -> None:
    box = Box(Every)
    for v in (0.1, 0.2):
        box.file("r1", v)
    seen = []
    async for received in box.inbox:
        seen.append(speed(received))
        if len(seen) == 2:
            break
    assert seen == [0.1, 0.2]


# ---- the end


@pytest.mark.parametrize("make", [Latest, Every])
async def test_a_closed_mailbox_takes_nothing_and_says_so(make: Callable[..., Any]) -> None:
    box = Box(make)
    closed: list[str] = []
    box.inbox.on_close(lambda: closed.append("subscriber"))
    box.inbox.on_close(lambda: closed.append("presence"))
    waiting = asyncio.create_task(box.next())
    await asyncio.sleep(0)
    box.inbox.close()
    box.inbox.close()
    assert closed == ["subscriber", "presence"]
    with pytest.raises(TransportError, match=r"^muro/velocity/\*: the mailbox is closed$"):
        await within(1, waiting, "the end")
    box.file("r1", 0.1)
    with pytest.raises(TransportError, match="the mailbox is closed"):
        await box.next()
    assert box.counts() == (0, 0, 0)


@pytest.mark.parametrize("make", [Latest, Every])
async def test_what_waited_for_the_loop_when_the_mailbox_was_closed_is_not_read_any_more(
    make: Callable[..., Any],
) -> None:
    box = Box(make)
    box.file("r1", 0.1)
    box.inbox.close()
    with pytest.raises(TransportError, match="the mailbox is closed"):
        await box.next()


def test_a_message_from_before_the_clock_was_set_back_has_no_age() -> None:
    received = Received("r1", SpeedReference(speed=0.2), arrival=1000.0, delay=0.0, least=0.0)
    assert received.age(1000.2) == pytest.approx(0.2)
    assert received.age(999.95) == pytest.approx(-0.05)  # it came while the clock was being read
    assert received.age(999.8) == math.inf
    assert math.isnan(received.age(math.nan))


# ---- messages that overtake each other


@pytest.mark.parametrize("read_between", [True, False])
async def test_a_message_that_was_overtaken_or_comes_twice_does_not_displace_a_later_one(read_between: bool) -> None:
    box = Box(Latest)
    box.file("r1", 0.1, seq=5)
    assert await box.next() == ("r1", 0.1)
    for v, seq in ((0.3, 7), (0.2, 6), (0.3, 7)):
        box.file("r1", v, seq=seq)
        if read_between:
            assert speed(box.inbox.get("r1")) == 0.3
    assert await box.next() == ("r1", 0.3)
    assert box.counts() == (4, 2, 0)
    box.file("r1", 0.4, seq=8)
    assert await box.next() == ("r1", 0.4)


async def test_of_several_that_wait_the_one_sent_last_is_kept_whatever_their_order() -> None:
    for order in itertools.permutations((2, 3, 4)):
        box = Box(Latest)
        box.file("r1", 0.1, seq=1)
        assert await box.next() == ("r1", 0.1)
        for seq in order:
            box.file("r1", 0.1 * seq, seq=seq)
        assert speed(box.inbox.get("r1")) == pytest.approx(0.4), order
        assert box.counts() == (4, 2, 0)


async def test_one_wrong_number_does_not_lock_its_writer_out() -> None:
    box = Box(Latest)
    box.file("r1", 9.0, seq=10**9)
    assert speed(box.inbox.get("r1")) == 9.0
    box.clock.advance(1.0)
    box.file("r1", 0.1, seq=6)
    assert speed(box.inbox.get("r1")) == 9.0
    box.clock.advance(0.01)
    box.file("r1", 0.2, seq=7)
    assert speed(box.inbox.get("r1")) == 0.2


@pytest.mark.parametrize(("seq", "epoch"), [(1, 4), (0, 3)])
async def test_another_process_and_one_without_numbers_count_by_their_arrival(seq: int, epoch: int) -> None:
    box = Box(Latest)
    box.file("r1", 0.1, seq=50)
    assert speed(box.inbox.get("r1")) == 0.1
    box.file("r1", 0.2, seq=seq, epoch=epoch)
    assert speed(box.inbox.get("r1")) == 0.2


async def test_messages_in_order_are_not_decoded_behind_the_last_good_one() -> None:
    box = Box(Latest)
    box.file("r1", 0.1, seq=1)
    assert speed(box.inbox.get("r1")) == 0.1
    box.garble("r1")
    box.file("r1", 0.3, seq=3)
    assert speed(box.inbox.get("r1")) == 0.3
    assert box.counts() == (3, 1, 0)
