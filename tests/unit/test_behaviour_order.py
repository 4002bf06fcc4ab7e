"""A change of behaviour as an operator gives it: what the base station refuses, and what the robots refuse."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from muro_zenoh.channels import Role
from muro_zenoh.messages import SetBehaviour, Value
from muro_zenoh.orders.behaviour import BehaviourResult, set_behaviour
from muro_zenoh.runtime.virtual_time import run_virtually
from tests.support.memory_fleet import MemoryFleet, memory_fleet, scenario

FLAKY = """
STARTS = []

async def flaky(robot):
    STARTS.append(robot.now)
    if len(STARTS) <= 2:
        raise ValueError("bad gain")
    async for _ in robot.estimates():
        robot.drive(0.1, 0.0)
"""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Makes a user's module ``lab_orders`` of a text."""

    def put(text: str) -> None:
        (tmp_path / "lab_orders.py").write_text(text)

    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "lab_orders", raising=False)
    return put


async def order(fleet: MemoryFleet, behaviour: str, **parameters: Value) -> BehaviourResult:
    """An order by an operator who connects for it, as the command line does."""
    bus = await fleet.bus(Role.OPERATOR)
    try:
        return await set_behaviour(bus, SetBehaviour(behaviour=behaviour, parameters=parameters))
    finally:
        await bus.close()


def test_the_failure_of_an_earlier_order_is_not_reported_again(own: Callable[[str], None]) -> None:
    own(FLAKY)

    async def main() -> None:
        async with memory_fleet(scenario(2, "hold")) as fleet:
            await asyncio.sleep(2.0)
            first = await order(fleet, "lab_orders:flaky")
            assert first.reply.accepted
            assert {name: "bad gain" in why for name, why in first.refusals.items()} == {"r1": True, "r2": True}
            second = await order(fleet, "lab_orders:flaky")
            assert second.reply.accepted
            assert second.refusals == {}
            assert fleet.driving == {"r1", "r2"}
            # Again, while it runs: it is obeyed already.
            third = await order(fleet, "lab_orders:flaky")
            assert third.refusals == {}
            assert {health.behaviour_revision for health in fleet.healths.values()} == {third.reply.revision}

    run_virtually(main())


@pytest.mark.parametrize(
    ("behaviour", "parameters", "reason"),
    [
        ("dubins", {"v_min": 0.6, "v_max": 0.8}, "v_min: got 0.6"),
        ("coverage", {"v_min": 0.6, "v_max": 0.8}, "v_min: got 0.6"),
        ("pursuit", {"pursuit": "importance"}, "weights: got 0 for 0 angles"),
        ("pursuit", {"pursuit": "importance", "angles": (0.0, 1.0), "weights": (1.0, 100.0)}, "importance: got a"),
    ],
)
def test_the_base_station_refuses_what_no_robot_can_run(
    behaviour: str, parameters: dict[str, Value], reason: str
) -> None:
    async def main() -> None:
        async with memory_fleet(scenario(1, "circle")) as fleet:
            await fleet.until(lambda: bool(fleet.driving), 5, "it drives")
            result = await order(fleet, behaviour, **parameters)
            assert not result.reply.accepted
            assert result.reply.reason.startswith(f"behaviour.{reason}")
            assert fleet.driving == {"r1"}  # it goes on as before
            assert not fleet.healths["r1"].failure

    run_virtually(main())


def test_the_robots_refusals_of_a_built_in_behaviour_are_reported(own: Callable[[str], None]) -> None:
    """The base station loads no code of the user's; only the robots find out that a function is missing."""
    own("")

    async def main() -> None:
        async with memory_fleet(scenario(2, "circle")) as fleet:
            await asyncio.sleep(1.0)
            result = await order(fleet, "pursuit", pursuit="importance", importance="lab_orders:none")
            assert result.reply.accepted
            assert set(result.refusals) == {"r1", "r2"}
            assert all("module lab_orders has no function 'none'" in why for why in result.refusals.values())
            assert fleet.driving == set()

    run_virtually(main())
