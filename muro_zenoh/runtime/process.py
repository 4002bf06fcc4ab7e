"""A process's lifetime: signals and a lifeline cancel its main task, and that is the only way down.

Exit codes: 0 asked to leave; 1 failed; 2 the settings or the command line were wrong.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import os
import signal
import threading
import time
from collections.abc import Callable, Coroutine
from typing import Any

from muro_zenoh.errors import ConfigError, MuroError
from muro_zenoh.runtime.logs import set_up_logs

log = logging.getLogger(__name__)

LIFELINE = "MURO_LIFELINE"
"""Environment variable with the number of a pipe's reading end. Nothing is ever written to it: it ends when the
supervisor does, however that dies, and the process leaves."""

OK, FAILED, WRONG_USE = 0, 1, 2

_GRACE = 3.0
"""A process whose supervisor is gone has so long to leave by itself [s]."""


def run_process(main: Callable[[], Coroutine[Any, Any, int | None]], name: str) -> int:
    """Run a process to its end.

    Args:
        main: makes the main coroutine; what it returns is the exit code (None: 0).
        name: whose logs these are.

    Returns:
        The exit code.
    """
    set_up_logs(name)
    # What the imports made lives as long as the process; the collector need not walk it again.
    gc.collect()
    gc.freeze()
    try:
        with asyncio.Runner(loop_factory=_loop_factory()) as runner:
            return runner.run(_until_told(main()))
    except Exception as error:
        return _say(error)


def _say(error: Exception) -> int:
    """Log what went wrong; a traceback only for what was not raised on purpose. The exit code."""
    if isinstance(error, ExceptionGroup):
        return max(_say(one) for one in error.exceptions)
    if isinstance(error, MuroError):
        log.error("%s", error)
        return WRONG_USE if isinstance(error, ConfigError) else FAILED
    log.error("crashed: %s: %s", type(error).__name__, error, exc_info=error)
    return FAILED


def ready(role: str, name: str = "") -> None:
    """Print the ready line that a supervisor waits for."""
    print(f"READY {role} {name}".rstrip(), flush=True)  # noqa: T201 - a line for the supervisor


async def _until_told(main: Coroutine[Any, Any, int | None]) -> int:
    loop = asyncio.get_running_loop()
    task = asyncio.ensure_future(main)
    told = ""

    def leave(why: str) -> None:
        nonlocal told
        if not told:
            told = why
            log.debug("leaving: %s", why)
            task.cancel()

    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, leave, number.name)
    if LIFELINE in os.environ:
        lifeline = int(os.environ[LIFELINE])
        threading.Thread(target=_hold, args=(lifeline, loop, leave), name="lifeline", daemon=True).start()
    try:
        return await task or OK
    except asyncio.CancelledError:
        if not told:
            raise
        return OK


def _hold(lifeline: int, loop: asyncio.AbstractEventLoop, leave: Callable[[str], None]) -> None:
    """Wait for the lifeline's end, in a thread: a behaviour that blocks the loop must not outlive `muro run`."""
    while os.read(lifeline, 1):
        pass
    with contextlib.suppress(RuntimeError):  # the loop may be closed by now
        loop.call_soon_threadsafe(leave, "the supervisor is gone")
    time.sleep(_GRACE)
    os._exit(FAILED)


def _loop_factory() -> Callable[[], asyncio.AbstractEventLoop] | None:
    try:
        import uvloop
    except ImportError:
        return None
    return uvloop.new_event_loop
