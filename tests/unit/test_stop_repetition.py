"""How long a stop is sent, and to whom: until it has arrived, and without undoing a resume. In virtual time."""

from __future__ import annotations

import asyncio

import pytest

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.messages import Reply, Stop, StopOrder
from muro_zenoh.orders.receipt import StopStatus
from muro_zenoh.orders.stop import resume_robots, stop_robots
from muro_zenoh.runtime.virtual_time import VirtualLoop, VirtualProcess, run_virtually
from tests.support.stop_lab import Lab, cut_off, lab, sent_by, statuses, virtual


@virtual
async def test_a_stop_is_sent_at_once_and_for_half_a_second_again(there: Lab) -> None:
    await there.agents("r1", deaf="r1")
    await there.base_station()
    sent = there.observer.every(channels.STOP)
    began = there.clock.now()
    await stop_robots(there.operator, ())
    orders = sent_by(sent, there.operator)
    assert [order.stamp - began for order in orders] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    assert all(order.all for order in orders)


@virtual
async def test_a_stop_is_repeated_until_it_has_arrived_and_half_a_second_from_there(there: Lab) -> None:
    agents = await there.agents("r1", "r2")
    store = await there.base_station()
    sent = there.observer.every(channels.STOP)
    async with cut_off(there.operator):
        stopping = asyncio.create_task(stop_robots(there.operator, ()))
        await asyncio.sleep(2.0)
        assert not sent_by(sent, there.operator)
    await asyncio.sleep(0.15)
    assert all(agent.latch.stopped for agent in agents.values())
    result = await stopping
    assert (statuses(result), result.confirmed) == (dict.fromkeys(agents, StopStatus.STOPPED), True)
    assert result.reply is not None
    assert store.stop.all
    assert len(sent_by(sent, there.operator)) == 6


@virtual
async def test_a_robot_that_was_stopped_before_is_no_sign_that_a_stop_of_others_has_arrived(there: Lab) -> None:
    """What the operator sends is lost; what the robots report arrives."""
    agents = await there.agents("r1", "r2", "r3")
    await there.base_station()
    other = await there.join(Role.OPERATOR)
    await resume_robots(other, ())
    await stop_robots(other, ("r1",))
    for names, stopped in ((("r1", "r2"), {"r1", "r2"}), ((), {"r1", "r2", "r3"})):
        async with cut_off(there.operator, "out"):
            stopping = asyncio.create_task(stop_robots(there.operator, names))
            await asyncio.sleep(1.93)
        await stopping
        assert {name for name, agent in agents.items() if agent.latch.stopped} == stopped


@pytest.mark.parametrize("names", [(), ("r1", "r2")])
@pytest.mark.parametrize(("down", "resumed"), [(0.05, 0.8), (0.3, 1.0), (1.2, 1.9)])
def test_a_stop_that_has_arrived_undoes_no_resume_though_its_sender_has_had_no_answer(
    down: float, resumed: float, names: tuple[str, ...]
) -> None:
    """The question was lost, and is awaited for a second."""

    async def run() -> None:
        async with lab() as there:
            agents = await there.agents("r1", "r2")
            store = await there.base_station()
            async with cut_off(there.operator):
                stopping = asyncio.create_task(stop_robots(there.operator, names))
                await asyncio.sleep(down)
            await asyncio.sleep(resumed - down)
            assert all(agent.latch.stopped for agent in agents.values())
            assert (await resume_robots(await there.join(Role.OPERATOR), ())).reply.accepted
            await stopping
            await asyncio.sleep(1.0)
            assert all(agent.latch.may_drive for agent in agents.values())
            assert (store.stop.all, store.stop.names) == (False, ())

    run_virtually(run())


@virtual
async def test_a_base_station_whose_disk_is_slow_is_asked_once(there: Lab) -> None:
    """It holds the stop at once; only its answer waits."""
    asked = []

    async def answer(stop: Stop) -> Reply:
        asked.append(stop)
        await asyncio.sleep(5.0)
        return Reply(accepted=True)

    agents = await there.agents("r1", "r2", deaf="r2")
    base = await there.join(Role.BASESTATION)
    base.announce(Role.BASESTATION, "basestation")
    base.answer(channels.STOP_ORDER, answer)
    sent = there.observer.every(channels.STOP)
    stopping = asyncio.create_task(stop_robots(there.operator, ()))
    await asyncio.sleep(0.25)
    agents["r1"].deaf = True
    agents["r1"].report(stop_latched=False)  # it had arrived all the same
    result = await stopping
    assert (result.reply, len(asked), len(sent_by(sent, there.operator))) == (None, 1, 6)


