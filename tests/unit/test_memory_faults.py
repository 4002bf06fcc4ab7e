"""Troubles of the in-memory network's links: what becomes of messages, kept values, queries and tokens."""

from __future__ import annotations

import asyncio
import contextlib
import random
from collections.abc import AsyncIterator

import pytest

from muro_zenoh.channels import Priority
from muro_zenoh.transport import MemoryNetwork
from muro_zenoh.transport.link import Question
from muro_zenoh.transport.memory_faults import Cut, Delay, Duplication, Loss, Reordering, Stall, Trouble
from muro_zenoh.transport.memory_link import LEASE, MemoryLink
from tests.support.virtual import virtual


class Pair:
    """A writer and a reader on different computers, and what arrives: when, and what."""

    def __init__(self) -> None:
        self.network = MemoryNetwork()
        self.writer, self.reader = self.network.link("a"), self.network.link("b")
        self.arrived: list[tuple[float, str]] = []
        self.tokens: list[tuple[float, bool]] = []
        self.reader.subscribe("x/*", lambda key, payload, encoding: self._file(payload), encoding="", keep=False)
        self._publisher = self.writer.publisher("x/1", encoding="", priority=Priority.DATA, keep=True)

    def _file(self, payload: bytes) -> None:
        self.arrived.append((round(now(), 6), payload.decode()))

    def put(self, text: str) -> None:
        assert self._publisher.put(text.encode())

    @property
    def texts(self) -> list[str]:
        return [text for _, text in self.arrived]

    def listen(self, computer: str, *, keep: bool = False) -> list[bytes]:
        """What another reader gets."""
        heard: list[bytes] = []
        link = self.network.link(computer)
        link.subscribe("x/*", lambda key, payload, encoding: heard.append(payload), encoding="", keep=keep)
        return heard

    def watch(self) -> None:
        self.reader.watch_tokens("alive/*", lambda key, there: self.tokens.append((round(now(), 6), there)))


def now() -> float:
    return asyncio.get_running_loop().time()


@contextlib.asynccontextmanager
async def troubled(link: MemoryLink, trouble: Trouble, direction: str = "both") -> AsyncIterator[Trouble]:
    link.begin(trouble, direction)
    yield trouble
    link.end(trouble, direction)


RNG = random.Random


@virtual
async def test_without_troubles_a_message_arrives_at_once() -> None:
    pair = Pair()
    pair.put("a")
    assert pair.arrived == [(0.0, "a")]


@pytest.mark.parametrize("where", ["out", "in", "router"])
def test_a_delay_delays_and_its_end_lets_nothing_overtake(where: str) -> None:
    @virtual
    async def test() -> None:
        pair, delay = Pair(), Delay(RNG(1), 0.3)
        troubled_one = {"out": pair.writer, "in": pair.reader, "router": pair.network}[where]
        troubled_one.begin(delay)  # type: ignore[attr-defined]
        pair.put("a")
        await asyncio.sleep(0.1)
        pair.put("b")
        await asyncio.sleep(0.1)
        troubled_one.end(delay)  # type: ignore[attr-defined]
        pair.put("c")
        await asyncio.sleep(0.5)
        pair.put("d")
        assert pair.arrived == [(0.3, "a"), (0.4, "b"), (0.4, "c"), (0.7, "d")]
        assert delay.count == 2

    test()


@virtual
async def test_the_other_direction_is_not_affected() -> None:
    pair = Pair()
    async with troubled(pair.writer, Cut(), "in"), troubled(pair.reader, Cut(), "out"):
        pair.put("a")
    assert pair.texts == ["a"]


@virtual
async def test_jitter_varies_but_keeps_the_order() -> None:
    pair = Pair()
    async with troubled(pair.writer, Delay(RNG(1), 0.0, 0.2)):
        for number in range(100):
            pair.put(str(number))
            await asyncio.sleep(0.01)
        await asyncio.sleep(0.3)
    assert pair.texts == [str(number) for number in range(100)]
    late = [when - 0.01 * number for number, (when, _) in enumerate(pair.arrived)]
    assert len({round(each, 4) for each in late}) > 20
    assert min(late) >= 0.0
    assert max(late) <= 0.2


@virtual
async def test_loss_loses_its_fraction_and_counts() -> None:
    pair, loss = Pair(), Loss(RNG(1), 0.2)
    async with troubled(pair.writer, loss):
        for number in range(1000):
            pair.put(str(number))
    assert len(pair.texts) == 1000 - loss.count
    assert loss.count == pytest.approx(200, abs=50)


