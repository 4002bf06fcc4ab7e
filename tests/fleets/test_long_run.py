"""Seven minutes of a running fleet, in virtual time: nothing wears off, and nothing piles up."""

from __future__ import annotations

import asyncio
import gc
import sys

import pytest

from muro_zenoh.channels import Role
from muro_zenoh.orders.stop import resume_robots, stop_robots
from muro_zenoh.runtime.virtual_time import run_virtually
from tests.support.memory_fleet import MemoryFleet, memory_fleet, scenario

ROBOTS = 3
MINUTE = 60.0
LOST = ("_rejected", "_dropped", "_replaced", "_late", "_unsent")


def lost(fleet: MemoryFleet) -> float:
    """How many messages the agents have lost in any way."""
    return sum(n for health in fleet.healths.values() for what, n in health.numbers.items() if what.endswith(LOST))


async def assert_all_is_well(fleet: MemoryFleet) -> None:
    for _ in range(10):
        await asyncio.sleep(0.5)
        assert len(fleet.driving) == ROBOTS, fleet.healths
        assert fleet.spacing_error() < 0.1
        assert max(map(fleet.radius_error, fleet.scenario.robots)) < 0.03


@pytest.mark.slow
def test_after_seven_minutes_a_fleet_drives_and_obeys_as_at_first() -> None:
    async def main() -> None:
        async with memory_fleet(scenario(ROBOTS, "pursuit")) as fleet:
            operator = await fleet.bus(Role.OPERATOR)
            await asyncio.sleep(MINUTE)
            await assert_all_is_well(fleet)
            gc.collect()
            blocks, before = sys.getallocatedblocks(), lost(fleet)
            for _ in range(3):
                await asyncio.sleep(2 * MINUTE)
                await assert_all_is_well(fleet)
            assert lost(fleet) == before
            gc.collect()
            assert sys.getallocatedblocks() - blocks < 5000  # 22,000 fixes and 27,000 odometry messages later

            assert (await stop_robots(operator, ())).confirmed
            assert not fleet.driving
            assert (await resume_robots(operator, ())).still_stopped == ()
            await fleet.until(lambda: len(fleet.driving) == ROBOTS, 0.5, "all drive again")

    run_virtually(main())
