"""Stop, resume and clear as an operator gives them: what is taken for confirmed, what is said. Agents are stand-ins."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from click.testing import CliRunner, Result

from basestation.localization.sightings import Sighting, Sightings
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.cli import orders as commands
from muro_zenoh.cli.main import main
from muro_zenoh.config import BusSettings
from muro_zenoh.errors import NoReply
from muro_zenoh.geometry import Pose2
from muro_zenoh.messages import Reply, Resume, StopOrder
from muro_zenoh.orders.receipt import StopStatus
from muro_zenoh.orders.stop import resume_robots, stop_robots
from muro_zenoh.runtime.virtual_time import run_virtually
from muro_zenoh.safety.stop import StopLatch
from muro_zenoh.transport import Bus
from tests.support.stop_lab import Lab, Test, lab, statuses, virtual

# ---- what is taken for confirmed


@virtual
async def test_only_who_reports_the_stop_has_stopped(there: Lab) -> None:
    await there.agents("r1", "r2", deaf="r2")
    await there.base_station()
    began = there.clock.now()
    result = await stop_robots(there.operator, ())
    assert statuses(result) == {"r1": StopStatus.STOPPED, "r2": StopStatus.UNCONFIRMED}
    assert not result.confirmed
    assert there.clock.now() - began == pytest.approx(3.1, abs=0.05)  # it was waited for


@virtual
async def test_the_receipt_says_when_each_robot_was_at_rest_and_how_far_it_went(there: Lab) -> None:
    """From 0.4 m/s at 1 m/s^2: 0.4 s and 0.08 m, and up to a period of the odometry each."""
    agents = await there.agents("r1", "r2")
    agents["r1"].speed = 0.4
    await asyncio.sleep(1.02)  # between two reports of the wheels
    result = await stop_robots(there.operator, ())
    driven, parked = result.robots["r1"], result.robots["r2"]
    assert driven.latched == pytest.approx(0.0, abs=1e-3)
    assert driven.at_rest == pytest.approx(0.4, abs=0.05)
    assert driven.travelled == pytest.approx(0.08, abs=0.017)
    assert (parked.travelled, parked.silent) == (0.0, None)
    assert parked.at_rest is not None
    assert parked.at_rest <= 0.04
    assert result.confirmed


@virtual
async def test_wheels_that_still_turn_or_are_silent_have_not_stopped(there: Lab) -> None:
    agents = await there.agents("r1", "r2", "r3")
    await there.base_station()
    agents["r1"].latch = StopLatch(received=True)
    agents["r1"].speed = 9.0  # it brakes for longer than is waited
    agents["r2"].wheels.cancel()
    result = await stop_robots(there.operator, ())
    assert statuses(result) == {
        "r1": StopStatus.MOVING,
        "r2": StopStatus.NO_ODOMETRY,
        "r3": StopStatus.STOPPED,
    }
    assert not result.confirmed
    assert result.robots["r2"].silent is None or result.robots["r2"].silent > 3.0


@virtual
async def test_wheels_that_turn_again_are_not_at_rest(there: Lab) -> None:
    agents = await there.agents("r1")
    stopping = asyncio.create_task(stop_robots(there.operator, ()))
    await asyncio.sleep(0.3)
    agents["r1"].deaf, agents["r1"].latch = True, StopLatch(received=True)  # it drives on, and does not say so
    agents["r1"].speed = 0.2
    result = await stopping
    assert statuses(result) == {"r1": StopStatus.MOVING}


@virtual
async def test_a_stop_leaves_nothing_on_the_bus(there: Lab) -> None:
    await there.agents("r1")
    await there.base_station()
    there.operator.roster().close()  # the first one declares the watch of tokens, which stays
    before = len(there.operator._open)
    await stop_robots(there.operator, ())
    await resume_robots(there.operator, ())
    assert len(there.operator._open) == before


def test_the_receipt_as_json(monkeypatch: pytest.MonkeyPatch) -> None:
    async def prepare(there: Lab) -> None:
        await there.agents("r1", "r2", deaf="r2")
        await there.base_station()

    done = muro("stop", "--json", prepare=prepare, monkeypatch=monkeypatch)
    receipt = json.loads(done.output)
    assert receipt["confirmed"] is False
    assert receipt["basestation"] == {"accepted": True, "reason": "", "revision": 3}
    r1, r2 = receipt["robots"]["r1"], receipt["robots"]["r2"]
    assert (r1["status"], r2["status"]) == ("stopped", "unconfirmed")
    assert (r1["travelled_m"], r1["silent_s"], r2["latched_after_s"]) == (0.0, None, None)
    assert 0.0 <= r1["at_rest_after_s"] <= 0.04
    assert r2["silent_s"] == pytest.approx(3.1, abs=0.1)
    assert done.exit_code == 1


@virtual
async def test_a_late_confirmation_counts(there: Lab) -> None:
    agents = await there.agents("r1", deaf="r1")
    stopping = asyncio.create_task(stop_robots(there.operator, ()))
    await asyncio.sleep(2.5)
    agents["r1"].report(stop_latched=True)
    assert statuses(await stopping) == {"r1": StopStatus.STOPPED}


@pytest.mark.parametrize("after", [0.3, 1.0])
def test_who_disappears_before_he_has_confirmed_is_named_all_the_same(after: float) -> None:
    """A frozen agent's lease expires while the stop is repeated, or while it is waited for."""

    async def run() -> None:
        async with lab() as there:
            agents = await there.agents("r1", "r2", deaf="r2")
            stopping = asyncio.create_task(stop_robots(there.operator, ()))
            await asyncio.sleep(after)
            agents["r2"].task.cancel()
            await agents["r2"].bus.close()
            result = await stopping
            assert statuses(result) == {"r1": StopStatus.STOPPED, "r2": StopStatus.NOT_ALIVE}
            assert not result.confirmed

    run_virtually(run())