def process_of_an_operator() -> VirtualProcess:
    """One that can be frozen."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualLoop)
    return VirtualProcess(loop, "operator")


@virtual
async def test_a_stop_of_before_a_freeze_is_not_sent_after_it(there: Lab) -> None:
    """Whoever looks meanwhile may have resumed long since."""
    agents = await there.agents("r1")
    await there.base_station()
    await resume_robots(await there.join(Role.OPERATOR), ())
    process = process_of_an_operator()
    async with cut_off(there.operator):
        stopping = process.create_task(stop_robots(there.operator, ()))
        await asyncio.sleep(0.75)
        process.freeze()
        await asyncio.sleep(30.0)
    process.thaw()
    assert not (await stopping).confirmed
    await asyncio.sleep(1.0)
    assert agents["r1"].latch.may_drive


@pytest.mark.parametrize(("frozen", "resumed", "thawed"), [(0.05, 0.7, 0.9), (0.05, 1.5, 2.5), (0.35, 1.5, 2.9)])
def test_a_stop_that_arrived_before_a_short_freeze_is_not_sent_after_it(
    frozen: float, resumed: float, thawed: float
) -> None:
    async def run() -> None:
        async with lab() as there:
            agents = await there.agents("r1", "r2")
            store = await there.base_station()
            process = process_of_an_operator()
            stopping = process.create_task(stop_robots(there.operator, ()))
            await asyncio.sleep(frozen)
            process.freeze()
            await asyncio.sleep(resumed - frozen)
            assert (await resume_robots(await there.join(Role.OPERATOR), ())).reply.accepted
            await asyncio.sleep(max(0.0, thawed - resumed))
            process.thaw()
            await stopping
            await asyncio.sleep(1.0)
            assert all(agent.latch.may_drive for agent in agents.values())
            assert not store.stop.all

    run_virtually(run())


@virtual
async def test_a_stop_over_a_link_that_was_down_stops_nobody_who_was_resumed_meanwhile(there: Lab) -> None:
    """What the operator last knew was stopped is outdated by then."""
    agents = await there.agents("r1", "r2")
    store = await there.base_station()
    other = await there.join(Role.OPERATOR)
    await resume_robots(other, ())
    await stop_robots(other, ("r2",))
    async with cut_off(there.operator, "out"):
        stopping = asyncio.create_task(stop_robots(there.operator, ("r9",)))
        await asyncio.sleep(0.05)  # it has heard that r2 is stopped
        async with cut_off(there.operator, "in"):
            await asyncio.sleep(0.7)
            assert (await resume_robots(other, ("r2",))).reply.accepted
            await asyncio.sleep(1.3)
    await stopping
    await asyncio.sleep(1.0)
    assert agents["r2"].latch.may_drive
    assert "r2" not in store.stop.names


def test_a_stop_is_repeated_though_the_base_station_cannot_be_asked(caplog: pytest.LogCaptureFixture) -> None:
    async def fails(*_: object) -> Reply:
        raise RuntimeError("the middleware's own error")

    async def run() -> None:
        async with lab() as there:
            there.operator.ask = fails  # type: ignore[assignment, method-assign]
            agents = await there.agents("r1")
            sent = there.observer.every(channels.STOP)
            assert (await stop_robots(there.operator, ())).confirmed
            assert agents["r1"].latch.stopped
            assert len(sent_by(sent, there.operator)) == 6

    run_virtually(run())
    assert [r.getMessage() for r in caplog.records if r.levelname == "ERROR"] == [
        'the base station cannot be asked to keep a stop: RuntimeError("the middleware\'s own error")'
    ]


@virtual
async def test_a_stop_that_no_base_station_answers_is_repeated_as_long_as_it_is_waited_for(there: Lab) -> None:
    await there.agents("r1", deaf="r1")
    sent = there.observer.every(channels.STOP)
    began = there.clock.now()
    await stop_robots(there.operator, ())
    stamps = [order.stamp - began for order in sent_by(sent, there.operator)]
    assert stamps == pytest.approx([0.1 * count for count in range(len(stamps))])
    assert stamps[-1] == pytest.approx(3.0, abs=0.11)


@virtual
async def test_a_base_station_that_is_slow_to_answer_is_waited_for_though_all_robots_have_stopped(there: Lab) -> None:
    async def answer(stop: Stop) -> Reply:
        await asyncio.sleep(0.8)
        return Reply(accepted=True)

    await there.agents("r1")
    base = await there.join(Role.BASESTATION)
    base.announce(Role.BASESTATION, "basestation")
    base.answer(channels.STOP_ORDER, answer)
    result = await stop_robots(there.operator, ())
    assert result.reply is not None
    assert result.confirmed
    cancelled = asyncio.create_task(stop_robots(there.operator, ()))
    await asyncio.sleep(0.3)
    cancelled.cancel()
    await asyncio.wait({cancelled})
    await asyncio.sleep(0)
    assert "ask for a stop" not in {task.get_name() for task in asyncio.all_tasks()}


@virtual
async def test_without_a_base_station_a_stop_ends_when_all_robots_have_stopped(there: Lab) -> None:
    await there.agents("r1", "r2")
    began = there.clock.now()
    assert (await stop_robots(there.operator, ())).confirmed
    assert there.clock.now() - began == pytest.approx(0.6)


@virtual
async def test_the_resume_of_one_is_not_undone_while_another_has_not_confirmed_the_stop(there: Lab) -> None:
    agents = await there.agents("r1", "r2", deaf="r2")
    store = await there.base_station()
    stopping = asyncio.create_task(stop_robots(there.operator, ()))
    await asyncio.sleep(0.7)
    assert (await resume_robots(await there.join(Role.OPERATOR), ("r1",))).reply.accepted
    await stopping
    await asyncio.sleep(1.0)
    assert (agents["r1"].latch.may_drive, store.stop.names) == (True, ("r2", "r3"))


@virtual
async def test_a_robot_that_connects_while_the_stop_is_given_hears_of_it(there: Lab) -> None:
    stopping = asyncio.create_task(stop_robots(there.operator, ()))
    await asyncio.sleep(0.45)
    there.network._kept.clear()  # nothing but the repetition can tell it
    late = await there.agents("r1")
    assert statuses(await stopping) == {"r1": StopStatus.STOPPED}
    assert late["r1"].latch.all_robots


@virtual
async def test_a_stop_is_not_kept_by_its_sender(there: Lab) -> None:
    """Else whoever joins after somebody has resumed, and before its sender leaves, would hear that it holds."""
    stopping = asyncio.create_task(stop_robots(there.operator, ()))
    await asyncio.sleep(0.35)
    assert (await there.join()).latest(channels.STOP).get() is None
    await stopping


@pytest.mark.parametrize(
    ("before", "names", "expected"),
    [
        (StopOrder(all=False, revision=7), ("r1",), (False, ("r1",), 7)),
        (StopOrder(all=False, revision=7), (), (True, (), 7)),
        (StopOrder(all=False, names=("r2", "r3"), revision=7), ("r1",), (False, ("r1", "r2", "r3"), 7)),
        (StopOrder(all=False, names=("r2",), revision=7), (), (True, ("r2",), 7)),
        (StopOrder(all=True, revision=7), ("r1",), (True, ("r1",), 7)),
    ],
)
def test_a_stop_is_the_whole_state_with_what_was_stopped_before(
    before: StopOrder, names: tuple[str, ...], expected: tuple[bool, tuple[str, ...], int]
) -> None:
    async def run() -> None:
        async with lab() as there:
            there.observer.publisher(channels.STOP).put(before)
            sent = (await there.join()).every(channels.STOP)
            sent.drain()  # what was kept
            await stop_robots(there.operator, names)
            orders = [order.message for order in sent.drain()]
            # Later ones are sent without it: it was not repeated, so who was stopped may be resumed since.
            assert {(order.all, order.names, order.revision) for order in orders[:10]} == {expected}
            assert {order.revision for order in orders[20:]} == {0}

    run_virtually(run())


@virtual
async def test_who_knows_no_state_sends_revision_0_and_stops_only_those_named(there: Lab) -> None:
    agents = await there.agents("r1", "r2")
    result = await stop_robots(there.operator, ("r1",))
    assert statuses(result) == {"r1": StopStatus.STOPPED}
    assert (agents["r1"].latch.stopped, agents["r1"].latch.revision) == (True, 0)
    assert not agents["r2"].latch.received


@virtual
async def test_a_stop_by_name_after_one_to_everybody_lifts_nobodys(there: Lab) -> None:
    agents = await there.agents("r1", "r2", "r3")
    store = await there.base_station()
    assert (await stop_robots(there.operator, ())).confirmed
    assert (await stop_robots(there.operator, ("r1",))).confirmed
    await asyncio.sleep(1.0)
    assert store.stop.all
    assert all(agent.latch.all_robots for agent in agents.values())


@virtual
async def test_without_a_base_station_a_stop_by_name_lifts_nobodys_either(there: Lab) -> None:
    agents = await there.agents("r1", "r2")
    assert (await stop_robots(there.operator, ())).confirmed
    assert (await stop_robots(await there.join(Role.OPERATOR), ("r1",))).confirmed
    assert all(agent.latch.all_robots for agent in agents.values())