@virtual
async def test_a_lost_message_reaches_no_reader_of_its_link() -> None:
    pair = Pair()
    second = pair.listen("c")
    async with troubled(pair.writer, Loss(RNG(1), 0.5)):
        for number in range(50):
            pair.put(str(number))
    assert pair.texts == [payload.decode() for payload in second]
    assert 0 < len(second) < 50


@virtual
async def test_duplicates_arrive_twice() -> None:
    pair = Pair()
    async with troubled(pair.reader, Duplication(RNG(1), 1.0, 0.05)):
        pair.put("a")
        await asyncio.sleep(0.1)
    assert pair.arrived == [(0.0, "a"), (0.05, "a")]


@virtual
async def test_what_is_held_back_is_overtaken() -> None:
    pair = Pair()
    async with troubled(pair.reader, Reordering(RNG(1), 1.0, 0.1)):
        pair.put("a")
        await asyncio.sleep(0.05)
    pair.put("b")
    await asyncio.sleep(0.2)
    assert pair.arrived == [(0.05, "b"), (0.1, "a")]


@virtual
async def test_what_is_under_way_does_not_cross_a_cut_even_one_that_is_over() -> None:
    pair, cut = Pair(), Cut()
    async with troubled(pair.reader, Delay(RNG(1), 0.5)):
        pair.put("under way")
        await asyncio.sleep(0.1)
        async with troubled(pair.reader, cut):
            pair.put("meanwhile")
            await asyncio.sleep(0.1)
        pair.put("after")
        await asyncio.sleep(1.0)
    assert pair.texts == ["after"]
    assert cut.count == 2


@virtual
async def test_a_stall_delivers_everything_at_its_end_in_order() -> None:
    pair, stall = Pair(), Stall()
    async with troubled(pair.writer, stall):
        pair.put("a")
        await asyncio.sleep(0.2)
        pair.put("b")
        await asyncio.sleep(0.3)
    pair.put("c")
    assert pair.arrived == [(0.5, "a"), (0.5, "b"), (0.5, "c")]
    assert stall.count == 2


@virtual
async def test_on_one_computer_nothing_comes_between() -> None:
    pair = Pair()
    heard = pair.listen("a")
    async with troubled(pair.writer, Cut()):
        pair.put("a")
    assert heard == [b"a"]
    assert pair.texts == []


@virtual
async def test_what_comes_for_a_frozen_process_waits() -> None:
    pair = Pair()
    pair.reader.freeze()
    pair.put("a")
    await asyncio.sleep(0.5)
    pair.put("b")
    assert pair.arrived == []
    pair.reader.thaw()
    assert pair.arrived == [(0.5, "a"), (0.5, "b")]


@virtual
async def test_a_process_that_is_gone_gets_nothing_more() -> None:
    pair = Pair()
    async with troubled(pair.reader, Delay(RNG(1), 0.5)):
        pair.put("a")
        pair.reader.leave()
        await asyncio.sleep(1.0)
    assert pair.arrived == []


# ---- kept values


@virtual
async def test_a_kept_value_does_not_cross_a_cut() -> None:
    pair = Pair()
    pair.put("kept")
    async with troubled(pair.writer, Cut()):
        late = pair.listen("c", keep=True)
        await asyncio.sleep(0.1)
    assert late == []
    assert pair.listen("d", keep=True) == [b"kept"]


@virtual
async def test_a_frozen_process_gives_no_kept_value() -> None:
    pair = Pair()
    pair.put("kept")
    pair.writer.freeze()
    assert pair.listen("c", keep=True) == []


# ---- queries


def answering(pair: Pair) -> None:
    def answer(question: Question) -> None:
        question.reply(b"yes", "")

    pair.writer.answer("q", answer)


@pytest.mark.parametrize("direction", ["in", "out"])
def test_neither_a_question_nor_its_answer_crosses_a_cut(direction: str) -> None:
    @virtual
    async def test() -> None:
        pair = Pair()
        answering(pair)
        assert await pair.reader.ask("q", b"?", "", 1.0) == b"yes"
        async with troubled(pair.writer, Cut(), direction):
            assert await pair.reader.ask("q", b"?", "", 1.0) is None
        assert now() == 1.0

    test()


@virtual
async def test_a_question_and_its_answer_take_longer() -> None:
    pair = Pair()
    answering(pair)
    async with troubled(pair.writer, Delay(RNG(1), 0.2)):
        assert await pair.reader.ask("q", b"?", "", 1.0) == b"yes"
        assert now() == pytest.approx(0.4)
        assert await pair.reader.ask("q", b"?", "", 0.3) is None


