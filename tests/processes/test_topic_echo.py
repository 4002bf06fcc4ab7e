"""``muro topic echo`` over real Zenoh: what was written once, before anybody looked, is shown."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from collections.abc import AsyncIterator

import pytest
import pytest_asyncio

from muro_zenoh import channels
from muro_zenoh.channels import ALL_ROLES, Channel
from muro_zenoh.messages import (
    Behaviour,
    Calibration,
    Circle,
    FaultList,
    Health,
    Lease,
    LeaseState,
    Message,
    PlannedPath,
    StopOrder,
)
from muro_zenoh.transport import Bus, open_bus
from tests.support.router import Router, router
from tests.support.waiting import seconds

KEPT: dict[str, Message] = {
    "stop": StopOrder(all=True, names=("r2",), revision=3),
    "lease": LeaseState(leases=(Lease(program="a", operator="b", epoch=1, since=2.0, left=3.0),)),
    "circle": Circle(x=0.1, y=0.2, radius=0.7),
    "behaviour/r1": Behaviour(behaviour="circle", parameters={"speed": 0.1}),
    "health/r1": Health(role="agent", state="stopped"),
    "cal0/r1": Calibration(value=1.1, sigma=0.01),
    "calD/r1": Calibration(value=0.9, sigma=0.02),
    "faults": FaultList(rows="", lasting=("freeze r1/agent",)),
    "path/r1": PlannedPath(x=0.0, y=0.0, theta=0.0, segments=((1.0, 0.0),)),
}
"""Every kept channel. Most are repeated once a second or oftener; a path never is."""


def channel_of(key: str) -> Channel[Message]:
    (found,) = [channel for channel in channels.CHANNELS if channel.word == key.partition("/")[0]]
    return found


@pytest_asyncio.fixture
async def fleet() -> AsyncIterator[tuple[Router, Bus]]:
    """A router, and a process that has written each kept channel once."""
    with router() as running:
        async with open_bus(running.settings(), *ALL_ROLES) as bus:
            for key, message in KEPT.items():
                bus.publisher(channel_of(key), key.partition("/")[2]).put(message)
            yield running, bus


def echo(running: Router, *arguments: str) -> dict[str, dict[str, object]]:
    """What the command prints, by key."""
    done = subprocess.run(
        [sys.executable, "-P", "-m", "muro_zenoh", "topic", "echo", *arguments, "--connect", running.endpoint],
        capture_output=True,
        text=True,
        timeout=seconds(30),
        check=True,
    )
    lines = [line.partition(" ") for line in done.stdout.splitlines()]
    assert len({key for key, _, _ in lines}) == len(lines), "each is shown once"
    return {key: json.loads(text) for key, _, text in lines}


def test_the_channels_are_all_that_are_kept() -> None:
    assert {channel_of(key) for key in KEPT} == {c for c in channels.CHANNELS if c.delivery == "kept"}


@pytest.mark.parametrize("key", ["path/r1", "stop", "cal0/*", "health/*"])
async def test_a_kept_value_is_shown_at_once(fleet: tuple[Router, Bus], key: str) -> None:
    shown = await asyncio.to_thread(echo, fleet[0], key, "--count", "1", "--for", str(seconds(10)))
    (found,) = shown
    (expected,) = [name for name in KEPT if name.partition("/")[0] == key.partition("/")[0]]
    assert found == f"muro/{expected}"


async def test_all_of_them_are_shown_under_a_wildcard(fleet: tuple[Router, Bus]) -> None:
    count = str(len(KEPT))
    shown = await asyncio.to_thread(echo, fleet[0], "**", "--count", count, "--for", str(seconds(10)))
    assert set(shown) == {f"muro/{key}" for key in KEPT}
    assert shown["muro/stop"]["names"] == ["r2"]
    assert shown["muro/path/r1"]["segments"] == [[1.0, 0.0]]


async def test_what_is_written_after_the_start_follows(fleet: tuple[Router, Bus]) -> None:
    running, bus = fleet
    path = bus.publisher(channels.PATH, "r2")
    looking = asyncio.create_task(asyncio.to_thread(echo, running, "path/*", "--count", "2", "--for", str(seconds(10))))
    while not looking.done():
        path.put(PlannedPath(x=1.0, y=0.0, theta=0.0, segments=()))
        await asyncio.sleep(0.1)
    assert set(await looking) == {"muro/path/r1", "muro/path/r2"}
