"""A child process: its runs, its log, its exit."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from muro_zenoh.runtime.process import LIFELINE, WRONG_USE

_TAIL_LINES = 12
_TAIL_BYTES = 16384


@dataclass(frozen=True, slots=True)
class ChildSpec:
    """A process to start.

    Attributes:
        name: of the process; its log is ``<name>.log``.
        command: program and arguments.
        environment: its complete environment; the lifeline is added.
    """

    name: str
    command: tuple[str, ...]
    environment: Mapping[str, str]


class Child:
    """A child process, over all its restarts.

    Args:
        spec: the process to start.
        log: the file to which each run appends its output.
        lifeline: reading end of the pipe that closes when the parent ends.

    Attributes:
        spec: the process to start.
        log: the file of its output.
        restarts: number of restarts.
        pid: pid of the current run; None while it is not running.
        ready: set while it is ready.
        was_ready: whether it has been ready in any run.
        stopping: whether it is being stopped and must not be restarted.
        may_restart: cleared while it must stay dead after its death.
    """

    def __init__(self, spec: ChildSpec, log: Path, lifeline: int) -> None:
        self.spec = spec
        self.log = log
        self.restarts = 0
        self.pid: int | None = None
        self.ready = asyncio.Event()
        self.was_ready = False
        self.stopping = False
        self.may_restart = asyncio.Event()
        self.may_restart.set()
        self._lifeline = lifeline

    async def run(self) -> tuple[int, list[str]]:
        """Start it, and wait until it exits.

        Returns:
            The exit code (negative for a signal), and the last lines of its log.
        """
        with self.log.open("ab", buffering=0) as log:
            begin = log.tell()
            command = " ".join(self.spec.command)
            log.write(f"--- {time.strftime('%H:%M:%S')} start {self.restarts + 1}: {command}\n".encode())
            try:
                process = subprocess.Popen(  # noqa: ASYNC220 - a spawn takes a millisecond or two
                    self.spec.command,
                    env={**self.spec.environment, LIFELINE: str(self._lifeline)},
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=log,
                    pass_fds=(self._lifeline,),
                    # Only the parent receives Ctrl-C from the terminal; it stops its children in order.
                    start_new_session=True,
                )
            except OSError as error:
                log.write(f"could not start: {error}\n".encode())
                return WRONG_USE, [f"could not start {self.spec.command[0]}: {error.strerror or error}"]
            self.pid = process.pid
            assert process.stdout is not None
            listener = asyncio.create_task(self._listen(process.stdout, log))
            try:
                await _end_of(process.pid)
            finally:
                # Kill the processes that it started, and after a cancellation the child itself, as the last resort.
                # Before waiting for it, so that its pid cannot have been reused.
                self.kill()
                code = process.wait()
                self.pid = None
                await asyncio.wait({listener}, timeout=0.2)
                listener.cancel()
                self.ready.clear()
        return code, _tail(self.log, begin)

    def signal(self, number: signal.Signals) -> bool:
        """Send it a signal; returns whether it is running.

        Args:
            number: which.
        """
        if self.pid is None:
            return False
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, number)
        return True

    def terminate(self) -> None:
        """Send it SIGTERM. One that is frozen wakes for it, and does nothing else before."""
        self.signal(signal.SIGTERM)
        self.signal(signal.SIGCONT)

    def kill(self) -> None:
        """Kill it and every process that it has started."""
        if self.pid is not None:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self.pid, signal.SIGKILL)

    async def _listen(self, pipe: IO[bytes], log: IO[bytes]) -> None:
        """Read its standard output: detect the ready line, and copy everything to its log."""
        reader = asyncio.StreamReader()
        transport, _ = await asyncio.get_running_loop().connect_read_pipe(
            lambda: asyncio.StreamReaderProtocol(reader), pipe
        )
        try:
            while data := await reader.read(65536):
                if not self.ready.is_set() and any(line.startswith(b"READY") for line in data.splitlines()):
                    self.was_ready = True
                    self.ready.set()
                log.write(data)
        finally:
            transport.close()


def exit_description(code: int) -> str:
    """A process's exit, in words."""
    if code < 0:
        with contextlib.suppress(ValueError):
            return f"was killed by {signal.Signals(-code).name}"
    return f"exited with code {code}"


async def _end_of(pid: int) -> None:
    """Wait until a child has exited, without reaping it, without a thread and, unlike asyncio, without its pipes."""
    try:
        fd = os.pidfd_open(pid)
    except (AttributeError, OSError):  # not Linux, or a kernel before 5.3
        while not _ended(pid):  # noqa: ASYNC110 - nothing here could set an event
            await asyncio.sleep(0.05)
        return
    loop = asyncio.get_running_loop()
    ended: asyncio.Future[None] = loop.create_future()
    loop.add_reader(fd, _set_done, ended)
    try:
        await ended
    finally:
        loop.remove_reader(fd)
        os.close(fd)


def _set_done(ended: asyncio.Future[None]) -> None:
    if not ended.done():
        ended.set_result(None)


def _ended(pid: int) -> bool:
    return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def _tail(path: Path, begin: int) -> list[str]:
    """The last lines of a log from a position on."""
    with path.open("rb") as log:
        log.seek(max(begin, path.stat().st_size - _TAIL_BYTES))
        return log.read().decode(errors="replace").splitlines()[-_TAIL_LINES:]