@virtual
async def test_after_the_lease_nobody_is_known_to_answer() -> None:
    pair = Pair()
    answering(pair)
    async with troubled(pair.writer, Cut()):
        await asyncio.sleep(LEASE + 0.1)
        began = now()
        assert await pair.reader.ask("q", b"?", "", 1.0) is None
        assert now() == began


# ---- tokens


@pytest.mark.parametrize("side", ["reader", "writer"])
def test_a_token_goes_when_the_lease_has_run_out_and_comes_back(side: str) -> None:
    @virtual
    async def test() -> None:
        pair = Pair()
        pair.watch()
        pair.writer.declare_token("alive/1")
        async with troubled(getattr(pair, side), Cut()):
            await asyncio.sleep(LEASE + 1.0)
        # A reader that is cut off itself hears it too: its own end of the link is closed.
        assert pair.tokens == [(0.0, True), (LEASE, False), (LEASE + 1.0, True)]

    test()


@virtual
async def test_when_all_tokens_are_known_the_router_says() -> None:
    pair = Pair()
    pair.watch()
    everything = "alive/*"
    assert await pair.reader.hear_all_tokens(everything, 1.0)
    async with troubled(pair.reader, Delay(RNG(1), 0.2)):
        pair.writer.declare_token("alive/1")
        assert await pair.reader.hear_all_tokens(everything, 1.0)
        assert pair.tokens == [(pytest.approx(0.2), True)]
        assert now() == pytest.approx(0.4)
        assert not await pair.reader.hear_all_tokens(everything, 0.3)
    async with troubled(pair.reader, Cut()):
        assert not await pair.reader.hear_all_tokens(everything, 1.0)
        await asyncio.sleep(LEASE)
        began = now()
        assert not await pair.reader.hear_all_tokens(everything, 1.0)
        assert now() == began


@virtual
async def test_a_short_cut_shows_no_change_of_tokens() -> None:
    pair = Pair()
    pair.watch()
    pair.writer.declare_token("alive/1")
    async with troubled(pair.writer, Cut()):
        await asyncio.sleep(LEASE - 0.1)
    await asyncio.sleep(LEASE)
    assert pair.tokens == [(0.0, True)]


@virtual
async def test_a_token_that_is_declared_behind_a_cut_is_seen_after_it() -> None:
    pair = Pair()
    pair.watch()
    async with troubled(pair.writer, Cut()):
        pair.writer.declare_token("alive/1")
        await asyncio.sleep(0.5)
        assert pair.tokens == []
    assert pair.tokens == [(0.5, True)]


@virtual
async def test_a_token_that_goes_behind_a_cut_is_missed_after_it() -> None:
    pair = Pair()
    pair.watch()
    token = pair.writer.declare_token("alive/1")
    async with troubled(pair.reader, Cut()):
        token.close()
        await asyncio.sleep(0.5)
        assert pair.tokens == [(0.0, True)]
    assert pair.tokens == [(0.0, True), (0.5, False)]


@virtual
async def test_news_of_a_token_that_a_cut_has_swallowed_comes_after_it() -> None:
    pair = Pair()
    pair.watch()
    async with troubled(pair.reader, Delay(RNG(1), 0.4), "in"):
        pair.writer.declare_token("alive/1")
        await asyncio.sleep(0.1)
        async with troubled(pair.reader, Cut(), "in"):
            await asyncio.sleep(0.5)
        await asyncio.sleep(1.0)
    assert pair.tokens == [(1.0, True)]


@virtual
async def test_news_of_a_token_is_repeated_until_it_arrives() -> None:
    pair = Pair()
    pair.watch()
    async with troubled(pair.reader, Loss(RNG(1), 1.0)):
        pair.writer.declare_token("alive/1")
        pair.put("a message")
    assert pair.tokens == [(0.0, True)]
    assert pair.arrived == []


@virtual
async def test_a_frozen_process_loses_its_token_after_the_lease() -> None:
    pair = Pair()
    pair.watch()
    pair.writer.declare_token("alive/1")
    pair.writer.freeze()
    await asyncio.sleep(LEASE + 1.0)
    pair.writer.thaw()
    assert pair.tokens == [(0.0, True), (LEASE, False), (LEASE + 1.0, True)]


@virtual
async def test_a_killed_process_loses_its_token_at_once() -> None:
    pair = Pair()
    pair.watch()
    pair.writer.declare_token("alive/1")
    pair.writer.leave()
    assert pair.tokens == [(0.0, True), (0.0, False)]
