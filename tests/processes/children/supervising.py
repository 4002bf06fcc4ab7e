"""A parent to be killed: supervises a dummy child for each argument, which tells the child what to do."""

# ruff: noqa: T201 - a child speaks on its output

import os
import signal
import sys
from pathlib import Path

from muro_zenoh.runtime.process import ready, run_process
from muro_zenoh.supervision.child import ChildSpec
from muro_zenoh.supervision.supervisor import Supervisor

# Under nohup SIGHUP is inherited as ignored.
signal.signal(signal.SIGHUP, signal.SIG_DFL)

folder, *whats = sys.argv[1:]
dummy = str(Path(__file__).parent / "dummy.py")


async def supervise() -> None:
    async with Supervisor(Path(folder), print) as supervisor:
        children = await supervisor.start(
            [ChildSpec(f"child{i}", (sys.executable, "-P", dummy, what), os.environ) for i, what in enumerate(whats)]
        )
        print("PIDS", *(child.pid for child in children), flush=True)
        ready("supervising")
        await supervisor.failure()


sys.exit(run_process(supervise, "supervising"))
