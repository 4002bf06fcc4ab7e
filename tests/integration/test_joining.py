"""``muro run --connect``: one master at a fleet of real processes."""

from __future__ import annotations

import asyncio
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.support.fleet import RealFleet, real_fleet
from tests.support.process import Process, muro
from tests.support.waiting import seconds

RUN = ["-m", "muro_zenoh", "run", "hold", "--robots", "2", "--headless"]
HELD = r"held by muro run of alice since \d\d:\d\d \(r1 r2\)"


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def muro_of(operator: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return muro(*arguments, env={"MURO_OPERATOR": operator})


async def test_a_run_joins_a_fleet_and_a_second_one_is_refused_until_the_first_is_gone(tmp_path: Path) -> None:
    async with real_fleet(tmp_path, robots=2, behaviour={"name": "hold"}) as fleet:
        there = ["--connect", fleet.endpoint]
        circling = ["--set", "behaviour.name=circle", "--set", "circle.radius=0.7"]
        first = Process([*RUN, *there, *circling, "--duration", "600"], name="muro run", env={"MURO_OPERATOR": "alice"})
        with first:
            first.line("running already: basestation r1 r2 simulator")
            first.line("all processes ready")
            await fleet.until(fleet.driving, 10, "the scenario's behaviour was ordered")
            assert fleet.circle is not None
            assert fleet.circle.radius == 0.7
            await _others_are_refused(fleet, there)
            first.send(signal.SIGKILL)
            killed = time.monotonic()
            second = [*RUN[2:], *there, "--duration", "1"]
            refused = muro_of("bob", *second)
            if time.monotonic() - killed < 2.0:  # else the machine is busy, and its lease may have ended
                assert refused.returncode == 1
        while (joined := muro_of("bob", *second)).returncode == 1:
            assert time.monotonic() - killed < seconds(10), joined.stdout
        assert joined.returncode == 0, joined.stdout + joined.stderr
        assert {r.message.behaviour for r in fleet.behaviour.values().values()} == {"hold"}
        await fleet.until(fleet.stationary, 5, "the robots were left standing")
        assert all(process.running for process in fleet.process.values())


async def _others_are_refused(fleet: RealFleet, there: list[str]) -> None:
    refused = await asyncio.to_thread(muro_of, "bob", *RUN[2:], *there)
    assert refused.returncode == 1
    assert re.search(f"^refused: {HELD}$", refused.stdout, re.MULTILINE), refused.stdout + refused.stderr
    for order in (["set", "circle", "--radius", "0.6"], ["goal", "r1", "0.1", "0.1"], ["set", "behaviour", "hold"]):
        refused = await asyncio.to_thread(muro_of, "bob", *order, *there)
        assert refused.returncode == 1
        assert re.search(HELD, refused.stdout), refused.stdout
    await fleet.until(fleet.driving, 5, "nobody changed what they do")
    accepted = await asyncio.to_thread(muro_of, "alice", "set", "circle", "--radius", "0.75", *there)
    assert accepted.returncode == 0, accepted.stdout


def test_a_run_of_its_own_holds_its_robots_too() -> None:
    with Process([*RUN, "--duration", "60"], name="muro run", env={"MURO_OPERATOR": "alice"}) as first:
        first.line("all processes ready")
        (folder,) = Path("runs").iterdir()
        endpoint = re.findall(r"tcp/127.0.0.1:\d+", (folder / "scenario.json").read_text())[0]
        time.sleep(seconds(0.3))
        refused = muro_of("alice", *RUN[2:], "--connect", endpoint)
        assert refused.returncode == 1
        assert re.search(f"^refused: {HELD}$", refused.stdout, re.MULTILINE), refused.stdout + refused.stderr
        assert first.running
