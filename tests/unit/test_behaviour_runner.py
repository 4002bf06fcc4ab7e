"""Changing the behaviour: the one before is revoked, whatever it left behind."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

import pytest

from muro_zenoh import channels
from muro_zenoh.messages import SetBehaviour
from muro_zenoh.runtime.virtual_time import run_virtually
from tests.support.memory_fleet import memory_fleet, scenario

STUBBORN = """
import asyncio

async def deaf(robot):
    while True:
        try:
            await asyncio.sleep(0.05)
        except asyncio.CancelledError:
            if OVER.is_set():
                raise
        robot.drive(0.2, 0.0)

async def forgetful(robot):
    async def drive_on():
        while not OVER.is_set():
            robot.drive(0.2, 0.0)
            robot.velocity(0.2)
            await asyncio.sleep(0.05)
    KEPT.append(asyncio.create_task(drive_on()))
    await asyncio.sleep(600)

KEPT = []
OVER = asyncio.Event()
"""


@pytest.mark.parametrize("behaviour", ["deaf", "forgetful"])
def test_what_does_not_end_is_revoked(
    behaviour: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "lab_stubborn.py").write_text(STUBBORN)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "lab_stubborn", raising=False)

    async def main() -> None:
        async with memory_fleet(scenario(1, f"lab_stubborn:{behaviour}")) as fleet:
            try:
                await fleet.until(lambda: fleet.commanded("r1") != (0.0, 0.0), 3, "it drives")
                await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="hold"))
                await fleet.until(lambda: fleet.commanded("r1") == (0.0, 0.0), 0.2, "it stands")
                for _ in range(30):
                    await asyncio.sleep(0.1)
                    assert fleet.commanded("r1") == (0.0, 0.0)
                assert fleet.holds("r1", "the behaviour is hold")
                assert any("has not ended" in r.message for r in caplog.records) == (behaviour == "deaf")
                await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="circle"))
                await fleet.until(lambda: fleet.commanded("r1") != (0.0, 0.0), 2, "the next one is taken")
            finally:
                sys.modules["lab_stubborn"].OVER.set()
                await asyncio.sleep(0.2)

    run_virtually(main())
