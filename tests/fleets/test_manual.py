"""Driving by hand, in virtual time: the robot follows the stick, and stands still as soon as the hand is gone."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from basestation.dashboard.hands import Hands
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.errors import OrderRefused
from muro_zenoh.messages import DriveWish, SetBehaviour
from muro_zenoh.orders.behaviour import set_behaviour
from muro_zenoh.orders.lease import holding
from muro_zenoh.orders.stop import stop_robots
from muro_zenoh.runtime.virtual_time import run_virtually
from tests.support.memory_fleet import MemoryFleet, memory_fleet, scenario

AT_MOST = 0.3
"""The time within which the wheels are commanded to zero once the hand is gone [s]."""


@asynccontextmanager
async def by_hand(robots: int = 1) -> AsyncIterator[tuple[MemoryFleet, Hands]]:
    async with memory_fleet(scenario(robots, "manual")) as fleet:
        await fleet.until(lambda: fleet.holds("r1", "nobody has driven it yet"), 5.0, "r1 waits for a hand")
        yield fleet, Hands(fleet.open_bus(Role.OPERATOR))


async def drive(hands: Hands, lasts: float, v: float = 0.2, omega: float = 0.4, client: int = 1) -> None:
    """Hold a stick, as a page does: ten messages a second."""
    for _ in range(round(lasts / 0.1)):
        hands.drive(client, "r1", v, omega)
        await asyncio.sleep(0.1)


async def zero_after(fleet: MemoryFleet) -> float:
    """How long it takes until the wheels are commanded to stand still [s]."""
    return await fleet.until(lambda: fleet.commanded("r1") == (0.0, 0.0), 2.0, "zero wheels")


def test_a_robot_follows_the_stick() -> None:
    async def main() -> None:
        async with by_hand() as (fleet, hands):
            await drive(hands, 1.5)
            assert fleet.speed("r1") == pytest.approx(0.2, abs=0.04)
            await drive(hands, 1.5, v=-0.1)
            assert fleet.speed("r1") == pytest.approx(-0.1, abs=0.04)
            await drive(hands, 1.5, v=9.0, omega=0.0)
            assert fleet.speed("r1") <= 0.35  # no faster than its parameters allow

    run_virtually(main())


@pytest.mark.parametrize("after", [0.0, 0.013, 0.031, 0.047])
def test_a_hand_that_says_nothing_more_is_gone(after: float) -> None:
    async def main() -> None:
        async with by_hand() as (fleet, hands):
            await drive(hands, 1.0)
            await asyncio.sleep(after)
            hands.drive(1, "r1", 0.2, 0.4)
            assert await zero_after(fleet) <= AT_MOST
            await fleet.until(lambda: fleet.holds("r1", "nobody has driven it for"), 2.0, "it says why")

    run_virtually(main())


@pytest.mark.parametrize("how", ["lets go", "leaves", "is released"])
def test_a_hand_that_lets_go_is_obeyed_at_the_next_fix(how: str) -> None:
    async def main() -> None:
        async with by_hand() as (fleet, hands):
            await drive(hands, 1.0)
            if how == "lets go":
                hands.drive(1, "r1", 0.0, 0.0)
            elif how == "leaves":
                hands.leave(1)
            else:
                hands.release(())
            assert await zero_after(fleet) <= 0.1
            await asyncio.sleep(1.0)
            assert fleet.commanded("r1") == (0.0, 0.0)

    run_virtually(main())


@pytest.mark.parametrize("after", [0.0, 0.017, 0.033])
def test_a_page_that_dies_without_a_word_drives_nobody(after: float) -> None:
    async def main() -> None:
        async with by_hand() as (fleet, _), fleet.open_bus(Role.OPERATOR) as other:
            wishes = other.publisher(channels.DRIVE, "r1")
            for _ in range(20):
                wishes.put(DriveWish(v=0.2, omega=0.0))
                await asyncio.sleep(0.05)
            await asyncio.sleep(after)
            wishes.put(DriveWish(v=0.2, omega=0.0))
            assert fleet.commanded("r1") != (0.0, 0.0)
            assert await zero_after(fleet) <= AT_MOST

    run_virtually(main())


def test_a_stop_wins() -> None:
    async def main() -> None:
        async with by_hand() as (fleet, hands):
            holding_it = asyncio.create_task(drive(hands, 5.0))
            await asyncio.sleep(1.0)
            stop = asyncio.create_task(stop_robots(fleet.open_bus(Role.OPERATOR), ()))
            await asyncio.sleep(0.1)
            assert fleet.commanded("r1") == (0.0, 0.0)
            assert (await stop).confirmed
            await asyncio.sleep(1.0)
            assert fleet.commanded("r1") == (0.0, 0.0)
            await holding_it

    run_virtually(main())


def test_a_wall_is_not_driven_into() -> None:
    async def main() -> None:
        async with by_hand() as (fleet, hands):
            arena, radius = fleet.scenario.arena, fleet.scenario.robot["r1"].radius
            for _ in range(200):
                hands.drive(1, "r1", 0.3, 0.0)
                await asyncio.sleep(0.1)
                x, y, _ = fleet.plant.pose[0].tolist()
                assert arena.x_min + radius < x < arena.x_max - radius
                assert arena.y_min + radius < y < arena.y_max - radius
            assert fleet.healths["r1"].numbers.get("separated_keeps_clear_of_the_wall", 0) > 0

    run_virtually(main())


def test_one_client_drives_a_robot_and_whoever_holds_it_decides() -> None:
    async def main() -> None:
        async with by_hand() as (fleet, hands), fleet.open_bus(Role.OPERATOR) as other:
            await drive(hands, 0.5)
            with pytest.raises(OrderRefused, match="r1 is driven from another page"):
                hands.drive(2, "r1", 0.0, 0.5)
            await asyncio.sleep(0.5)
            await drive(hands, 0.5, client=2)
            other.operator = "bob@laptop"
            async with holding(other, "his program", ("r1",), lost=lambda reason: None, patience=1.0):
                await asyncio.sleep(1.0)
                refused = asyncio.create_task(drive(hands, 2.0))
                said = "a drive is not followed: held by his program"
                await fleet.until(
                    lambda: any(said in text for text in fleet.healths["r1"].complaints), 2.0, "the robot says so"
                )
                assert fleet.commanded("r1") == (0.0, 0.0)
                await refused

    run_virtually(main())


@pytest.mark.parametrize(("v", "omega"), [(float("nan"), 0.0), (0.0, float("inf")), (1e300, 0.0)])
def test_what_is_no_number_is_no_wish(v: float, omega: float) -> None:
    async def main() -> None:
        async with by_hand() as (fleet, hands):
            with pytest.raises(ValueError, match="expected a finite number"):
                hands.drive(1, "r1", v, omega)
            await asyncio.sleep(0.5)
            assert fleet.commanded("r1") == (0.0, 0.0)

    run_virtually(main())


def test_other_behaviours_do_not_listen_to_a_stick() -> None:
    async def main() -> None:
        async with memory_fleet(scenario(1, "hold")) as fleet:
            await fleet.until(lambda: fleet.holds("r1", "the behaviour is hold"), 5.0, "it holds")
            await drive(Hands(fleet.open_bus(Role.OPERATOR)), 1.0)
            assert fleet.commanded("r1") == (0.0, 0.0)

    run_virtually(main())


@pytest.mark.parametrize(("robots", "names"), [(3, ()), (3, ("r2",))])
def test_a_change_of_behaviour_is_answered_as_soon_as_the_robots_obey(robots: int, names: tuple[str, ...]) -> None:
    async def main() -> None:
        async with memory_fleet(scenario(robots, "manual")) as fleet, fleet.open_bus(Role.OPERATOR) as bus:
            await fleet.until(lambda: all(fleet.holds(f"r{k + 1}", "nobody") for k in range(robots)), 5.0, "they wait")
            begin = asyncio.get_running_loop().time()
            result = await set_behaviour(bus, SetBehaviour(behaviour="circle", names=names))
            assert result.reply.accepted
            assert not result.refusals
            assert asyncio.get_running_loop().time() - begin < 0.5

    run_virtually(main())