def sightings(there: Lab, *names: str) -> Sightings:
    """The robots, as a camera saw them just now."""
    robots = tuple(Sighting(name, Pose2(0.6 * k - 0.6, 0.0, 0.0), (1e-6,) * 9) for k, name in enumerate(names))
    return Sightings(camera="north", captured=there.clock.now(), robots=robots)


@virtual
async def test_who_disappeared_before_the_stop_is_named_as_long_as_it_is_on_the_floor(there: Lab) -> None:
    """A frozen agent, whose lease expired a while ago: nobody knows whether its robot stands still."""
    await there.agents("r1")
    await there.base_station(sightings(there, "r1", "r2"))
    result = await stop_robots(there.operator, ())
    assert statuses(result) == {"r1": StopStatus.STOPPED, "r2": StopStatus.NOT_ALIVE}
    assert not result.confirmed
    assert (await stop_robots(there.operator, ("r1",))).confirmed, "of those that are named only"


@virtual
async def test_where_nobody_is_alive_the_base_stations_answer_counts(there: Lab) -> None:
    alone = await stop_robots(there.operator, ())
    assert (alone.reply, alone.robots, alone.confirmed) == (None, {}, False)
    store = await there.base_station()
    assert (await stop_robots(there.operator, ())).confirmed
    assert store.stop.all


# ---- resume


@virtual
async def test_resume_names_who_still_reports_that_he_is_stopped(there: Lab) -> None:
    agents = await there.agents("r1", "r2")
    await there.base_station()
    await stop_robots(there.operator, ())
    agents["r2"].deaf = True  # frozen: it hears of no resume
    result = await resume_robots(there.operator, ())
    assert result.reply.accepted
    assert result.still_stopped == ("r2",)
    agents["r2"].deaf = False
    await asyncio.sleep(1.0)
    assert (await resume_robots(there.operator, ())).still_stopped == ()
    assert all(agent.latch.may_drive for agent in agents.values())


@virtual
async def test_a_robot_that_takes_its_time_to_resume_is_waited_for(there: Lab) -> None:
    agents = await there.agents("r1")
    await there.base_station()
    await stop_robots(there.operator, ())
    agents["r1"].deaf = True
    resuming = asyncio.create_task(resume_robots(there.operator, ()))
    await asyncio.sleep(2.0)
    agents["r1"].report(stop_latched=False)
    result = await resuming
    assert (result.reply.accepted, result.still_stopped) == (True, ())


@virtual
async def test_resume_of_one_waits_for_that_one_alone(there: Lab) -> None:
    agents = await there.agents("r1", "r2")
    store = await there.base_station()
    await stop_robots(there.operator, ())
    result = await resume_robots(there.operator, ("r2",))
    assert (result.reply.accepted, result.still_stopped) == (True, ())
    assert agents["r1"].latch.stopped
    assert store.stop.names == ("r1", "r3")


@virtual
async def test_a_robot_that_reports_nothing_has_not_resumed(there: Lab) -> None:
    await there.agents("r1")
    await there.base_station()
    silent = await there.join(Role.AGENT)
    silent.announce(Role.AGENT, "r3")
    result = await resume_robots(there.operator, ())
    assert result.reply.accepted
    assert result.still_stopped == ("r3",)


