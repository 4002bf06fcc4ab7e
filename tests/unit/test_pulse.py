"""Orders that piled up while their process was frozen are not carried out when it wakes; a stop is."""

from __future__ import annotations

import asyncio
import time

import pytest

from muro_zenoh import channels
from muro_zenoh.messages import Reply, Resume, SetCircle, Stop
from muro_zenoh.runtime.virtual_time import VirtualClock
from muro_zenoh.transport import MemoryNetwork, make_bus
from tests.support.virtual import virtual


@virtual
async def test_an_order_that_may_be_left_over_from_a_pause_is_refused_and_a_stop_is_taken() -> None:
    network, clock = MemoryNetwork(), VirtualClock()
    async with make_bus(network.link(), clock=clock) as bus, make_bus(network.link()) as operator:
        bus.answer(channels.SET_CIRCLE, lambda order: Reply(accepted=True))
        bus.answer(channels.RESUME, lambda order: Reply(accepted=True))
        bus.answer(channels.STOP_ORDER, lambda order: Reply(accepted=True))
        await asyncio.sleep(1.0)
        for pause, accepted in ((0.4, True), (5.0, False)):
            clock.offset += pause  # the process was frozen
            for beat in (0.0, 0.25):  # before its loop has noticed, and after
                await asyncio.sleep(beat)
                reply = await operator.ask(channels.SET_CIRCLE, SetCircle(radius=0.7))
                assert reply.accepted == accepted, (pause, beat)
                assert (await operator.ask(channels.RESUME, Resume(revision=3))).accepted == accepted
                assert accepted or reply.reason.endswith("the order may be old: give it again")
                assert (await operator.ask(channels.STOP_ORDER, Stop())).accepted
            await asyncio.sleep(1.0)
            assert (await operator.ask(channels.SET_CIRCLE, SetCircle(radius=0.7))).accepted
        assert bus.counters["basestation/set_circle"].late == 2


async def test_an_order_that_waited_for_a_blocked_loop_is_refused() -> None:
    network = MemoryNetwork()
    async with make_bus(network.link()) as bus, make_bus(network.link()) as operator:
        bus.answer(channels.SET_CIRCLE, lambda order: Reply(accepted=True))
        asking = asyncio.create_task(operator.ask(channels.SET_CIRCLE, SetCircle(radius=0.7), timeout=9.0))
        asyncio.get_running_loop().call_soon(time.sleep, 0.8)  # a behaviour that blocks
        reply = await asking
        assert not reply.accepted


async def test_a_bus_that_is_closed_beats_no_more() -> None:
    async with make_bus(MemoryNetwork().link()) as bus:
        bus.answer(channels.SET_CIRCLE, lambda order: Reply(accepted=True))
        pulse = bus._pulse
        assert pulse is not None
    assert pulse._timer.cancelled()


@pytest.mark.parametrize("verb", channels.VERBS, ids=lambda verb: verb.word)
def test_only_an_order_that_moves_no_robot_is_carried_out_at_any_age(verb: channels.Verb[Stop]) -> None:
    assert verb.at_any_age == (verb.word in ("stop", "lease", "time", "base_time"))
