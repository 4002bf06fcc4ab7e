"""Child processes of the tests: started, awaited by their ready line, terminated, then killed."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

from muro_zenoh.runtime.process import LIFELINE
from tests.support.waiting import seconds

CHILDREN = Path(__file__).parent / "children"
MURO = ("-m", "muro_zenoh")
_LAST_LINES = 40
_NOT_RECEIVED = ("give it again", "nobody answered")
"""What an order ends with whose receiver stood still for a while, as any process of a busy machine may."""


def muro(*arguments: str, env: Mapping[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    """A command of ``muro`` that ends by itself; an order that was not received is given once more.

    Args:
        arguments: of the command line.
        env: variables besides the tests' own.
    """
    for attempt in range(2):
        done = subprocess.run(
            [sys.executable, "-P", *MURO, *arguments],
            capture_output=True,
            text=True,
            timeout=seconds(30),
            check=False,
            env={**os.environ, **(env or {})},
        )
        if done.returncode == 0 or not any(words in done.stdout + done.stderr for words in _NOT_RECEIVED):
            break
        print(f"attempt {attempt}: {' '.join(arguments)}: {done.stdout}{done.stderr}")  # noqa: T201 - for a failure
    return done


class Process:
    """A Python child process, whose output is read line by line. A context manager that stops the child at its end.

    It dies with the tests, however those end: it is given a lifeline.

    Args:
        arguments: of Python: ``-m`` and a module, or a script.
        name: what to call it in failures.
        env: variables besides the tests' own.
    """

    def __init__(self, arguments: Sequence[str], *, name: str, env: Mapping[str, str] | None = None) -> None:
        self.name = name
        lifeline, self._lifeline = os.pipe()
        try:
            self._popen = subprocess.Popen(
                [sys.executable, "-P", "-u", *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                env={**os.environ, **(env or {}), LIFELINE: str(lifeline)},
                pass_fds=(lifeline,),
            )
        finally:
            os.close(lifeline)
        self._heard = threading.Condition()
        self._unread: deque[str] = deque()
        self._last: deque[str] = deque(maxlen=_LAST_LINES)
        self._ended = False
        self._reader = threading.Thread(target=self._read, name=f"read-{name}", daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """Its pid."""
        return self._popen.pid

    @property
    def running(self) -> bool:
        """Whether it is running."""
        return self._popen.poll() is None

    def line(self, start: str, timeout: float = 10.0) -> str:
        """The next line that begins with ``start``; those before it are skipped.

        Raises:
            AssertionError: it ended, or no such line came in time (scaled) [s]; with its last lines.
        """
        end = time.monotonic() + seconds(timeout)
        with self._heard:
            while True:
                while self._unread:
                    line = self._unread.popleft()
                    if line.startswith(start):
                        return line
                if self._ended:
                    raise AssertionError(f"{self.name} ended before it said {start!r}.\n{self.last_lines()}")
                if not self._heard.wait(end - time.monotonic()):
                    raise AssertionError(
                        f"{self.name} did not say {start!r} within {seconds(timeout):g} s.\n{self.last_lines()}"
                    )

    def forget(self) -> None:
        """Skip the lines printed so far."""
        with self._heard:
            self._unread.clear()

    def ready(self, timeout: float = 20.0) -> None:
        """Wait for its ready line."""
        self.line("READY", timeout)

    def say(self, line: str) -> None:
        """Write a line to its standard input."""
        assert self._popen.stdin is not None
        self._popen.stdin.write(line + "\n")
        self._popen.stdin.flush()

    def send(self, number: signal.Signals) -> None:
        """Send a signal."""
        self._popen.send_signal(number)

    def wait(self, timeout: float = 10.0) -> int:
        """Its exit code (negative for a signal).

        Raises:
            AssertionError: it is still there after ``timeout`` (scaled) [s]; with its last lines.
        """
        try:
            code = self._popen.wait(seconds(timeout))
        except subprocess.TimeoutExpired:
            raise AssertionError(
                f"{self.name} was still there after {seconds(timeout):g} s.\n{self.last_lines()}"
            ) from None
        self._reader.join(seconds(5.0))
        return code

    def kill(self) -> None:
        """kill -9, and wait for its exit."""
        self._popen.kill()
        self.wait()

    def stop(self, timeout: float = 10.0) -> int:
        """Terminate it, kill it if necessary, and return its exit code."""
        if self.running:
            self._popen.send_signal(signal.SIGCONT)
            self._popen.terminate()
        try:
            return self.wait(timeout)
        except AssertionError:
            self._popen.kill()
            self.wait()
            raise
        finally:
            self._tidy()

    def last_lines(self, count: int = _LAST_LINES) -> str:
        """The last of its output, for failures."""
        return f"---- the last lines of {self.name}:\n" + "\n".join(list(self._last)[-count:]) + "\n----"

    def __enter__(self) -> Process:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def _read(self) -> None:
        assert self._popen.stdout is not None
        for line in self._popen.stdout:
            with self._heard:
                self._last.append(line.rstrip("\n"))
                self._unread.append(line.rstrip("\n"))
                self._heard.notify_all()
        with self._heard:
            self._ended = True
            self._heard.notify_all()

    def _tidy(self) -> None:
        if self._lifeline >= 0:
            os.close(self._lifeline)
            self._lifeline = -1
        for stream in (self._popen.stdin, self._popen.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()
