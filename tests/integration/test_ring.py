"""Three real agents on one circle, one of which is killed."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.fleet import real_fleet

pytestmark = pytest.mark.slow


async def test_the_ring_spreads_anew_when_an_agent_is_killed_and_again_when_it_is_back(tmp_path: Path) -> None:
    async with real_fleet(tmp_path) as fleet:
        await fleet.ring()
        clock = fleet.bus.clock
        began = clock.now()

        # cal0 and calD undo the simulator's hidden drive errors.
        await fleet.until(lambda: clock.now() - began > 8.0, 12, "ten seconds of circling")
        hidden = fleet.health["simulator"].numbers
        for name in fleet.robots:
            cal_v, cal_omega = fleet.cal_v.values()[name].message, fleet.cal_omega.values()[name].message
            assert cal_v.value * hidden[f"scale_v_{name}"] == pytest.approx(1.0, abs=0.05), name
            assert cal_omega.value * hidden[f"scale_omega_{name}"] == pytest.approx(1.0, abs=0.05), name

        fleet.kill("r2")
        await fleet.until(lambda: fleet.standing("r2"), 3, "r2 stands")
        await fleet.ring(("r1", "r3"))
        assert fleet.standing("r2")

        fleet.start("r2")
        await fleet.until(lambda: fleet.driving("r2"), 5, "r2 drives again")
        await fleet.ring()
