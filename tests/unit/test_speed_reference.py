"""What path following makes of the speeds that others say."""

from __future__ import annotations

import asyncio

from muro_zenoh import channels
from muro_zenoh.messages import SpeedReference
from muro_zenoh.runtime.virtual_time import run_virtually
from tests.support.memory_fleet import memory_fleet, scenario


def test_a_negative_speed_is_taken_as_zero() -> None:
    """Backwards the law of the circle leads away from it, and out of the arena."""

    async def main() -> None:
        async with memory_fleet(scenario(1, "circle")) as fleet:
            velocity = (await fleet.bus()).publisher(channels.VELOCITY, "r1")
            await fleet.until(lambda: fleet.commanded("r1")[0] > 0.1, 3, "it drives")
            for i in range(30):
                velocity.put(SpeedReference(speed=-0.3))
                await asyncio.sleep(0.1)
                assert fleet.commanded("r1")[0] >= 0.0
                assert fleet.commanded("r1")[0] == 0.0 or i < 3
            assert abs(fleet.speed("r1")) < 0.01

    run_virtually(main())
