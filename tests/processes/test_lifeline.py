"""A process exits when its supervisor has ended, or when it stands still, whatever its loop does."""

import os
import subprocess
import sys

import pytest

from muro_zenoh.runtime.process import FAILED, LIFELINE, OK
from tests.support.waiting import seconds

WAITS = "await asyncio.Event().wait()"
BLOCKS = "while True: pass"


@pytest.mark.parametrize(("body", "code"), [(WAITS, OK), (BLOCKS, FAILED)])
def test_a_process_exits_when_its_lifeline_closes(body: str, code: int) -> None:
    program = f"""
import asyncio, sys
from muro_zenoh.runtime.process import ready, run_process

async def main():
    ready("child")
    {body}

sys.exit(run_process(main, "child"))
"""
    reading, writing = os.pipe()
    with subprocess.Popen(
        [sys.executable, "-P", "-c", program],
        stdout=subprocess.PIPE,
        pass_fds=[reading],
        env={**os.environ, LIFELINE: str(reading)},
    ) as child:
        os.close(reading)
        try:
            assert child.stdout is not None
            assert child.stdout.readline() == b"READY child\n"
            os.close(writing)
            assert child.wait(seconds(15.0)) == code
        finally:
            child.kill()


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ("await asyncio.sleep(1.5 * LIMIT)", OK),
        (BLOCKS, FAILED),
        ("ctypes.PyDLL(None).sleep(3600)", FAILED),  # which keeps the GIL
    ],
)
def test_a_process_with_a_watchdog_exits_when_its_loop_is_blocked(body: str, code: int) -> None:
    program = f"""
import asyncio, ctypes, sys, time
from muro_zenoh.runtime.process import run_process, watchdog

LIMIT = {seconds(1.5)}

async def main():
    async with watchdog(LIMIT):
        await asyncio.sleep(0)
        {body}
    time.sleep(2.0 * LIMIT)  # it is off

sys.exit(run_process(main, "child"))
"""
    command = [sys.executable, "-P", "-c", program]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=seconds(15.0), check=False)
    assert ended.returncode == code, ended.stderr
    assert ("in main" in ended.stderr) == (code == FAILED), "where it stood still"
