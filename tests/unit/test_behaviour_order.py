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
