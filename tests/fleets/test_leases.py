"""Two programs at one fleet: real agents and the real base station in virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.messages import Goal, SetBehaviour, SetCircle, SpeedReference
from muro_zenoh.orders.lease import holding
from muro_zenoh.orders.stop import resume_robots, stop_robots
from muro_zenoh.runtime.virtual_time import run_virtually
from muro_zenoh.transport import Bus
from tests.support.memory_fleet import MemoryFleet, memory_fleet, scenario

HELD = "held by muro run of alice@lab since"


@asynccontextmanager
async def two_operators(behaviour: str = "circle") -> AsyncIterator[tuple[MemoryFleet, Bus, Bus]]:
    async with memory_fleet(scenario(2, behaviour)) as fleet:
        alice, bob = await fleet.bus(Role.OPERATOR), await fleet.bus(Role.OPERATOR)
        alice.operator, bob.operator = "alice@lab", "bob@lab"
        await asyncio.sleep(2.0)
        yield fleet, alice, bob


def lost(reason: str) -> None:
    raise AssertionError(reason)


def test_whoever_does_not_hold_the_robots_is_refused_and_told_who_does() -> None:
    async def main() -> None:
        async with two_operators("dubins") as (_, alice, bob):
            async with holding(alice, "muro run", ("r1", "r2"), lost=lost):
                await asyncio.sleep(10.0)
                hold = SetBehaviour(behaviour="hold", names=("r1",))
                for refused in (
                    await bob.ask(channels.SET_BEHAVIOUR, hold),
                    await bob.ask(channels.SET_CIRCLE, SetCircle(radius=0.7)),
                    await bob.ask(channels.GOAL_ORDER, Goal(x=0.3, y=0.2), name="r1"),
                ):
                    assert not refused.accepted
                    assert refused.reason.startswith(HELD)
                    assert refused.reason.endswith("(r1 r2)")
                assert (await alice.ask(channels.GOAL_ORDER, Goal(x=0.3, y=0.2), name="r1")).accepted
                assert (await alice.ask(channels.SET_CIRCLE, SetCircle(radius=0.7))).accepted
                assert (
                    await bob.ask(channels.GOAL_ORDER, Goal(x=0.3, y=0.2, operator="alice@lab"), name="r1")
                ).accepted
                # A stop and a resume need none.
                assert (await stop_robots(bob, ())).confirmed
                assert (await resume_robots(bob, ())).still_stopped == ()
            await asyncio.sleep(0.6)
            assert (await bob.ask(channels.GOAL_ORDER, Goal(x=0.3, y=0.2), name="r1")).accepted
            assert (await bob.ask(channels.SET_BEHAVIOUR, hold)).accepted

    run_virtually(main())


def test_robots_are_held_when_the_base_station_comes_where_nobody_waits_for_it() -> None:
    async def main() -> None:
        async with two_operators() as (fleet, alice, bob):
            await fleet.end_station()
            async with holding(alice, "muro run", ("r1",), lost=lost, patience=None):
                await asyncio.sleep(2.0)
                await fleet.start_station()
                await asyncio.sleep(1.5)
                hold = SetBehaviour(behaviour="hold", names=("r1",))
                assert (await bob.ask(channels.SET_BEHAVIOUR, hold)).reason.startswith(HELD)

    run_virtually(main())


def test_a_crashed_holders_lease_ends_after_3_s() -> None:
    async def main() -> None:
        async with two_operators() as (_, alice, bob):
            held = holding(alice, "muro run", (), lost=lost)
            await held.__aenter__()
            renewing = next(task for task in asyncio.all_tasks() if task.get_name() == "renew the lease")
            renewing.cancel()  # it crashes: no renewal, no release
            hold = SetBehaviour(behaviour="hold")
            await asyncio.sleep(2.9)
            assert (await bob.ask(channels.SET_BEHAVIOUR, hold)).reason.startswith(HELD)
            await asyncio.sleep(0.2)
            assert (await bob.ask(channels.SET_BEHAVIOUR, hold)).accepted
            async with holding(bob, "muro run", ("r1",), lost=lost):
                pass

    run_virtually(main())


def test_a_lease_that_is_renewed_outlives_the_base_station() -> None:
    async def main() -> None:
        async with two_operators() as (fleet, alice, bob), holding(alice, "muro run", ("r1", "r2"), lost=lost):
            await fleet.end_station()
            await asyncio.sleep(0.5)
            goal = await bob.ask(channels.GOAL_ORDER, Goal(x=0.3, y=0.2), name="r1")
            assert goal.reason.startswith(HELD)
            await fleet.start_station()
            await asyncio.sleep(2.0)
            assert (await bob.ask(channels.SET_CIRCLE, SetCircle(radius=0.7))).reason.startswith(HELD)

    run_virtually(main())


def test_two_programs_do_not_drive_one_robot_in_turns() -> None:
    """The first is followed, without a lease; then the one that takes one; then nobody's."""

    async def speak(bus: Bus, speed: float) -> None:
        velocity = bus.publisher(channels.VELOCITY, "r1")
        while True:
            velocity.put(SpeedReference(speed=speed))
            await asyncio.sleep(0.05)

    async def main() -> None:
        async with two_operators() as (fleet, alice, bob):
            tasks = [asyncio.create_task(speak(bob, 0.1))]
            await asyncio.sleep(3.0)
            tasks.append(asyncio.create_task(speak(alice, 0.2)))
            for _ in range(30):
                await asyncio.sleep(0.1)
                assert abs(fleet.speed("r1") - 0.1) < 0.02
            assert fleet.healths["r1"].complaints == ("a velocity is not followed: another program's came first",)
            async with holding(alice, "muro run", ("r1",), lost=lost):
                await asyncio.sleep(2.0)
                for _ in range(30):
                    await asyncio.sleep(0.1)
                    assert abs(fleet.speed("r1") - 0.2) < 0.02
                assert any(HELD in complaint for complaint in fleet.healths["r1"].complaints)
                tasks[1].cancel()
                await asyncio.sleep(2.0)
                assert fleet.holds("r1", "no velocity for")
                assert abs(fleet.speed("r1")) < 1e-3
            await asyncio.sleep(2.0)
            assert abs(fleet.speed("r1") - 0.1) < 0.02
            for task in tasks:
                task.cancel()

    run_virtually(main())
