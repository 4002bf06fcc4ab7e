"""Real agents and bases in virtual time: zero is commanded when it is due, and not with the next command."""

from __future__ import annotations

import asyncio
import itertools
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import numpy as np
import pytest

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.messages import Estimate, Health, SetBehaviour, StopOrder, VelocityCommand
from muro_zenoh.orders.stop import resume_robots, stop_robots
from muro_zenoh.runtime.virtual_time import run_virtually
from muro_zenoh.transport import Every
from tests.support.memory_fleet import MemoryFleet, memory_fleet, scenario

BETWEEN = (0.013, 0.031, 0.047)
"""Times after a fix at which nothing else happens [s]."""

OWN = """
import asyncio

SEEN = []

async def once(robot):
    robot.drive(0.2, 0.0)
    await asyncio.sleep(60)

async def on_and_off(robot):
    while True:
        for _ in range(10):
            robot.drive(0.2, 0.0)
            await asyncio.sleep(0.0497)
        robot.hold("a pause")
        SEEN.append(robot.now)
        await asyncio.sleep(0.5)

async def away(robot):
    async for estimate in robot.estimates():
        SEEN.append(estimate)
        robot.drive(0.2 if abs(estimate.x) < 5.0 else -0.3, 0.0)
"""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The module ``lab_stops`` with the behaviours above."""
    (tmp_path / "lab_stops.py").write_text(OWN)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "lab_stops", raising=False)


@asynccontextmanager
async def driving(robots: int = 1, behaviour: str = "circle") -> AsyncIterator[MemoryFleet]:
    async with memory_fleet(scenario(robots, behaviour)) as fleet:
        await fleet.until(lambda: len(fleet.driving) == robots, 3, "all drive")
        yield fleet


async def commands_of(fleet: MemoryFleet, name: str = "r1") -> Every[VelocityCommand]:
    return (await fleet.bus()).every(channels.CMD_VEL, name, depth=1024)


async def after_a_fix(fleet: MemoryFleet, pause: float) -> float:
    """Wait until a time after the arrival of a fix; returns the time."""
    fixes = (await fleet.bus()).every(channels.POSE, "r1")
    await fixes.next()
    fixes.close()
    await asyncio.sleep(pause)
    return fleet.clock.now()


@pytest.mark.parametrize("pause", BETWEEN)
@pytest.mark.parametrize("by_name", [False, True])
def test_a_stop_is_zero_and_is_reported_at_once(pause: float, by_name: bool) -> None:
    async def main() -> None:
        async with driving() as fleet:
            operator = await fleet.bus(Role.OPERATOR)
            order = operator.publisher(channels.STOP)
            commands = await commands_of(fleet)
            healths: Every[Health] = (await fleet.bus()).every(channels.HEALTH, "r1")
            now = await after_a_fix(fleet, pause)
            commands.drain(), healths.drain()
            order.put(StopOrder(all=not by_name, names=("r1",) if by_name else (), revision=0))
            await asyncio.sleep(0.001)
            zeros = [received.message for received in commands.drain()]
            assert zeros[0].stamp - now < 1e-3
            assert {(zero.v, zero.omega) for zero in zeros} == {(0.0, 0.0)}
            assert fleet.commanded("r1") == (0.0, 0.0)
            health = healths.drain()[0].message
            assert (health.stop_latched, health.stop_all, health.state) == (True, not by_name, "stopped")
            assert health.stamp - now < 1e-3

    run_virtually(main())


def test_stop_and_then_resume_as_an_operator_gives_them() -> None:
    """The real command against the real agents; a stopped robot stays stopped when another one is stopped as well."""

    async def main() -> None:
        async with driving(3) as fleet:
            operator = await fleet.bus(Role.OPERATOR)
            assert (await stop_robots(operator, ("r2",))).confirmed
            assert fleet.driving == {"r1", "r3"}
            assert (await stop_robots(operator, ())).confirmed
            assert (await stop_robots(operator, ("r1",))).confirmed
            await asyncio.sleep(1.0)
            assert fleet.driving == set()
            assert (await resume_robots(operator, ("r1",))).still_stopped == ()
            await fleet.until(lambda: fleet.driving == {"r1"}, 0.5, "r1 alone drives")
            assert (await resume_robots(operator, ())).still_stopped == ()
            await fleet.until(lambda: len(fleet.driving) == 3, 0.5, "all drive")

    run_virtually(main())


def test_the_receipt_says_what_the_wheels_did() -> None:
    """From 0.2 m/s at 1 m/s^2 and a lag of 0.1 s; by the wheels, which are up to a fifth off the true distance."""

    async def main() -> None:
        async with driving(3) as fleet:
            await asyncio.sleep(5.0)
            operator = await fleet.bus(Role.OPERATOR)
            before = fleet.plant.pose[:, :2].copy()
            result = await stop_robots(operator, ())
            assert result.confirmed
            await asyncio.sleep(2.0)
            gone = dict(zip(fleet.scenario.robots, np.hypot(*(fleet.plant.pose[:, :2] - before).T), strict=True))
            for name, receipt in result.robots.items():
                assert receipt.latched == pytest.approx(0.0, abs=0.01), name
                assert receipt.at_rest is not None
                assert 0.1 < receipt.at_rest < 0.7, name
                assert receipt.travelled == pytest.approx(gone[name], rel=0.25, abs=0.01), name
                assert gone[name] > 0.01

    run_virtually(main())


def test_a_stop_without_a_base_station_outlives_the_restart_of_the_agent_that_it_stopped() -> None:
    """The other agents remember it, and report it to the base station when that is back."""

    async def main() -> None:
        async with driving(2) as fleet:
            await fleet.end_station()
            operator = await fleet.bus(Role.OPERATOR)
            result = await stop_robots(operator, ("r1",))
            assert (result.reply, result.confirmed) == (None, True)
            await operator.close()
            fleet.agents["r1"].cancel()
            await asyncio.wait({fleet.agents["r1"]})
            await fleet.start_agent("r1")
            await asyncio.sleep(1.0)
            assert not fleet.healths["r1"].stop_latched  # it has forgotten it
            commands = await commands_of(fleet)
            await fleet.start_station()
            await fleet.until(lambda: fleet.driving == {"r2"}, 3, "r2 drives on")
            await asyncio.sleep(2.0)
            assert fleet.station.store.stop.names == ("r1",)
            assert {(c.message.v, c.message.omega) for c in commands.drain()} == {(0.0, 0.0)}
            assert (await resume_robots(await fleet.bus(Role.OPERATOR), ())).reply.accepted
            await fleet.until(lambda: fleet.driving == {"r1", "r2"}, 1, "both drive")
            await asyncio.sleep(2.0)
            assert fleet.driving == {"r1", "r2"}

    run_virtually(main())


def test_a_stop_is_taken_though_the_state_before_it_is_repeated_in_the_same_moment() -> None:
    """By the base station, which has not received it yet: no order may displace another one unread."""

    async def main() -> None:
        async with driving() as fleet:
            operator, station = await fleet.bus(Role.OPERATOR), await fleet.bus(Role.BASESTATION)
            orders, repetitions = operator.publisher(channels.STOP), station.publisher(channels.STOP)
            before = fleet.kept.stop
            orders.put(StopOrder(all=True, revision=before.revision))
            repetitions.put(before)
            await asyncio.sleep(0.01)
            assert fleet.healths["r1"].stop_latched
            assert fleet.driving == set()

    run_virtually(main())


def test_the_revision_of_an_order_that_only_a_robot_has_received_comes_to_the_base_station() -> None:
    """Else no resume would be newer than what the robot knows."""

    async def main() -> None:
        async with driving() as fleet:
            operator = await fleet.bus(Role.OPERATOR)
            operator.publisher(channels.STOP).put(StopOrder(all=False, names=("r1",), revision=40))
            await asyncio.sleep(0.1)
            assert fleet.kept.stop.names == ("r1",)
            assert fleet.kept.stop.revision > 40
            assert fleet.healths["r1"].stop_revision == fleet.kept.stop.revision
            assert (await resume_robots(operator, ())).still_stopped == ()
            await fleet.until(lambda: len(fleet.driving) == 1, 0.5, "it drives")

    run_virtually(main())


def test_a_hold_is_zero_at_once(own: None) -> None:
    async def main() -> None:
        async with driving(behaviour="lab_stops:on_and_off") as fleet:
            commands = await commands_of(fleet)
            await asyncio.sleep(5.0)
            held = sys.modules["lab_stops"].SEEN
            zeros = [c.message.stamp for c in commands.drain() if (c.message.v, c.message.omega) == (0.0, 0.0)]
            recent = [at for at in held if zeros[0] <= at <= zeros[-1]]
            assert len(recent) >= 3
            for at in recent:
                assert min(abs(at - zero) for zero in zeros) < 1e-6

    run_virtually(main())


def test_a_silent_behaviour_times_out_after_its_intent_and_one_repetition(own: None) -> None:
    async def main() -> None:
        async with memory_fleet(scenario(1, "hold")) as fleet:
            await fleet.until(lambda: fleet.holds("r1", "the behaviour is hold"), 2, "it holds")
            await asyncio.sleep(2.0)  # until it has heard where the others are
            commands = await commands_of(fleet)
            await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="lab_stops:once"))
            await asyncio.sleep(2.0)
            sent = [(c.message.stamp, c.message.v) for c in commands.drain()]
            driven = [at for at, v in sent if v]
            assert driven[-1] - driven[0] <= 0.25
            assert min(at for at, v in sent if not v and at > driven[0]) - driven[0] < 0.25 + 0.1 + 0.05
            assert not fleet.dead_man("r1"), "zero is commanded, and goes on being so"

    run_virtually(main())


def test_zero_is_repeated_three_times_as_often_as_the_dead_man_needs() -> None:
    """Without poses, and without output of the behaviour: zero is commanded, not left to the dead-man."""

    async def main() -> None:
        async with memory_fleet(scenario(1, "hold"), agents=False) as fleet:
            fleet.seeing = False
            commands = await commands_of(fleet)
            await fleet.start_agent("r1")
            await asyncio.sleep(1.0)
            states = (await fleet.bus()).every(channels.BASE, "r1", depth=1024)
            await asyncio.sleep(5.0)
            stamps = [c.message.stamp for c in commands.drain()]
            assert max(b - a for a, b in itertools.pairwise(stamps)) < 0.2
            assert not any(state.message.dead_man for state in states.drain())

    run_virtually(main())


def test_a_foreign_programs_estimates_do_not_reach_a_behaviour(own: None) -> None:
    async def main() -> None:
        async with driving(behaviour="lab_stops:away") as fleet:
            stranger = await fleet.bus(Role.AGENT)
            estimates = stranger.publisher(channels.ESTIMATE, "r1")
            seen: list[Estimate] = sys.modules["lab_stops"].SEEN
            seen.clear()
            commands = await commands_of(fleet)
            for _ in range(100):
                estimates.put(Estimate(x=9.0, y=9.0, theta=0.0, v=0.0, omega=0.0, covariance=(1e-6,) * 9))
                await asyncio.sleep(0.01)
            assert len(seen) >= 19
            assert {estimate.epoch for estimate in seen}.isdisjoint({stranger.epoch})
            # It would back off from (9, 9); to the base station the two estimates disagree, so it may stand meanwhile.
            assert min(c.message.v for c in commands.drain()) >= 0.0

    run_virtually(main())


def test_a_robot_whose_poses_end_is_commanded_zero_0_25_s_after_the_last_capture() -> None:
    async def main() -> None:
        async with driving() as fleet:
            fixes = (await fleet.bus()).every(channels.POSE, "r1", depth=1024)
            commands = await commands_of(fleet)
            fleet.seeing = False
            await asyncio.sleep(1.0)
            captured = max(f.message.stamp - f.message.age for f in fixes.drain())
            driven = [c.message.stamp - captured for c in commands.drain() if c.message.v]
            assert 0.25 - 0.075 - 0.01 < driven[-1] <= 0.25

    run_virtually(main())
