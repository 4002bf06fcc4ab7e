"""An order that is held back until its sender waits no more is not carried out; a stop is."""

from __future__ import annotations

import asyncio
import random
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import ClockSettings
from muro_zenoh.errors import NoReply
from muro_zenoh.messages import Clear, Goal, Message, Reply, Resume, SetBehaviour, SetCircle, Stop
from muro_zenoh.runtime.virtual_time import VirtualClock
from muro_zenoh.transport import Bus, MemoryNetwork, make_bus
from muro_zenoh.transport.measured_clock import StationClock, answer_time
from muro_zenoh.transport.memory_faults import Delay, Stall, Trouble
from tests.support.virtual import virtual

ORDERS: tuple[tuple[channels.Verb[Message], Message], ...] = (
    (channels.RESUME, Resume(revision=3)),
    (channels.SET_CIRCLE, SetCircle(radius=0.7)),
    (channels.SET_BEHAVIOUR, SetBehaviour(behaviour="circle")),
    (channels.CLEAR, Clear(name="r1")),
)
"""Those to the base station that are not carried out at any age."""

AHEAD = (0.0, 5000.0, -5000.0)
"""By so much the operator's clock is ahead [s]."""


class Desk:
    """A base station that accepts all orders, and an operator, on one network."""

    def __init__(self, network: MemoryNetwork, station: Bus, operator: Bus) -> None:
        self.network, self.station, self.operator = network, station, operator
        self.obeyed: list[Message] = []
        for verb in channels.VERBS:
            if verb.answered_by is Role.BASESTATION and verb is not channels.TIME:
                station.answer(verb, self._obey)
        answer_time(station)

    def _obey(self, order: Message) -> Reply:
        self.obeyed.append(order)
        return Reply(accepted=True)

    async def held_back(self, verb: channels.Verb[Message], order: Message, lasts: float) -> float:
        """Give an order that a frozen router holds back; how long its sender waited [s]."""
        slow, frozen = Delay(random.Random(1), 0.1), Stall()
        loop = asyncio.get_running_loop()
        self.network.begin(slow)
        asking = asyncio.create_task(self.operator.ask(verb, order))
        # The question for the time takes until 0.2 s, unless it is an order that needs none.
        await asyncio.sleep(0.25 if verb in dict(ORDERS) else 0.05)
        self.network.begin(frozen)
        self.network.end(slow)
        began = loop.time()
        loop.call_later(lasts, self.network.end, frozen)
        try:
            await asking
        except NoReply:
            return loop.time() - began
        finally:
            await asyncio.sleep(lasts + 0.5)
        return loop.time() - began


@asynccontextmanager
async def desk(ahead: float = 0.0) -> AsyncIterator[Desk]:
    network, clock = MemoryNetwork(), VirtualClock()
    clock.offset = ahead
    async with (
        make_bus(network.link(), roles=[Role.BASESTATION], clock=VirtualClock()) as station,
        make_bus(network.link(), roles=[Role.OPERATOR], clock=clock) as operator,
    ):
        yield Desk(network, station, operator)


@pytest.mark.parametrize("ahead", AHEAD)
@pytest.mark.parametrize(("verb", "order"), ORDERS, ids=lambda row: getattr(row, "word", ""))
def test_an_order_whose_sender_has_given_up_is_refused(
    verb: channels.Verb[Message], order: Message, ahead: float
) -> None:
    @virtual
    async def check() -> None:
        async with desk(ahead) as there:
            assert (await there.operator.ask(verb, order)).accepted
            there.obeyed.clear()
            assert await there.held_back(verb, order, 1.2) == pytest.approx(0.95)
            assert there.obeyed == []
            assert there.station.counters[f"basestation/{verb.word}"].late == 1
            await there.held_back(verb, order, 0.5)
            assert len(there.obeyed) == 1, "its sender still waits"

    check()


@virtual
async def test_a_stop_is_obeyed_however_late_it_comes() -> None:
    async with desk() as there:
        await there.held_back(channels.STOP_ORDER, Stop(), 30.0)
        assert len(there.obeyed) == 1


@virtual
async def test_a_frozen_router_is_given_no_order_that_it_could_hold_back() -> None:
    async with desk() as there:
        frozen = Stall()
        there.network.begin(frozen)
        with pytest.raises(NoReply, match=r"nobody answered \(waited at most 1 s\), expected the base station"):
            await there.operator.ask(channels.RESUME, Resume(revision=3))
        there.network.end(frozen)
        await asyncio.sleep(3.0)
        assert there.obeyed == []


@pytest.mark.parametrize(("delay", "obeyed"), [(0.24, True), (0.45, True), (0.6, False)])
def test_a_slow_link_carries_orders_as_long_as_their_answers_come_in_time(delay: float, obeyed: bool) -> None:
    @virtual
    async def check() -> None:
        async with desk() as there:
            there.network.begin(Delay(random.Random(1), delay))
            try:
                accepted = (await there.operator.ask(channels.RESUME, Resume(revision=3))).accepted
            except NoReply:
                accepted = False
            await asyncio.sleep(3.0)
            assert (accepted, bool(there.obeyed)) == (obeyed, obeyed)

    check()


@pytest.mark.parametrize("ahead", AHEAD)
def test_an_agent_tells_by_the_base_station_s_clock_whether_a_goal_is_old(ahead: float) -> None:
    @virtual
    async def check() -> None:
        async with desk(0.5 * ahead) as there:
            clock = VirtualClock()
            clock.offset = ahead
            link = there.network.link()
            async with make_bus(link, roles=[Role.AGENT], clock=clock) as agent:
                agent.answer(channels.GOAL_ORDER, there._obey, name="r1")
                measuring = asyncio.create_task(StationClock(agent, ClockSettings()).run())
                await asyncio.sleep(2.0)
                goal = Goal(x=0.3, y=0.1)
                assert (await there.operator.ask(channels.GOAL_ORDER, goal, name="r1")).accepted
                late: Trouble = Delay(random.Random(1), 1.3)
                link.begin(late, "in")
                with pytest.raises(NoReply):
                    await there.operator.ask(channels.GOAL_ORDER, goal, name="r1")
                await asyncio.sleep(2.0)
                assert len(there.obeyed) == 1
                measuring.cancel()

    check()


@virtual
async def test_without_a_base_station_an_order_goes_out_at_once_and_without_a_deadline() -> None:
    network = MemoryNetwork()
    async with (
        make_bus(network.link(), roles=[Role.AGENT], clock=VirtualClock()) as agent,
        make_bus(network.link(), roles=[Role.OPERATOR], clock=VirtualClock()) as operator,
    ):
        heard: list[Goal] = []

        def obey(goal: Goal) -> Reply:
            heard.append(goal)
            return Reply(accepted=True)

        agent.answer(channels.GOAL_ORDER, obey, name="r1")
        assert (await operator.ask(channels.GOAL_ORDER, Goal(x=0.3, y=0.1), name="r1")).accepted
        assert [goal.until for goal in heard] == [None]
