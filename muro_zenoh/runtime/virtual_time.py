"""An event loop whose time jumps to the next timer: minutes of a fleet in seconds, however busy the machine is.

The loop never waits, so coroutines that run on it may use timers, queues and the in-memory bus, but no threads and no
sockets: virtual time would advance while a thread works. It may run several :class:`processes <VirtualProcess>` side by
side: each keeps asyncio's order within itself, while the order between them at one instant is drawn from a seed, as
nothing orders real processes. The same seed gives the same run.
"""

from __future__ import annotations

import asyncio
import contextvars
import heapq
import itertools
import random
from collections import deque
from collections.abc import Callable, Coroutine, Generator
from concurrent.futures import Executor, Future
from typing import Any, Final, ParamSpec, TypeVar, TypeVarTuple

T = TypeVar("T")
P = ParamSpec("P")
Ts = TypeVarTuple("Ts")

_MOST_STEPS: Final = 200_000
"""Callbacks at one instant at most: more are a loop that never lets time pass."""

_PROCESS: contextvars.ContextVar[VirtualProcess] = contextvars.ContextVar("_PROCESS")


class VirtualProcess:
    """The tasks of one simulated process on a :class:`VirtualLoop`, and all that they start.

    Args:
        loop: where they run.
        name: for errors.

    Attributes:
        name: for errors.
        frozen: whether they run no more for now.
    """

    __slots__ = ("_context", "_loop", "_queued", "_ready", "frozen", "name")

    def __init__(self, loop: VirtualLoop, name: str) -> None:
        self.name = name
        self.frozen = False
        self._loop = loop
        self._ready: deque[asyncio.Handle] = deque()
        self._queued = False  # among the loop's runnable ones, or frozen: nothing to do when a callback comes
        self._context = contextvars.copy_context()
        self._context.run(_PROCESS.set, self)
        loop._processes.append(self)

    def create_task(self, coroutine: Coroutine[Any, Any, T], *, name: str | None = None) -> asyncio.Task[T]:
        """Start a task of this process.

        Args:
            coroutine: what it runs.
            name: of the task.
        """
        return self._loop.create_task(coroutine, name=name, context=self._context.copy())

    def run(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Call a function of this process now.

        Args:
            function: the function.
            args: passed on.
            kwargs: passed on.
        """
        return self._context.copy().run(function, *args, **kwargs)

    def freeze(self) -> None:
        """Stop running, as after SIGSTOP. What becomes due meanwhile is kept."""
        self.frozen = self._queued = True
        self._loop._set_aside(self)

    def thaw(self) -> None:
        """Go on: all that became due runs now, in the order in which it became due."""
        if not self.frozen:
            return
        self.frozen = self._queued = False
        if self._ready:
            self._loop._queue(self)


class VirtualLoop(asyncio.BaseEventLoop):
    """A loop for coroutines that use no threads and no sockets.

    Args:
        seed: draws which process goes first when several are ready.
    """

    def __init__(self, seed: int = 0) -> None:
        super().__init__()
        self._now = 0.0
        self._numbers = itertools.count()
        self._timers: list[tuple[float, int, asyncio.TimerHandle]] = []
        self._draw = random.Random(seed).random
        self._runnable: list[VirtualProcess] = []
        self._steps = 0
        self._processes: list[VirtualProcess] = []
        self._main = VirtualProcess(self, "main")
        self.set_task_factory(_make_task)

    def time(self) -> float:
        """Virtual time since the start [s]."""
        return self._now

    def call_soon(
        self,
        callback: Callable[[*Ts], object],
        *args: *Ts,
        context: contextvars.Context | None = None,
    ) -> asyncio.Handle:
        """Call back at this instant, after what is ready in the same process.

        Args:
            callback: the function.
            args: passed on.
            context: whose; the caller's by default.
        """
        handle = asyncio.Handle(callback, args, self, context)
        process = _PROCESS.get(self._main) if context is None else context.get(_PROCESS, self._main)
        process._ready.append(handle)
        if not process._queued:
            self._queue(process)
        return handle

    call_soon_threadsafe = call_soon

    def call_at(
        self,
        when: float,
        callback: Callable[[*Ts], object],
        *args: *Ts,
        context: contextvars.Context | None = None,
    ) -> asyncio.TimerHandle:
        """Call back at a time.

        Args:
            when: the time [s, as :meth:`time`].
            callback: the function.
            args: passed on.
            context: whose; the caller's by default.
        """
        timer = asyncio.TimerHandle(when, callback, args, self, context)
        heapq.heappush(self._timers, (when, next(self._numbers), timer))
        return timer

    def _timer_handle_cancelled(self, handle: asyncio.TimerHandle) -> None:
        """It is dropped when its time has come."""

    def _run_once(self) -> None:
        """One round of one process, as a real one's loop would make it."""
        runnable = self._runnable
        if not runnable:
            self._advance()
            if not runnable:
                return  # only frozen processes have something to do now
        if len(runnable) > 1:
            chosen = int(self._draw() * len(runnable))
            runnable[chosen], runnable[-1] = runnable[-1], runnable[chosen]
        process = runnable.pop()
        process._queued = False
        ready = process._ready
        self._steps += len(ready)
        for _ in range(len(ready)):
            handle = ready.popleft()
            if not handle._cancelled:
                handle._run()
            if process.frozen:
                break
        if ready and not process._queued:
            self._queue(process)
        if self._steps > _MOST_STEPS:
            raise RuntimeError(
                f"stuck in virtual time: got more than {_MOST_STEPS} callbacks at {self._now:.6f} s, expected the "
                f"tasks to await a later time now and then; the last ones were of process {process.name}"
            )

    def _advance(self) -> None:
        """Let time jump to the next timer."""
        timers = self._timers
        while timers and timers[0][2]._cancelled:
            heapq.heappop(timers)
        if not timers:
            raise RuntimeError(
                "deadlock in virtual time: got no task that is ready and no timer, expected one of them. "
                "Every task waits for another one, or for a thread or a socket, which virtual time does not support"
            )
        self._now = max(self._now, timers[0][0])
        self._steps = 0
        while timers and timers[0][0] <= self._now:
            timer = heapq.heappop(timers)[2]
            if not timer._cancelled:
                process = timer._context.get(_PROCESS, self._main)  # type: ignore[attr-defined]  # typeshed omits it
                process._ready.append(timer)
                if not process._queued:
                    self._queue(process)

    def _queue(self, process: VirtualProcess) -> None:
        process._queued = True
        self._runnable.append(process)

    def _set_aside(self, process: VirtualProcess) -> None:
        if process in self._runnable:
            self._runnable.remove(process)


class _Task(asyncio.Task[T]):
    """A task whose place in a set is the same in every run: a TaskGroup keeps its tasks in one."""

    def __init__(self, coroutine: Coroutine[Any, Any, T], number: int, **given: Any) -> None:
        self._number = number  # before the loop's own set of all tasks asks for it
        super().__init__(coroutine, **given)

    def __hash__(self) -> int:
        return self._number


def _make_task(
    loop: asyncio.AbstractEventLoop, coroutine: Coroutine[Any, Any, T] | Generator[Any, None, T], **given: Any
) -> asyncio.Task[T]:
    assert isinstance(loop, VirtualLoop)
    return _Task(coroutine, next(loop._numbers), loop=loop, **given)  # type: ignore[arg-type]  # a generator is as good


class VirtualClock:
    """The running loop's time as a :class:`~muro_zenoh.runtime.clock.Clock`; each process may have one of its own.

    Args:
        offset: what it shows too much [s].

    Attributes:
        offset: what it shows too much at the loop's start [s]; it may be set.
        drift: what it gains in each second [s/s].

    Raises:
        RuntimeError: there is no running loop.
    """

    def __init__(self, offset: float = 0.0) -> None:
        self.offset = offset
        self.drift = 0.0
        self._loop = asyncio.get_running_loop()

    def now(self) -> float:
        """Seconds since 1970, as if the loop had started in November 2023."""
        time = self._loop.time()
        return 1.7e9 + (time + self.offset + self.drift * time)


class InlineExecutor(Executor):
    """Replaces a thread pool: submitted calls are done at once and take no virtual time."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Call a function now.

        Args:
            fn: the function.
            args: passed on.
            kwargs: passed on.

        Returns:
            A finished future, with the function's result or exception.
        """
        done: Future[T] = Future()
        try:
            done.set_result(fn(*args, **kwargs))
        except Exception as error:
            done.set_exception(error)
        return done


def run_virtually(main: Coroutine[Any, Any, T], seed: int = 0) -> T:
    """Run a coroutine to its end in virtual time.

    Args:
        main: the coroutine.
        seed: draws which process goes first when several are ready.

    Returns:
        Its result.

    Raises:
        RuntimeError: a deadlock: no task can continue; or tasks that let no time pass.
    """
    with asyncio.Runner(loop_factory=lambda: VirtualLoop(seed)) as runner:
        return runner.run(_run_and_thaw(main))


async def _run_and_thaw(main: Coroutine[Any, Any, T]) -> T:
    """Afterwards tasks that are left are cancelled, which a frozen one would not notice."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualLoop)
    try:
        return await main
    finally:
        for process in loop._processes:
            process.thaw()
