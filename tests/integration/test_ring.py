"""Three real agents on one circle, one of which is killed."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.fleet import real_fleet

pytestmark = pytest.mark.slow


async def test_the_ring_spreads_again_when_an_agent_is_killed_and_when_it_is_back(tmp_path: Path) -> None:
    async with real_fleet(tmp_path) as fleet:
        await fleet.ring()
        began = fleet.bus.clock.now()

        def calibrated() -> bool:
            """Whether cal0 and calD correct the simulator's hidden drive errors within 5 %."""
            factors = []
            for name in fleet.robots:
                cal_v, cal_omega = fleet.cal_v.values().get(name), fleet.cal_omega.values().get(name)
                if cal_v is None or cal_omega is None:
                    return False
                factors.append(cal_v.message.value * fleet.number("simulator", f"scale_v_{name}"))
                factors.append(cal_omega.message.value * fleet.number("simulator", f"scale_omega_{name}"))
            return max(abs(factor - 1.0) for factor in factors) < 0.05

        await fleet.until(lambda: fleet.bus.clock.now() - began > 8.0, 12, "ten seconds of circling")
        await fleet.until(calibrated, 10, "calibrations within 5 %")

        fleet.kill("r2")
        await fleet.until(lambda: fleet.stationary("r2"), 3, "r2 is stationary")
        await fleet.ring(("r1", "r3"))
        assert fleet.stationary("r2")
        assert fleet.spacing_error() > 0.5  # it is no ring of three

        fleet.start("r2")
        await fleet.until(lambda: fleet.driving("r2"), 5, "r2 drives again")
        await fleet.ring()
