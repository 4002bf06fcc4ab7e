"""Processes that work through independent tasks; one that crashes or hangs costs its task, not the rest."""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import signal
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, NamedTuple, TypeVar

T = TypeVar("T")
R = TypeVar("R")

_POLL = 0.5
"""Tasks that take too long are looked for this often [s]."""

_LEAVE = 2.0
"""A process that was ended may take this long before it is killed [s]."""


_GARBAGE = 100_000
"""Garbage in cycles is looked for after so many new objects: a trial leaves some thousand, Python's limit is 700."""


class Done(NamedTuple, Generic[T, R]):
    """A task that is over: its ``result``, or None and the ``failure`` in one line."""

    task: T
    result: R | None
    failure: str = ""


class Workers(Generic[T, R]):
    """Processes that do one kind of work; a context that ends them.

    Each is started afresh (spawned), as on every platform, and takes one task at a time. They ignore Ctrl-C: it ends
    the process that started them, which ends them.

    Args:
        work: from a task to its result; a function that can be pickled, as its tasks and results can.
        jobs: number of processes.
        limit: longest time for one task [s]; a process that takes longer is killed and replaced.
    """

    def __init__(self, work: Callable[[T], R], jobs: int, limit: float) -> None:
        self._work = work
        self._jobs = jobs
        self._limit = limit
        self._idle: list[_Worker] = []
        self._busy: dict[_Worker, tuple[T, float]] = {}

    def __enter__(self) -> Workers[T, R]:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in (*self._idle, *self._busy):
            worker.end()
        self._idle.clear()
        self._busy.clear()

    @property
    def has_room(self) -> bool:
        """Whether another task can start now."""
        return len(self._busy) < self._jobs

    @property
    def busy(self) -> int:
        """Number of tasks under way."""
        return len(self._busy)

    def start(self, task: T) -> None:
        """Start a task; there must be room.

        Args:
            task: the task.
        """
        worker = self._idle.pop() if self._idle else _Worker(self._work)
        self._busy[worker] = task, time.monotonic()
        worker.send(task)

    def finished(self) -> Iterator[Done[T, R]]:
        """Wait until tasks are over, at most half a second; yields those that are."""
        events = wait([worker.connection for worker in self._busy], timeout=_POLL)
        for worker, (task, began) in list(self._busy.items()):
            if worker.connection in events:
                del self._busy[worker]
                done = worker.receive(task)
                if worker.alive:
                    self._idle.append(worker)
                yield done
            elif time.monotonic() - began > self._limit:
                del self._busy[worker]
                worker.end()
                yield Done(task, None, f"hangs: not over after {self._limit:g} s")


class _Worker:
    """One process."""

    def __init__(self, work: Callable[[Any], Any]) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, work), daemon=True)
        self._process.start()
        theirs.close()
        self.alive = True

    def send(self, task: Any) -> None:
        with contextlib.suppress(ConnectionError):  # it is dead: receive() says so
            self.connection.send(task)

    def receive(self, task: Any) -> Done[Any, Any]:
        try:
            return Done(task, *self.connection.recv())
        except (EOFError, ConnectionError):
            self.end()
            return Done(task, None, f"its process died with exit code {self._process.exitcode}")

    def end(self) -> None:
        self.alive = False
        self._process.terminate()
        self._process.join(_LEAVE)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self.connection.close()


def _serve(tasks: Connection, work: Callable[[Any], Any]) -> None:
    """The main function of a process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.collect()
    gc.freeze()  # what is imported stays: 3 % less time
    gc.set_threshold(_GARBAGE)  # 2 % less
    while True:
        try:
            task = tasks.recv()
        except EOFError:
            return
        try:
            answer = work(task), ""
        except Exception as error:
            answer = None, f"{type(error).__name__}: {error}"
        tasks.send(answer)
