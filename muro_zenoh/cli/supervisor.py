"""Child processes, kept alive: started, watched, started again, and ended with their parent.

A child prints ``READY ...`` on its standard output when it is up, logs to its standard error, leaves on SIGTERM, and
leaves when its lifeline (:data:`~muro_zenoh.runtime.process.LIFELINE`) ends. Only the parent holds the lifeline's
writing end, so it ends however the parent does.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from muro_zenoh.errors import SupervisionError
from muro_zenoh.runtime.process import LIFELINE, WRONG_USE

_TAIL_LINES = 12
_TAIL_BYTES = 16384


@dataclass(frozen=True, slots=True)
class ChildSpec:
    """What to start.

    Attributes:
        name: of the process; its log is ``<name>.log``.
        command: program and arguments.
        environment: its whole environment; the lifeline is added.
    """

    name: str
    command: tuple[str, ...]
    environment: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Patience:
    """When to start a child again, and when to stop trying.

    Attributes:
        first: wait before the first restart; it doubles with each death within ``window`` [s].
        most: so many restarts within ``window``; at the next death the child is given up.
        window: deaths are forgotten after so long [s].
        ready: a child must be ready within this [s].
        leave: a child must leave within this after SIGTERM, else it is killed [s].
    """

    first: float = 0.5
    most: int = 5
    window: float = 60.0
    ready: float = 15.0
    leave: float = 2.0


@dataclass(slots=True)
class Child:
    """A child process through all its lives.

    Attributes:
        spec: what it is.
        restarts: how often it was started again.
        pid: of its present life; None while it has none.
        ready: set while it is up.
    """

    spec: ChildSpec
    restarts: int = 0
    pid: int | None = None
    ready: asyncio.Event = field(default_factory=asyncio.Event)
    was_ready: bool = False
    deaths: list[float] = field(default_factory=list)


class Supervisor:
    """Keeps children alive as long as its ``async with`` block runs, and leaves none behind.

    Args:
        logs: the folder for a log per child.
        tell: called with a line for the operator whenever a child dies or is started again.
        patience: when to restart and when to give up.
    """

    def __init__(self, logs: Path, tell: Callable[[str], None], patience: Patience | None = None) -> None:
        self._logs = logs
        self._tell = tell
        self._patience = patience or Patience()
        self._groups: list[list[tuple[Child, asyncio.Task[None]]]] = []
        self._stopping = False
        self._failed: asyncio.Future[SupervisionError] = asyncio.get_running_loop().create_future()
        # Neither end is inherited unless it is passed on; the writing end never is.
        self._lifeline, self._held = os.pipe()

    @property
    def children(self) -> list[Child]:
        """All children, in the order of their start."""
        return [child for group in self._groups for child, _ in group]

    async def start(self, specs: Sequence[ChildSpec]) -> list[Child]:
        """Start children side by side and wait until each is ready. Those that are started first are ended last.

        Args:
            specs: what to start.

        Raises:
            SupervisionError: one died before it was ready for the first time, or another child was given up.
        """
        group = []
        for spec in specs:
            child = Child(spec)
            task = asyncio.create_task(self._keep(child), name=f"keep {spec.name}")
            task.add_done_callback(self._on_kept)
            group.append((child, task))
        self._groups.append(group)
        failed = self._failed
        all_ready = asyncio.gather(*(child.ready.wait() for child, _ in group))
        waits: set[asyncio.Future[Any]] = {all_ready, failed}
        try:
            await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
            if not all_ready.done():
                raise failed.result()
        except BaseException:
            self._groups.remove(group)
            await self._end(group)
            if failed.done() and failed is self._failed:
                self._failed = asyncio.get_running_loop().create_future()  # a next attempt is a new one
            raise
        finally:
            all_ready.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await all_ready
        return [child for child, _ in group]

    async def failure(self) -> SupervisionError:
        """Wait until a child is given up; why."""
        return await asyncio.shield(self._failed)

    async def close(self) -> None:
        """End every child: SIGTERM, then SIGKILL; the last started first."""
        self._stopping = True
        groups, self._groups = self._groups, []
        try:
            for group in reversed(groups):
                await self._end(group)
        finally:
            for group in groups:
                for child, _ in group:
                    _kill(child)
            for end in (self._lifeline, self._held):
                os.close(end)

    async def __aenter__(self) -> Supervisor:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    # ---- one child

    async def _keep(self, child: Child) -> None:
        patience = self._patience
        while True:
            code, last_lines = await self._live(child)
            if self._stopping:
                return
            now = time.monotonic()
            child.deaths = [t for t in child.deaths if now - t < patience.window] + [now]
            name = child.spec.name
            self._tell("\n".join([f"{name} {_how(code)}. Its last lines:", *(f"  {line}" for line in last_lines)]))
            log = self._logs / f"{name}.log"
            if not child.was_ready:
                raise SupervisionError(f"{name} {_how(code)} before it was ready; see {log}")
            if code == WRONG_USE:
                raise SupervisionError(f"{name} refused its settings; see {log}")
            if len(child.deaths) > patience.most:
                raise SupervisionError(
                    f"{name} died {len(child.deaths)} times within {patience.window:g} s, "
                    f"expected at most {patience.most}: given up; see {log}"
                )
            wait = patience.first * 2.0 ** (len(child.deaths) - 1)
            self._tell(f"{name} starts again in {wait:g} s")
            await asyncio.sleep(wait)
            child.restarts += 1

    async def _live(self, child: Child) -> tuple[int, list[str]]:
        """One life of a child, to its end: exit code, last lines of its log."""
        path = self._logs / f"{child.spec.name}.log"
        with path.open("ab", buffering=0) as log:
            begin = log.tell()
            life = time.strftime("%H:%M:%S")
            log.write(f"--- {life} start {child.restarts + 1}: {' '.join(child.spec.command)}\n".encode())
            try:
                process = subprocess.Popen(  # noqa: ASYNC220 - a spawn takes a millisecond or two
                    child.spec.command,
                    env={**child.spec.environment, LIFELINE: str(self._lifeline)},
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=log,
                    pass_fds=(self._lifeline,),
                    # Ctrl-C in the terminal is for the parent alone, which ends its children in order.
                    start_new_session=True,
                )
            except OSError as error:
                log.write(f"could not start: {error}\n".encode())
                return WRONG_USE, [f"could not start {child.spec.command[0]}: {error.strerror or error}"]
            child.pid = process.pid
            assert process.stdout is not None
            late = asyncio.get_running_loop().call_later(self._patience.ready, self._on_late, child, process.pid)
            listener = asyncio.create_task(_listen(process.stdout, log, child))
            try:
                await _end_of(process.pid)
            finally:
                # What it started goes with it; and it itself when we are cancelled, the last resort. Before it is
                # waited for, so that its number cannot have become another's.
                _kill(child)
                code = process.wait()
                late.cancel()
                child.pid = None
                await asyncio.wait({listener}, timeout=0.2)
                listener.cancel()
                child.ready.clear()
        return code, _tail(path, begin)

    def _on_late(self, child: Child, pid: int) -> None:
        if child.pid == pid and not child.ready.is_set():
            self._tell(f"{child.spec.name} was not ready within {self._patience.ready:g} s: killed")
            _kill(child)

    def _on_kept(self, task: asyncio.Task[None]) -> None:
        if task.cancelled():
            return
        error = task.exception()
        if error is not None and not self._failed.done():
            if not isinstance(error, SupervisionError):
                error = SupervisionError(f"{task.get_name()}: {error!r}")
            self._failed.set_result(error)

    async def _end(self, group: list[tuple[Child, asyncio.Task[None]]]) -> None:
        tasks = set()
        for child, task in group:
            tasks.add(task)
            if child.pid is None:
                task.cancel()  # between two lives
            else:
                _signal(child, signal.SIGTERM)
                task.add_done_callback(_retrieve)
        stopping, self._stopping = self._stopping, True
        try:
            _, pending = await asyncio.wait(tasks, timeout=self._patience.leave)
            for child, task in group:
                if task in pending:
                    self._tell(f"{child.spec.name} did not leave within {self._patience.leave:g} s: killed")
                    _kill(child)
            if pending:
                await asyncio.wait(pending, timeout=1.0)
        finally:
            self._stopping = stopping
            for task in tasks:
                task.cancel()


def _retrieve(task: asyncio.Task[None]) -> None:
    if not task.cancelled():
        task.exception()  # told already


async def _listen(pipe: IO[bytes], log: IO[bytes], child: Child) -> None:
    """Read a child's standard output: the ready line, and what else it prints, which goes to its log."""
    reader = asyncio.StreamReader()
    transport, _ = await asyncio.get_running_loop().connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(reader), pipe
    )
    try:
        while data := await reader.read(65536):
            if not child.ready.is_set() and any(line.startswith(b"READY") for line in data.splitlines()):
                child.was_ready = True
                child.ready.set()
            log.write(data)
    finally:
        transport.close()


