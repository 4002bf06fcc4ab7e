"""The page's process as the base station's child: started anew when it ends, and gone when the base station is."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from collections.abc import Sequence
from typing import Final

from muro_zenoh.runtime.process import LIFELINE, WRONG_USE

log = logging.getLogger(__name__)

_FIRST_DELAY: Final = 0.5
_LONGEST_DELAY: Final = 30.0
"""Time until it is started anew; it doubles with each end that comes soon [s]."""

_SOON: Final = 60.0
_END_TIMEOUT: Final = 2.0


async def keep_page(command: Sequence[str]) -> None:
    """Run the page's process until cancelled. Whatever becomes of it, the base station goes on.

    Args:
        command: program and arguments.
    """
    loop = asyncio.get_running_loop()
    delay = _FIRST_DELAY
    # Only the base station holds the writing end: the process ends with it, however that ends.
    lifeline, held = os.pipe()
    environment = {**os.environ, LIFELINE: str(lifeline)}
    try:
        while True:
            began = loop.time()
            try:
                code = await _run(command, environment, lifeline)
                ended = f"ended with code {code}"
            except OSError as error:  # no memory or no process is free just now
                code, ended = None, f"cannot be started ({error})"
            if code == WRONG_USE:
                log.error("no page: its process refused its settings")
                return
            delay = _FIRST_DELAY if loop.time() - began > _SOON else min(2.0 * delay, _LONGEST_DELAY)
            log.warning("the page's process %s; it is started anew in %g s", ended, delay)
            await asyncio.sleep(delay)
    finally:
        os.close(lifeline)
        os.close(held)


async def _run(command: Sequence[str], environment: dict[str, str], lifeline: int) -> int:
    nothing = asyncio.subprocess.DEVNULL
    process = await asyncio.create_subprocess_exec(
        *command, stdin=nothing, stdout=nothing, env=environment, pass_fds=(lifeline,)
    )
    try:
        return await process.wait()
    finally:
        if process.returncode is None:
            await _end(process)


async def _end(process: asyncio.subprocess.Process) -> None:
    with contextlib.suppress(ProcessLookupError):
        process.terminate()
        try:
            async with asyncio.timeout(_END_TIMEOUT):
                await process.wait()
        except TimeoutError:
            process.kill()
