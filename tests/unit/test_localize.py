"""The task that runs the pose filter: whose clock a fix was stamped by."""

from __future__ import annotations

import asyncio

import pytest
from agents.tasks.localize import Localize

from muro_zenoh import channels
from muro_zenoh.config import RobotSettings
from muro_zenoh.messages import PoseFix
from muro_zenoh.transport import MemoryNetwork, make_bus
from tests.support.virtual_time import VirtualClock, run_virtually

_COVARIANCE = (1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 2.5e-5)


def test_two_cameras_with_clocks_and_latencies_of_their_own_are_both_fresh() -> None:
    """Their fixes come from one base station, so from one writer."""
    clocks = {"north": 0.0, "south": -7.0}  # the south camera's computer is seven seconds behind
    latencies = {"north": 0.05, "south": 0.12}

    async def main() -> None:
        network = MemoryNetwork()
        clock = VirtualClock()
        async with make_bus(network.link(), clock=clock) as station, make_bus(network.link(), clock=clock) as bus:
            localize = Localize(bus, "r1", RobotSettings(tag=1), latencies)
            running = asyncio.create_task(localize.run())
            poses = station.publisher(channels.POSE, "r1")
            ages = {}
            for _ in range(20):
                for camera in ("north", "south"):
                    stamp = clock.now() - latencies[camera] + clocks[camera]
                    poses.put(PoseFix(stamp=stamp, x=0.3, y=0.1, theta=0.2, covariance=_COVARIANCE, camera=camera))
                    await asyncio.sleep(0.001)
                    ages[camera] = localize.pose_ages[-1]
                    await asyncio.sleep(0.03)
            assert localize.fixes == 39  # the south's first was taken before the north's, with which the filter began
            assert ages == pytest.approx(latencies, abs=0.002)
            running.cancel()
            await asyncio.wait({running})

    run_virtually(main())
