"""The task that runs the pose filter: when a fix was captured."""

from __future__ import annotations

import asyncio

import pytest
from agents.tasks.localize import Localize

from muro_zenoh import channels
from muro_zenoh.config import RobotSettings
from muro_zenoh.messages import PoseFix
from muro_zenoh.runtime.virtual_time import VirtualClock, run_virtually
from muro_zenoh.transport import MemoryNetwork, make_bus

_COVARIANCE = (1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 2.5e-5)


def test_a_fix_was_captured_its_age_before_it_was_sent() -> None:
    """The base station knows its cameras and what each frame took; the agent knows neither."""
    ages = {"north": 0.05, "south": 0.12}
    ahead = 7.0  # the base station's clock

    async def main() -> None:
        network = MemoryNetwork()
        clock = VirtualClock()
        async with make_bus(network.link(), clock=clock) as station, make_bus(network.link(), clock=clock) as bus:
            localize = Localize(bus, "r1", RobotSettings(tag=1))
            running = asyncio.create_task(localize.run())
            poses = station.publisher(channels.POSE, "r1")
            measured = {}
            for _ in range(20):
                for camera, age in ages.items():
                    fix = PoseFix(
                        stamp=clock.now() + ahead,
                        age=age,
                        x=0.3,
                        y=0.1,
                        theta=0.2,
                        covariance=_COVARIANCE,
                        camera=camera,
                    )
                    poses.put(fix)
                    await asyncio.sleep(0.001)
                    measured[camera] = localize.pose_ages[-1]
                    await asyncio.sleep(0.03)
            assert localize.fixes == 39  # the south's first was taken before the north's, with which the filter began
            assert measured == pytest.approx(ages, abs=0.002)
            running.cancel()
            await asyncio.wait({running})

    run_virtually(main())
