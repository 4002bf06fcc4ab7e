"""Orders are asked and answered. On the in-memory bus and on Zenoh alike."""

from __future__ import annotations

import asyncio
import time

import pytest

from muro_zenoh import channels
from muro_zenoh.errors import ConfigError, MessageError, NoReply
from muro_zenoh.messages import (
    Reply,
    Resume,
    SetCircle,
    Stop,
)
from tests.contract.conftest import Network
from tests.contract.helpers import answered
from tests.support.waiting import seconds, within


async def test_an_order_is_answered(network: Network) -> None:
    bus, base = await network.open(), await network.open()
    heard: list[SetCircle] = []

    def handle(order: SetCircle) -> Reply:
        heard.append(order)
        return Reply(
            accepted=order.radius != 9.0, reason="" if order.radius != 9.0 else "outside the arena", revision=3
        )

    base.answer(channels.SET_CIRCLE, handle)
    await answered(bus)
    yes = await within(2, bus.ask(channels.SET_CIRCLE, SetCircle(radius=1.0)), "the answer")
    no = await within(2, bus.ask(channels.SET_CIRCLE, SetCircle(radius=9.0)), "the answer")
    assert (yes.accepted, yes.revision, yes.epoch) == (True, 3, base.epoch)
    assert (no.accepted, no.reason) == (False, "outside the arena")
    assert [order.radius for order in heard[-2:]] == [1.0, 9.0]
    assert heard[-1].epoch == bus.epoch
    assert heard[-1].stamp > 0.0


async def test_a_bus_may_ask_itself(network: Network) -> None:
    bus = await network.open()
    bus.answer(channels.STOP_ORDER, lambda order: Reply(accepted=True, revision=8))
    assert (await within(2, bus.ask(channels.STOP_ORDER, Stop()), "the answer")).revision == 8


async def test_nobody_answers(network: Network) -> None:
    bus = await network.open()
    began = time.monotonic()
    with pytest.raises(NoReply, match="basestation/stop: nobody answered"):
        await bus.ask(channels.STOP_ORDER, Stop(), timeout=5.0)
    assert time.monotonic() - began < seconds(1.0)


async def test_an_order_that_is_none_is_refused_with_the_reason(network: Network) -> None:
    bus, base = await network.open(), await network.open()
    base.answer(channels.SET_CIRCLE, lambda order: Reply(accepted=True))
    await answered(bus)
    counters = base.counters["basestation/set_circle"]
    received = counters.received
    wrong = channels.Verb("set_circle", Resume)
    reply = await within(2, bus.ask(wrong, Resume(revision=3)), "the refusal")
    assert not reply.accepted
    assert "SetCircle" in reply.reason
    assert (counters.received, counters.rejected) == (received + 1, 1)


async def test_a_handler_that_refuses_or_fails_still_answers(
    network: Network, caplog: pytest.LogCaptureFixture
) -> None:
    bus, base = await network.open(), await network.open()

    def handle(order: SetCircle) -> Reply:
        if order.radius == 1.0:
            raise ConfigError("circle.radius", got="1", expected="at most 0.5 m")
        if order.radius == 2.0:
            raise ZeroDivisionError("a bug")
        return Reply(accepted=True)

    base.answer(channels.SET_CIRCLE, handle)
    await answered(bus)
    refused = await within(2, bus.ask(channels.SET_CIRCLE, SetCircle(radius=1.0)), "the refusal")
    assert (refused.accepted, refused.reason) == (False, "circle.radius: got 1, expected at most 0.5 m")
    failed = await within(2, bus.ask(channels.SET_CIRCLE, SetCircle(radius=2.0)), "the failure")
    assert not failed.accepted
    assert "ZeroDivisionError" in failed.reason
    assert "a bug" in caplog.text
    assert (await within(2, bus.ask(channels.SET_CIRCLE, SetCircle()), "the next answer")).accepted


async def test_a_reply_that_is_none_is_an_error(network: Network) -> None:
    bus, base = await network.open(), await network.open()
    base._link.answer(f"{network.realm}/basestation/stop", lambda question: question.reply(b"garbage", "text/plain"))
    async with asyncio.timeout(seconds(5)):
        while True:
            try:
                with pytest.raises(MessageError, match="Reply"):
                    await bus.ask(channels.STOP_ORDER, Stop())
                return
            except NoReply:
                await asyncio.sleep(0.01)
