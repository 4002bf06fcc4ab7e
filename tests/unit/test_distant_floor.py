"""The floor as a camera in a process of its own sees it."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from agents.distant_floor import DistantFloor
from muro_zenoh import channels
from muro_zenoh.messages import Truth
from muro_zenoh.runtime.virtual_time import VirtualClock, run_virtually
from muro_zenoh.transport import MemoryNetwork, make_bus


def test_robots_are_where_their_truth_has_taken_them_until_the_simulator_falls_silent() -> None:
    async def main() -> None:
        network, clock = MemoryNetwork(), VirtualClock()
        async with make_bus(network.link(), clock=clock) as simulator, make_bus(network.link(), clock=clock) as bus:
            floor = DistantFloor(bus, ("r1", "r2"))
            assert floor.look() is None
            truth = {name: simulator.publisher(channels.TRUTH, name) for name in ("r1", "r2")}
            truth["r1"].put(Truth(x=1.0, y=0.5, theta=0.0, v=0.4, omega=0.0))
            await asyncio.sleep(0.01)
            assert floor.look() is None, "r2 has not been heard of"
            truth["r2"].put(Truth(x=-1.0, y=0.0, theta=np.pi / 2, v=0.0, omega=1.0))
            await asyncio.sleep(0.04)
            seen = floor.look()
            assert seen is not None
            assert (seen.stamp, seen.behind) == (clock.now(), 0.0)
            assert seen.poses[0] == pytest.approx([1.0 + 0.4 * 0.05, 0.5, 0.0], abs=1e-6)
            assert seen.poses[1] == pytest.approx([-1.0, 0.0, np.pi / 2 + 0.04], abs=1e-6)
            await asyncio.sleep(0.2)
            assert floor.look() is None, "a silent simulator shows nothing"

    run_virtually(main())
