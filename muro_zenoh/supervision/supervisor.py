"""Starts, watches, restarts and stops child processes; they exit with their parent.

A child prints ``READY ...`` on its standard output when it is ready, logs to its standard error, exits on SIGTERM, and
exits when its lifeline (:data:`~muro_zenoh.runtime.process.LIFELINE`) closes. Only the parent holds the lifeline's
writing end, so it closes whenever the parent ends, for whatever reason.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from muro_zenoh.errors import SupervisionError
from muro_zenoh.runtime.process import WRONG_USE
from muro_zenoh.supervision.child import Child, ChildSpec, exit_description


@dataclass(frozen=True, slots=True)
class RestartPolicy:
    """When to restart a child, and when to give up.

    Attributes:
        first_delay: delay before the first restart; it doubles with each death within ``window`` [s].
        max_restarts: maximum number of restarts within ``window``; at the next death the child is given up.
        window: deaths longer ago than this are not counted [s].
        start_timeout: a child must be ready within this time [s].
        stop_timeout: a child must exit within this time after SIGTERM, otherwise it is killed [s].
    """

    first_delay: float = 0.5
    max_restarts: int = 5
    window: float = 60.0
    start_timeout: float = 15.0
    stop_timeout: float = 2.0


class Supervisor:
    """Restarts children that die while its ``async with`` block runs, and stops all of them at its end.

    Args:
        logs: the folder for one log per child.
        notify: called with a line for the operator whenever a child dies or is restarted.
        policy: when to restart and when to give up.
    """

    def __init__(self, logs: Path, notify: Callable[[str], None], policy: RestartPolicy | None = None) -> None:
        self._logs = logs
        self._notify = notify
        self._policy = policy or RestartPolicy()
        self._groups: list[list[tuple[Child, asyncio.Task[None]]]] = []
        self._failed: asyncio.Future[SupervisionError] = asyncio.get_running_loop().create_future()
        # Neither end is inherited unless it is passed explicitly, and the writing end never is.
        self._lifeline, self._held = os.pipe()

    @property
    def children(self) -> list[Child]:
        """All children, in the order of their start."""
        return [child for group in self._groups for child, _ in group]

    async def start(self, specs: Sequence[ChildSpec]) -> list[Child]:
        """Start children concurrently and wait until all are ready. Children started first are stopped last.

        Args:
            specs: the processes to start.

        Raises:
            SupervisionError: one died before it was ready for the first time, or another child was given up.
        """
        group = []
        for spec in specs:
            child = Child(spec, self._logs / f"{spec.name}.log", self._lifeline)
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
                self._failed = asyncio.get_running_loop().create_future()  # for the next attempt
            raise
        finally:
            all_ready.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await all_ready
        return [child for child, _ in group]

    async def failure(self) -> SupervisionError:
        """Wait until a child is given up; return the reason."""
        return await asyncio.shield(self._failed)

    async def close(self) -> None:
        """Stop every child, in reverse order of start: SIGTERM, then SIGKILL after the timeout."""
        groups, self._groups = self._groups, []
        try:
            for group in reversed(groups):
                await self._end(group)
        finally:
            for group in groups:
                for child, _ in group:
                    child.kill()
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
        policy = self._policy
        deaths: list[float] = []
        while True:
            late = asyncio.get_running_loop().call_later(policy.start_timeout, self._on_late, child, child.restarts)
            try:
                code, last_lines = await child.run()
            finally:
                late.cancel()
            if child.stopping:
                return
            now = time.monotonic()
            deaths = [t for t in deaths if now - t < policy.window] + [now]
            name = child.spec.name
            self._notify(
                "\n".join([f"{name} {exit_description(code)}. Its last lines:", *(f"  {line}" for line in last_lines)])
            )
            if not child.was_ready:
                raise SupervisionError(f"{name} {exit_description(code)} before it was ready; see {child.log}")
            if code == WRONG_USE:
                raise SupervisionError(f"{name} refused its settings; see {child.log}")
            if len(deaths) > policy.max_restarts:
                raise SupervisionError(
                    f"{name} died {len(deaths)} times within {policy.window:g} s, "
                    f"expected at most {policy.max_restarts}: given up; see {child.log}"
                )
            delay = policy.first_delay * 2.0 ** (len(deaths) - 1)
            if child.may_restart.is_set():
                self._notify(f"{name} restarts in {delay:g} s")
            await asyncio.sleep(delay)
            await child.may_restart.wait()
            child.restarts += 1

    def _on_late(self, child: Child, run: int) -> None:
        if child.restarts == run and not child.ready.is_set():
            self._notify(f"{child.spec.name} was not ready within {self._policy.start_timeout:g} s: killed")
            child.kill()

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
            child.stopping = True
            if child.pid is None:
                task.cancel()  # between two runs
            else:
                child.terminate()
                task.add_done_callback(_retrieve)
        if not tasks:  # all that was wanted was running already
            return
        _, pending = await asyncio.wait(tasks, timeout=self._policy.stop_timeout)
        for child, task in group:
            if task in pending:
                self._notify(f"{child.spec.name} did not exit within {self._policy.stop_timeout:g} s: killed")
                child.kill()
        if pending:
            await asyncio.wait(pending, timeout=1.0)
        for task in pending:
            task.cancel()


def _retrieve(task: asyncio.Task[None]) -> None:
    if not task.cancelled():
        task.exception()  # reported already
