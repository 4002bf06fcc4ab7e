"""A child to be supervised: says it is ready, then does what its first argument says.

``stay``: until it is told to leave. ``deaf``: SIGTERM does not move it. ``crash SECONDS``: fails after so long.
``code NUMBER``: leaves with this exit code at once. ``early``: fails before it is ready. ``slow``: is never ready.
``parent``: starts a process of its own, says its number, and stays.
"""

# ruff: noqa: T201 - a child speaks on its output

import asyncio
import signal
import subprocess
import sys
import time

from muro_zenoh.runtime.process import ready, run_process


async def stay() -> None:
    ready("dummy")
    await asyncio.Event().wait()


what, *rest = sys.argv[1:]
print(f"dummy {what} starts", file=sys.stderr, flush=True)
if what == "stay":
    code = run_process(stay, "dummy")
    print(f"dummy left at {time.monotonic()}", file=sys.stderr, flush=True)
    sys.exit(code)
if what == "early":
    sys.exit("no such room")
if what == "deaf":
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
if what == "slow":
    time.sleep(60.0)
if what == "parent":
    print("grandchild", subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"]).pid, flush=True)
ready("dummy")
if what == "crash":
    time.sleep(float(rest[0]))
    sys.exit("the wheels came off")
if what == "code":
    sys.exit(int(rest[0]))
time.sleep(60.0)
