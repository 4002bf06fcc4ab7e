"""A process exits when its supervisor has ended, whatever its loop does."""

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
