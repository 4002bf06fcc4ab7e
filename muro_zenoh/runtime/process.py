"""A process's lifetime: signals and a lifeline cancel its main task; that is the only way to shut down.

Exit codes: 0 shut down on request; 1 failed; 2 the settings or the command line were wrong.
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
"""Environment variable with the file descriptor of a pipe's reading end. Nothing is written to it: it is closed when
the supervisor ends, for whatever reason, and the process then shuts down."""

OK, FAILED, WRONG_USE = 0, 1, 2

_SHUTDOWN_TIMEOUT = 3.0
"""How long a process may take to shut down after its supervisor has ended [s]."""


def run_process(main: Callable[[], Coroutine[Any, Any, int | None]], name: str) -> int:
    """Run a process to its end.

    Args:
        main: makes the main coroutine, which returns the exit code (None: 0).
        name: the process's name in the logs.

    Returns:
        The exit code.
    """
    set_up_logs(name)
    # Objects made by imports live as long as the process; the garbage collector need not scan them again.
    gc.collect()
    gc.freeze()
    try:
        with asyncio.Runner(loop_factory=_loop_factory()) as runner:
            return runner.run(_run_until_signalled(main()))
    except Exception as error:
        return _report(error)


def _report(error: Exception) -> int:
    """Log an error, with a traceback only for unexpected ones; return the exit code."""
    if isinstance(error, ExceptionGroup):
        return max(_report(one) for one in error.exceptions)
    if isinstance(error, MuroError):
        log.error("%s", error)
        return WRONG_USE if isinstance(error, ConfigError) else FAILED
    log.error("crashed: %s: %s", type(error).__name__, error, exc_info=error)
    return FAILED


def ready(role: str, name: str = "") -> None:
    """Print the ready line that a supervisor waits for."""
    print(f"READY {role} {name}".rstrip(), flush=True)  # noqa: T201 - a line for the supervisor


async def _run_until_signalled(main: Coroutine[Any, Any, int | None]) -> int:
    loop = asyncio.get_running_loop()
    task = asyncio.ensure_future(main)
    reason = ""

    def shut_down(why: str) -> None:
        nonlocal reason
        if not reason:
            reason = why
            log.debug("shutting down: %s", why)
            task.cancel()

    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, shut_down, number.name)
    if LIFELINE in os.environ:
        lifeline = int(os.environ[LIFELINE])
        threading.Thread(target=_watch_lifeline, args=(lifeline, loop, shut_down), name="lifeline", daemon=True).start()
    try:
        return await task or OK
    except asyncio.CancelledError:
        if not reason:
            raise
        return OK


def _watch_lifeline(lifeline: int, loop: asyncio.AbstractEventLoop, shut_down: Callable[[str], None]) -> None:
    """Wait in a thread until the lifeline is closed: a behaviour that blocks the loop must not outlive `muro run`."""
    while os.read(lifeline, 1):
        pass
    with contextlib.suppress(RuntimeError):  # the loop may be closed by now
        loop.call_soon_threadsafe(shut_down, "the supervisor has ended")
    time.sleep(_SHUTDOWN_TIMEOUT)
    os._exit(FAILED)


def _loop_factory() -> Callable[[], asyncio.AbstractEventLoop] | None:
    try:
        import uvloop
    except ImportError:
        return None
    return uvloop.new_event_loop
