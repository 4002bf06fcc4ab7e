"""Orders are asked and answered. On the in-memory bus and on Zenoh alike."""

from __future__ import annotations

import asyncio
import time

import pytest

from muro_zenoh import channels
from muro_zenoh.channels import Role, Verb
from muro_zenoh.errors import ConfigError, MessageError, NoReply
from muro_zenoh.messages import (
    Goal,
    Reply,
    Resume,
    SetCircle,
    Stop,
)
from tests.contract.conftest import Network
from tests.contract.helpers import answered, asked, first_answer, until
from tests.support.waiting import SETTLING, seconds, within


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
    yes = await asked(bus, channels.SET_CIRCLE, SetCircle(radius=1.0))
    no = await asked(bus, channels.SET_CIRCLE, SetCircle(radius=9.0))
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


DIG = Verb("dig", Goal, named="robot", answered_by=Role.AGENT)


async def test_an_order_to_one_robot_reaches_that_robot(network: Network) -> None:
    bus = await network.open(roles=[Role.OPERATOR])
    for name in ("r1", "r2"):
        agent = await network.open(roles=[Role.AGENT])
        agent.answer(DIG, lambda goal, name=name: Reply(accepted=goal.x > 0.0, reason=name), name=name)  # type: ignore[misc]
    for name in ("r1", "r2"):
        reply = await first_answer(bus, DIG, Goal(x=1.0, y=0.0), name)
        assert (reply.accepted, reply.reason) == (True, name)
    assert not (await asked(bus, DIG, Goal(x=-1.0, y=0.0), "r1")).accepted


async def test_nobody_answers_for_a_robot(network: Network) -> None:
    bus = await network.open()
    with pytest.raises(
        NoReply, match=r"dig/r7: nobody .*at most 5 s.*the agent of r7 to answer\. Is `muro agent FILE r7` running"
    ):
        await bus.ask(DIG, Goal(x=0.0, y=0.0), name="r7", timeout=5.0)


async def test_an_order_has_a_name_where_it_needs_one_and_only_there(network: Network) -> None:
    bus = await network.open()
    for use in (
        lambda: bus.answer(DIG, lambda goal: Reply(accepted=True)),
        lambda: bus.answer(DIG, lambda goal: Reply(accepted=True), name="*"),
        lambda: bus.answer(channels.RESUME, lambda order: Reply(accepted=True), name="r1"),
    ):
        with pytest.raises(ConfigError, match=r"order (dig|resume): got"):
            use()
    with pytest.raises(ConfigError, match="order dig: got"):
        await bus.ask(DIG, Goal(x=0.0, y=0.0))


async def test_an_answer_may_be_awaited_and_does_not_hold_up_the_next(network: Network) -> None:
    bus, base = await network.open(), await network.open()
    begun, go_on = asyncio.Event(), asyncio.Event()

    async def handle(order: SetCircle) -> Reply:
        if order.radius == 1.0:
            begun.set()
            await go_on.wait()
        if order.radius == 2.0:
            raise ConfigError("circle.radius", got="2", expected="at most 1 m")
        return Reply(accepted=True)

    base.answer(channels.SET_CIRCLE, handle)
    await answered(bus)
    slow = asyncio.create_task(asked(bus, channels.SET_CIRCLE, SetCircle(radius=1.0)))
    await within(5, begun.wait(), "the slow order")
    assert (await asked(bus, channels.SET_CIRCLE, SetCircle())).accepted
    refused = await asked(bus, channels.SET_CIRCLE, SetCircle(radius=2.0))
    assert "at most 1 m" in refused.reason
    assert not slow.done()
    go_on.set()
    assert (await within(2, slow, "the slow answer")).accepted


async def test_orders_that_wait_are_bounded_and_the_rest_is_counted(network: Network) -> None:
    bus, base = await network.open(), await network.open()
    go_on = asyncio.Event()

    async def handle(order: SetCircle) -> Reply:
        if order.radius is not None:
            await go_on.wait()
        return Reply(accepted=True)

    base.answer(channels.SET_CIRCLE, handle)
    await answered(bus)
    counters = base.counters["basestation/set_circle"]
    for _ in range(5):
        received, late = counters.received, counters.late
        asking = [
            asyncio.create_task(bus.ask(channels.SET_CIRCLE, SetCircle(radius=1.0), timeout=seconds(3)))
            for _ in range(64 + 5)
        ]
        await until(lambda: counters.received == received + 64 + 5, "all of them")  # noqa: B023 - awaited here
        if counters.late == late:
            break
        # The machine stood still, and orders were refused for that.
        go_on.set()
        await asyncio.gather(*asking, return_exceptions=True)
        go_on.clear()
        await asyncio.sleep(SETTLING)
    assert counters.dropped == 5
    go_on.set()
    replies = await asyncio.gather(*asking, return_exceptions=True)
    assert sum(isinstance(reply, Reply) for reply in replies) == 64
    assert sum(isinstance(reply, NoReply) for reply in replies) == 5
    assert (await asked(bus, channels.SET_CIRCLE, SetCircle(radius=1.0))).accepted, "there is room again"


async def test_closing_a_bus_ends_the_answers_that_it_works_on(network: Network) -> None:
    bus, base = await network.open(), await network.open()
    begun, ended = asyncio.Event(), list[bool]()

    async def handle(order: SetCircle) -> Reply:
        if order.radius is not None:
            begun.set()
            try:
                await asyncio.Event().wait()
            finally:
                ended.append(True)
        return Reply(accepted=True)

    base.answer(channels.SET_CIRCLE, handle)
    await answered(bus)
    asking = asyncio.create_task(asked(bus, channels.SET_CIRCLE, SetCircle(radius=1.0)))
    await within(5, begun.wait(), "the order")
    await within(5, base.close(), "closing")
    assert ended == [True]
    with pytest.raises((NoReply, TimeoutError)):
        await asyncio.wait_for(asking, 0.2)


async def test_an_invalid_order_is_refused_with_the_reason(network: Network) -> None:
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
    refused = await asked(bus, channels.SET_CIRCLE, SetCircle(radius=1.0))
    assert (refused.accepted, refused.reason) == (False, "circle.radius: got 1, expected at most 0.5 m")
    failed = await asked(bus, channels.SET_CIRCLE, SetCircle(radius=2.0))
    assert not failed.accepted
    assert "ZeroDivisionError" in failed.reason
    assert "a bug" in caplog.text
    assert (await asked(bus, channels.SET_CIRCLE, SetCircle())).accepted


async def test_an_invalid_reply_is_an_error(network: Network) -> None:
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