@virtual
async def test_a_base_station_that_starts_just_now_is_waited_for(there: Lab) -> None:
    await there.agents("r1")
    station = await there.join(Role.BASESTATION)

    async def start() -> None:
        await asyncio.sleep(1.0)
        station.announce(Role.BASESTATION, "basestation")
        station.publisher(channels.STOP).put(StopOrder(all=False, revision=3))

    asked: list[int] = []

    def answer(order: Resume) -> Reply:
        asked.append(order.revision)
        return Reply(accepted=False, reason="not now")

    station.answer(channels.RESUME, answer)
    starting = asyncio.create_task(start())
    began = there.clock.now()
    assert not (await resume_robots(there.operator, ())).reply.accepted
    assert asked == [3]
    assert there.clock.now() - began == pytest.approx(1.0, abs=0.05)
    await starting


@virtual
async def test_a_resume_is_asked_for_at_once_where_the_base_station_is_known(there: Lab) -> None:
    await there.agents("r1")
    await there.base_station()
    began = there.clock.now()
    assert (await resume_robots(there.operator, ())).reply.accepted
    assert there.clock.now() - began < 0.2


@virtual
async def test_resume_without_a_base_station_is_refused(there: Lab) -> None:
    agents = await there.agents("r1")
    await stop_robots(there.operator, ())
    with pytest.raises(NoReply, match=r"the base station is silent \(waited 1.5 s"):
        await resume_robots(there.operator, ())
    assert agents["r1"].latch.stopped


@virtual
async def test_a_stop_before_the_base_stations_first_start_is_not_lifted_by_it(there: Lab) -> None:
    """Nobody had ever heard a state: the order, and what the robots latched, have revision 0."""
    agents = await there.agents("r1", "r2")
    assert (await stop_robots(there.operator, ())).confirmed
    await there.operator.close()
    store = await there.base_station()
    assert store.stop.all
    assert all(agent.latch.stopped for agent in agents.values())


# ---- what is said, and the exit code


def muro(*arguments: str, prepare: Test, monkeypatch: pytest.MonkeyPatch) -> Result:
    """A command on the in-memory bus, in virtual time."""

    def on_bus(command: Callable[[Bus], Coroutine[Any, Any, int]], settings: BusSettings) -> None:
        async def run() -> int:
            async with lab() as there:
                await prepare(there)
                return await command(there.operator)

        raise SystemExit(run_virtually(run()))

    monkeypatch.setattr(commands, "on_bus", on_bus)
    return CliRunner().invoke(main, arguments, prog_name="muro")


def at_some_beat(output: str) -> str:
    """A receipt of robots at rest, whenever their wheels reported that: at 25 Hz."""
    return re.sub(r"0\.0[0-4] s  ", "0.0x s  ", output)


def test_the_command_names_a_robot_that_does_not_confirm_and_exits_with_1(monkeypatch: pytest.MonkeyPatch) -> None:
    async def prepare(there: Lab) -> None:
        await there.agents("r1", "r2", deaf="r2")
        await there.base_station()

    done = muro("stop", prepare=prepare, monkeypatch=monkeypatch)
    assert at_some_beat(done.output).splitlines()[1:] == [
        "base station: accepted, revision 3",
        "robot  latched after  at rest after  travelled",
        "r1     0.000 s        0.0x s         0.000 m    has stopped",
        "r2     -              0.0x s         0.000 m    DOES NOT CONFIRM",
        "1 of 2 robots stopped; r2 silent for 3.1 s",
    ]
    assert done.exit_code == 1


def test_the_command_exits_with_0_when_everybody_has_confirmed(monkeypatch: pytest.MonkeyPatch) -> None:
    async def prepare(there: Lab) -> None:
        await there.agents("r1", "r2")

    done = muro("stop", prepare=prepare, monkeypatch=monkeypatch)
    assert at_some_beat(done.output) == (
        "stop sent 22:13:20.000 to the router tcp/127.0.0.1:7447\n"
        "base station: did not answer: only the agents that are running now remember this stop, until it is back\n"
        "robot  latched after  at rest after  travelled\n"
        "r1     0.000 s        0.0x s         0.000 m    has stopped\n"
        "r2     0.000 s        0.0x s         0.000 m    has stopped\n"
        "2 of 2 robots stopped\n"
    )
    assert done.exit_code == 0


def test_the_command_names_a_robot_that_is_seen_and_not_alive(monkeypatch: pytest.MonkeyPatch) -> None:
    async def prepare(there: Lab) -> None:
        await there.agents("r1")
        await there.base_station(sightings(there, "r1", "r2"))

    done = muro("stop", prepare=prepare, monkeypatch=monkeypatch)
    assert done.output.splitlines()[-2:] == [
        "r2     -              -              -          is not alive, so it does not confirm",
        "1 of 2 robots stopped; r2 silent for 3.1 s",
    ]
    assert done.exit_code == 1


