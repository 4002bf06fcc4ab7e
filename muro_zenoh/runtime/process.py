"""A process's lifetime: signals and a lifeline cancel its main task, and that is the only way down.

Code of a user's own may ignore its cancellation, or block the loop: after a grace the process ends all the same.

Exit codes: 0 asked to leave; 1 failed, or had to be ended by force; 2 the settings or the command line were wrong.
"""

from __future__ import annotations

import asyncio
import contextlib
import faulthandler
import gc
import logging
import math
import os
import signal
import threading
import time
from collections.abc import Callable, Coroutine
from types import FrameType
from typing import Any

from muro_zenoh.errors import ConfigError, MuroError
from muro_zenoh.runtime.logs import set_up_logs

log = logging.getLogger(__name__)

LIFELINE = "MURO_LIFELINE"
"""Environment variable with the number of a pipe's reading end. Nothing is ever written to it: it ends when the
supervisor does, however that dies, and the process leaves."""

OK, FAILED, WRONG_USE = 0, 1, 2

_TASK_GRACE = 0.5
"""Tasks that outlive the main task are cancelled, and waited for this long [s]."""

_GRACE = 10.0
"""From being asked to leave, or from the end of its main task, to the forced end of a process whose loop is blocked, or
that waits for a thread which never ends [s]. `muro run` takes up to six seconds to end its children."""

_ORPHAN_GRACE = 3.0
"""The same for a process whose supervisor is gone: nobody else is left to end it [s]."""


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
    with asyncio.Runner(loop_factory=_loop_factory()) as runner:
        try:
            code = runner.run(_until_asked_to_leave(main()))
        except Exception as error:
            code = _say(error)
        finally:
            _end_within(_GRACE)
        # The runner itself would wait for every task, however long that ignores its cancellation.
        runner.run(_end_other_tasks())
    return code


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


async def _until_asked_to_leave(main: Coroutine[Any, Any, int | None]) -> int:
    loop = asyncio.get_running_loop()
    task = asyncio.ensure_future(main)
    asked = ""

    def leave(why: str) -> None:
        nonlocal asked
        if not asked:
            asked = why
            log.debug("leaving: %s", why)
            task.cancel()

    def on_signal(number: int, frame: FrameType | None) -> None:
        # Not one of the loop's own handlers: a loop that is blocked would never call it.
        _end_within(_GRACE)
        with contextlib.suppress(RuntimeError):  # the loop may be closed by now
            loop.call_soon_threadsafe(leave, signal.Signals(number).name)

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, on_signal)
    if LIFELINE in os.environ:
        lifeline = int(os.environ[LIFELINE])
        threading.Thread(target=_hold, args=(lifeline, loop, leave), name="lifeline", daemon=True).start()
    try:
        return await task or OK
    except asyncio.CancelledError:
        if not asked:
            raise
        return OK


def _hold(lifeline: int, loop: asyncio.AbstractEventLoop, leave: Callable[[str], None]) -> None:
    """Wait for the lifeline's end, in a thread: a behaviour that blocks the loop must not outlive `muro run`."""
    while os.read(lifeline, 1):
        pass
    _end_within(_ORPHAN_GRACE)
    with contextlib.suppress(RuntimeError):  # the loop may be closed by now
        loop.call_soon_threadsafe(leave, "the supervisor is gone")


async def _end_other_tasks() -> None:
    """Cancel what the main task has left behind, and end the process when that does not end."""
    others = asyncio.all_tasks() - {asyncio.current_task()}
    for task in others:
        task.cancel()
    left = (await asyncio.wait(others, timeout=_TASK_GRACE))[1] if others else ()
    if left:
        log.error(
            "ended by force: %s had not ended %g s after being cancelled; let CancelledError pass",
            ", ".join(sorted(task.get_name() for task in left)),
            _TASK_GRACE,
        )
        os._exit(FAILED)


_ends_at = math.inf
"""When this process is ended by force, by the monotonic clock [s]."""


def _end_within(grace: float) -> None:
    """End this process by force, with exit code 1 and a traceback of every thread. Of two ends the earlier one holds.

    Args:
        grace: how long it may take to end by itself [s].
    """
    global _ends_at
    if time.monotonic() + grace < _ends_at:
        _ends_at = time.monotonic() + grace
        faulthandler.dump_traceback_later(grace, exit=True)


def _loop_factory() -> Callable[[], asyncio.AbstractEventLoop] | None:
    try:
        import uvloop
    except ImportError:
        return None
    return uvloop.new_event_loop
