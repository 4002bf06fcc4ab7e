"""What the base station says of the robots' bases, as soon as they say it; strangers and bases that are gone leave
nothing behind."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import msgspec

from basestation.tasks.bases import BasesTask
from muro_zenoh import channels
from muro_zenoh.messages import BaseState
from muro_zenoh.transport import MemoryNetwork, make_bus
from tests.support.clock import ManualClock

CONTESTED = BaseState(
    battery=1.0, charging=False, bumper=False, cliff=False, wheel_drop=False, dead_man=False, contested=True
)
UNRULY = msgspec.structs.replace(CONTESTED, contested=False, unruly=True)


async def told(
    check: Callable[[BasesTask, ManualClock], Awaitable[None]], *names: str, state: BaseState = CONTESTED
) -> None:
    """Have the bases with these names say this, by default that they are contested."""
    network, clock = MemoryNetwork(), ManualClock()
    async with make_bus(network.link(), clock=clock) as ours, make_bus(network.link(), clock=clock) as theirs:
        bases = BasesTask(ours, ("r1", "r2"), changed := asyncio.Event())
        running = asyncio.create_task(bases.run())
        await asyncio.sleep(0)
        for name in names:
            theirs.publisher(channels.BASE, name).put(state)
        async with asyncio.timeout(5.0):
            await changed.wait()
        await check(bases, clock)
        running.cancel()


def test_strangers_are_not_reported() -> None:
    async def check(bases: BasesTask, clock: ManualClock) -> None:
        assert bases.reasons() == ["two processes command the wheels of r1"]

    asyncio.run(told(check, *(f"x{number}" for number in range(100)), "r1"))


def test_wheels_that_do_otherwise_are_reported() -> None:
    async def check(bases: BasesTask, clock: ManualClock) -> None:
        (reason,) = bases.reasons()
        assert reason.startswith("the wheels of r1 do not do what they are commanded")

    asyncio.run(told(check, "r1", state=UNRULY))


def test_a_base_that_is_gone_complains_no_longer() -> None:
    async def check(bases: BasesTask, clock: ManualClock) -> None:
        clock.advance(channels.BASE.stale_after - 0.1)
        assert bases.reasons() == ["two processes command the wheels of r1"]
        clock.advance(0.2)
        assert bases.reasons() == []

    asyncio.run(told(check, "r1"))
