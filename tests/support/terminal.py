"""A command on its own terminal, as an operator sees it."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import termios
import threading
from collections.abc import Sequence
from types import TracebackType

from tests.support.waiting import seconds

SIZE = (40, 140)
"""Rows and columns."""

_ATTACH = "import fcntl, os, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0); os.execv(sys.argv[1], sys.argv[1:])"


class Terminal:
    """Runs Python on its own pseudo-terminal. A context manager that stops the command at its end.

    Args:
        arguments: of Python.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        self._ours, theirs = os.openpty()
        termios.tcsetwinsize(theirs, SIZE)
        try:
            self._popen = subprocess.Popen(
                [sys.executable, "-P", "-c", _ATTACH, sys.executable, "-P", *arguments],
                stdin=theirs,
                stdout=theirs,
                stderr=theirs,
                start_new_session=True,
                env={**os.environ, "TERM": "xterm-256color"},
            )
        finally:
            os.close(theirs)
        self._shown = b""
        self._more = threading.Condition()
        self._ended = False
        self._reader = threading.Thread(target=self._read, name="terminal", daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """The process's pid."""
        return self._popen.pid

    @property
    def shown(self) -> str:
        """All that was written to the terminal so far, with its control sequences."""
        return self._shown.decode(errors="replace")

    @property
    def line_by_line(self) -> bool:
        """Whether keys are passed on at Enter only, and shown, as in a shell."""
        flags = termios.tcgetattr(self._ours)[3]
        return bool(flags & termios.ICANON) and bool(flags & termios.ECHO)

    def until(self, text: str, limit: float) -> None:
        """Wait until a text was shown.

        Raises:
            AssertionError: it was not within ``limit`` (scaled) [s], or the command ended before.
        """
        with self._more:
            came = self._more.wait_for(lambda: text in self.shown or self._ended, seconds(limit))
        assert came, f"{text!r} was not shown within {seconds(limit):g} s:\n{self.shown}"
        assert text in self.shown, f"ended before {text!r} was shown:\n{self.shown}"

    def type(self, keys: str) -> None:
        """Press keys; ``\\x03`` is Ctrl-C."""
        os.write(self._ours, keys.encode())

    def wait(self, limit: float) -> int:
        """Wait for the end of the command; its exit code."""
        code = self._popen.wait(seconds(limit))
        self._reader.join(seconds(5.0))
        return code

    def _read(self) -> None:
        # The terminal is hung up when the last process on it is gone: an error on Linux, an end elsewhere.
        with contextlib.suppress(OSError):
            while data := os.read(self._ours, 65536):
                with self._more:
                    self._shown += data
                    self._more.notify_all()
        with self._more:
            self._ended = True
            self._more.notify_all()

    def __enter__(self) -> Terminal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._popen.kill()
        self.wait(10.0)
        os.close(self._ours)
