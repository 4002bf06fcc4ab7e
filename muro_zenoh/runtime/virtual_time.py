"""An event loop whose time jumps to the next timer: minutes of a fleet in seconds, however busy the machine is.

The loop never waits, so coroutines that run on it may use timers, queues and the in-memory bus, but no threads and no
sockets: virtual time would advance while a thread works. With the same seeds a run is exactly repeatable.
"""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Callable, Coroutine
from concurrent.futures import Executor, Future
from typing import Any, ParamSpec, TypeVar

T = TypeVar("T")
P = ParamSpec("P")


class _JumpingSelector(selectors.DefaultSelector):
    """A selector that advances the loop's time instead of waiting."""

    def __init__(self) -> None:
        super().__init__()
        self.time = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        ready = super().select(0)
        if not ready:
            if timeout is None:
                raise RuntimeError(
                    "deadlock in virtual time: got no task that is ready and no timer, expected one of them. "
                    "Every task waits for another one, or for a thread or a socket, which virtual time does not support"
                )
            self.time += max(timeout, 0.0)
        return ready


class VirtualLoop(asyncio.SelectorEventLoop):
    """A loop for coroutines that use no threads and no sockets."""

    def __init__(self) -> None:
        self._jumping = _JumpingSelector()
        super().__init__(self._jumping)

    def time(self) -> float:
        """Virtual time since the start [s]."""
        return self._jumping.time


class VirtualClock:
    """The running loop's time as a :class:`~muro_zenoh.runtime.clock.Clock`.

    Raises:
        RuntimeError: there is no running loop.
    """

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()

    def now(self) -> float:
        """Seconds since 1970, as if the loop had started in November 2023."""
        return 1.7e9 + self._loop.time()


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


def run_virtually(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end in virtual time.

    Args:
        main: the coroutine.

    Returns:
        Its result.

    Raises:
        RuntimeError: a deadlock: no task can continue.
    """
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(main)
