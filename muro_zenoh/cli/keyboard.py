"""Single keys from a terminal, without Enter, while a coroutine runs."""

from __future__ import annotations

import asyncio
import contextlib
import os
import select
import sys
from collections.abc import Callable, Iterator


def has_keyboard() -> bool:
    """Whether the standard input is a terminal, and this process in its foreground: one in the background that sets or
    reads the terminal is suspended by it."""
    return sys.stdin is not None and sys.stdin.isatty() and _in_foreground(sys.stdin.fileno())


def _in_foreground(terminal: int) -> bool:
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:
        return False


@contextlib.contextmanager
def keyboard(press: Callable[[str], None]) -> Iterator[None]:
    """Call ``press`` on the loop for each key, within the block; Ctrl-C and Ctrl-Z mean what they always do.

    Args:
        press: takes a key.
    """
    import termios
    import tty

    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    loop = asyncio.get_running_loop()

    def read() -> None:
        if not _in_foreground(terminal):
            return  # it was sent to the background meanwhile: these keys are the shell's
        try:
            keys = os.read(terminal, 1024)
        except OSError:
            keys = b""
        if not keys:  # the terminal was closed
            loop.remove_reader(terminal)
        for key in keys.decode(errors="ignore"):
            press(key)

    tty.setcbreak(terminal, termios.TCSADRAIN)
    loop.add_reader(terminal, read)
    try:
        yield
    finally:
        loop.remove_reader(terminal)
        if select.select([terminal], [], [], 0.0)[0]:
            read()  # what was pressed as the block ended
        if _in_foreground(terminal):
            termios.tcsetattr(terminal, termios.TCSADRAIN, before)
