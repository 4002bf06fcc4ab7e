"""A process's lifetime: signals and a lifeline cancel its main task; that is the only way to shut down.

A user's code may ignore its cancellation or block the loop: after a timeout the process is then ended by force.

Exit codes: 0 shut down on request; 1 failed, or ended by force; 2 the settings or the command line were wrong.
"""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import faulthandler
import gc
import logging
import math
import os
import signal
import sys
import threading
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from types import FrameType
from typing import Any

from muro_zenoh.errors import ConfigError, MuroError
from muro_zenoh.runtime.logs import set_up_logs

log = logging.getLogger(__name__)

LIFELINE = "MURO_LIFELINE"
"""Environment variable with the file descriptor of a pipe's reading end. Nothing is written to it: it is closed when
the supervisor ends, for whatever reason, and the process then shuts down."""

OK, FAILED, WRONG_USE = 0, 1, 2

_TASK_TIMEOUT = 0.5
"""How long tasks that outlive the main task may take to end after they are cancelled [s]."""

_SHUTDOWN_TIMEOUT = 10.0
"""Time from the request to shut down, or the end of the main task, until a process whose loop is blocked, or that waits
for a thread which never ends, is ended by force [s]. `muro run` takes up to six seconds to stop its children."""

_ORPHAN_TIMEOUT = 3.0
"""The same for a process whose supervisor has ended, because nothing else would stop it [s]."""

_PR_SET_PDEATHSIG = 1
"""From linux/prctl.h."""

_SWITCH_INTERVAL = 0.0005
"""A worker thread releases the interpreter's lock within this time when the loop waits for it [s]; Python's default of
5 ms would delay the dead-man, every command and the answer to a stop by that much."""


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
    with asyncio.Runner(loop_factory=_loop_factory()) as runner:
        try:
            code = runner.run(_run_until_shutdown(main()))
        except Exception as error:
            code = _report(error)
        finally:
            _end_within(_SHUTDOWN_TIMEOUT)
        # The runner itself would wait without limit for a task that ignores its cancellation.
        runner.run(_end_other_tasks())
    return code


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


def worker_threads(number: int, name: str) -> ThreadPoolExecutor:
    """Threads for work that would block the loop, such as rendering and searching frames; they delay it little.

    Args:
        number: how many; at least one is made.
        name: the start of their names.
    """
    sys.setswitchinterval(_SWITCH_INTERVAL)
    return ThreadPoolExecutor(max(1, number), thread_name_prefix=name)


async def _run_until_shutdown(main: Coroutine[Any, Any, int | None]) -> int:
    loop = asyncio.get_running_loop()
    task = asyncio.ensure_future(main)
    reason = ""

    def shut_down(why: str) -> None:
        nonlocal reason
        if not reason:
            reason = why
            log.debug("shutting down: %s", why)
            task.cancel()

    def on_signal(number: int, frame: FrameType | None) -> None:
        # Not one of the loop's own handlers: a loop that is blocked would never call it.
        _end_within(_SHUTDOWN_TIMEOUT)
        with contextlib.suppress(RuntimeError):  # the loop may be closed by now
            loop.call_soon_threadsafe(shut_down, signal.Signals(number).name)

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, on_signal)
    if LIFELINE in os.environ:
        _wake_when_orphaned()
        lifeline = int(os.environ[LIFELINE])
        threading.Thread(target=_watch_lifeline, args=(lifeline, loop, shut_down), name="lifeline", daemon=True).start()
    try:
        return await task or OK
    except asyncio.CancelledError:
        if not reason:
            raise
        return OK


def _wake_when_orphaned() -> None:
    """Have Linux send SIGCONT when the supervisor ends: a frozen process could not notice that its lifeline closes."""
    with contextlib.suppress(AttributeError, OSError):  # elsewhere there is no prctl()
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGCONT))


def _watch_lifeline(lifeline: int, loop: asyncio.AbstractEventLoop, shut_down: Callable[[str], None]) -> None:
    """Wait in a thread until the lifeline is closed: a behaviour that blocks the loop must not outlive `muro run`."""
    while os.read(lifeline, 1):
        pass
    _end_within(_ORPHAN_TIMEOUT)
    with contextlib.suppress(RuntimeError):  # the loop may be closed by now
        loop.call_soon_threadsafe(shut_down, "the supervisor has ended")


async def _end_other_tasks() -> None:
    """Cancel the tasks that outlive the main task, and end the process by force when they do not end."""
    others = asyncio.all_tasks() - {asyncio.current_task()}
    for task in others:
        task.cancel()
    left = (await asyncio.wait(others, timeout=_TASK_TIMEOUT))[1] if others else ()
    if left:
        log.error(
            "ended by force: %s had not ended %g s after being cancelled; do not suppress CancelledError",
            ", ".join(sorted(task.get_name() for task in left)),
            _TASK_TIMEOUT,
        )
        os._exit(FAILED)


_ends_at = math.inf
"""When this process is ended by force, by the monotonic clock [s]."""


def _end_within(timeout: float) -> None:
    """End this process by force after a timeout, with exit code 1 and a traceback of every thread. The earliest counts.

    Args:
        timeout: how long it may take to end by itself [s].
    """
    global _ends_at
    if time.monotonic() + timeout < _ends_at:
        _ends_at = time.monotonic() + timeout
        faulthandler.dump_traceback_later(timeout, exit=True)


@contextlib.asynccontextmanager
async def watchdog(timeout: float) -> AsyncIterator[None]:
    """During a block, end this process by force when its loop stands still, with exit code 1 and a traceback of every
    thread. For a process that is started anew when it ends, and whose standstill nobody would notice otherwise.

    Args:
        timeout: how long it may stand still [s].
    """
    feeding = asyncio.create_task(_feed_watchdog(timeout), name="watchdog")
    try:
        yield
    finally:
        feeding.cancel()
        await asyncio.wait({feeding})
        if not feeding.cancelled():
            feeding.result()  # why it was off


async def _feed_watchdog(timeout: float) -> None:
    try:
        while True:
            # It needs neither the loop nor the GIL. Each call takes the place of the one before.
            faulthandler.dump_traceback_later(min(timeout, _time_left()), exit=True)
            await asyncio.sleep(timeout / 10.0)
    finally:
        faulthandler.cancel_dump_traceback_later()
        if _ends_at < math.inf:
            faulthandler.dump_traceback_later(_time_left(), exit=True)


def _time_left() -> float:
    """Until this process is ended by force [s]."""
    return max(_ends_at - time.monotonic(), 0.001)


def _loop_factory() -> Callable[[], asyncio.AbstractEventLoop] | None:
    try:
        import uvloop
    except ImportError:
        return None
    return uvloop.new_event_loop