def test_a_robot_that_nobody_knows_is_ordered_to_stop_and_named(monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[StopOrder] = []

    async def prepare(there: Lab) -> None:
        await there.agents("r1")
        await there.base_station()
        orders = there.observer.every(channels.STOP)
        there.stack.callback(lambda: sent.extend(order.message for order in orders.drain()))

    done = muro("stop", "r1", "r9", prepare=prepare, monkeypatch=monkeypatch)
    assert done.output.splitlines()[-3:] == [
        "r9     -              -              -          no robot of this name is known",
        "known robots: r1; the stop holds for the others, should they come",
        "1 of 2 robots stopped; r9 unknown",
    ]
    assert done.exit_code == 1
    assert ("r1", "r9") in {order.names for order in sent}


def test_the_command_says_where_it_asked_when_nobody_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    async def prepare(there: Lab) -> None:
        pass

    done = muro("stop", "--connect", "tcp/127.0.0.1:7999", prepare=prepare, monkeypatch=monkeypatch)
    first, *_, hint, last = done.output.splitlines()
    assert first.endswith("to the router tcp/127.0.0.1:7999")
    assert hint.endswith("name it with --connect")
    assert (last, done.exit_code) == ("no robot is alive", 1)
    table = json.loads(muro("stop", "--json", prepare=prepare, monkeypatch=monkeypatch).output)
    assert table["routers"] == ["tcp/127.0.0.1:7447"]


@pytest.mark.parametrize(
    ("reason", "said"),
    [("", "r1: accepted\n"), ("stopped by order", "r1: accepted; it does not drive yet: stopped by order\n")],
)
def test_a_goal_to_a_stopped_robot_says_so(reason: str, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    async def prepare(there: Lab) -> None:
        agents = await there.agents("r1")
        agents["r1"].bus.answer(channels.GOAL_ORDER, lambda goal: Reply(accepted=True, reason=reason), name="r1")

    done = muro("goal", "r1", "0.5", "0", prepare=prepare, monkeypatch=monkeypatch)
    assert (done.output, done.exit_code) == (said, 0)


@pytest.mark.parametrize("deaf", [False, True])
def test_resume_says_who_is_still_stopped_and_exits_with_1(deaf: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    async def prepare(there: Lab) -> None:
        agents = await there.agents("r1", "r2")
        await there.base_station()
        await stop_robots(await there.join(Role.OPERATOR), ())
        agents["r2"].deaf = deaf

    done = muro("resume", prepare=prepare, monkeypatch=monkeypatch)
    still = "r2: still reports that it is stopped\n" if deaf else ""
    assert done.output == f"base station: accepted, revision 4\n{still}"
    assert done.exit_code == (1 if deaf else 0)


def test_resume_that_is_refused_exits_with_1(monkeypatch: pytest.MonkeyPatch) -> None:
    async def prepare(there: Lab) -> None:
        await there.base_station()

    done = muro("resume", "r9", prepare=prepare, monkeypatch=monkeypatch)
    assert done.output == "base station: refused: robot r9: expected names out of r1, r2, r3\n"
    assert done.exit_code == 1


@pytest.mark.parametrize(
    ("name", "said", "code", "left"),
    [
        ("r1", "r1: forgotten, until a camera sees it again\n", 0, {"r2"}),
        ("r3", "refused: robot r3 was never seen\n", 1, {"r1", "r2"}),
    ],
)
def test_clear_forgets_where_a_robot_was_last_seen(
    name: str, said: str, code: int, left: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found: set[str] = set()

    async def prepare(there: Lab) -> None:
        robots = tuple(Sighting(n, Pose2(x, 0.0, 0.0), (1e-6,) * 9) for n, x in (("r1", 0.3), ("r2", -0.3)))
        await there.base_station(Sightings(camera="north", captured=there.clock.now(), robots=robots))
        positions = there.observer.latest(channels.ALL_POSITIONS)

        async def look() -> None:
            async for received in positions:
                found.clear()
                found.update(robot.name for robot in received.message.robots)

        looking = asyncio.create_task(look())
        there.stack.callback(looking.cancel)
        await asyncio.sleep(0.5)
        assert found == {"r1", "r2"}

        async def linger() -> None:
            await asyncio.sleep(0.5)  # the next snapshot

        there.stack.push_async_callback(linger)

    done = muro("clear", name, prepare=prepare, monkeypatch=monkeypatch)
    assert (done.output, done.exit_code) == (said, code)
    assert found == left