async def _end_of(pid: int) -> None:
    """Wait until a child has ended, without reaping it; no thread, and no wait for its pipes as asyncio's own has."""
    try:
        fd = os.pidfd_open(pid)
    except (AttributeError, OSError):  # not Linux, or a kernel before 5.3
        while not _ended(pid):  # noqa: ASYNC110 - nothing here could set an event
            await asyncio.sleep(0.05)
        return
    loop = asyncio.get_running_loop()
    gone: asyncio.Future[None] = loop.create_future()
    loop.add_reader(fd, _settle, gone)
    try:
        await gone
    finally:
        loop.remove_reader(fd)
        os.close(fd)


def _settle(gone: asyncio.Future[None]) -> None:
    if not gone.done():
        gone.set_result(None)


def _ended(pid: int) -> bool:
    return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def _signal(child: Child, number: int) -> None:
    if child.pid is not None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(child.pid, number)


def _kill(child: Child) -> None:
    """Kill a child and whatever it has started."""
    if child.pid is not None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(child.pid, signal.SIGKILL)


def _how(code: int) -> str:
    """How a process ended, in words."""
    if code < 0:
        with contextlib.suppress(ValueError):
            return f"was ended by {signal.Signals(-code).name}"
    return f"left with exit code {code}"


def _tail(path: Path, begin: int) -> list[str]:
    """The last lines of a log from a place on."""
    with path.open("rb") as log:
        log.seek(max(begin, path.stat().st_size - _TAIL_BYTES))
        return log.read().decode(errors="replace").splitlines()[-_TAIL_LINES:]
