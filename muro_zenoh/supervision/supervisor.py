"""Child processes, kept alive: started, watched, started again, and ended with their parent.

A child prints ``READY ...`` on its standard output when it is up, logs to its standard error, leaves on SIGTERM, and
leaves when its lifeline (:data:`~muro_zenoh.runtime.process.LIFELINE`) ends. Only the parent holds the lifeline's
writing end, so it ends however the parent does.
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
from muro_zenoh.supervision.child import Child, ChildSpec, how_it_ended

__all__ = ["Child", "ChildSpec", "Patience", "Supervisor"]


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
        patience = self._patience
        deaths: list[float] = []
        while True:
            late = asyncio.get_running_loop().call_later(patience.ready, self._on_late, child, child.restarts)
            try:
                code, last_lines = await child.live()
            finally:
                late.cancel()
            if child.leaving:
                return
            now = time.monotonic()
            deaths = [t for t in deaths if now - t < patience.window] + [now]
            name = child.spec.name
            self._tell(
                "\n".join([f"{name} {how_it_ended(code)}. Its last lines:", *(f"  {line}" for line in last_lines)])
            )
            if not child.was_ready:
                raise SupervisionError(f"{name} {how_it_ended(code)} before it was ready; see {child.log}")
            if code == WRONG_USE:
                raise SupervisionError(f"{name} refused its settings; see {child.log}")
            if len(deaths) > patience.most:
                raise SupervisionError(
                    f"{name} died {len(deaths)} times within {patience.window:g} s, "
                    f"expected at most {patience.most}: given up; see {child.log}"
                )
            wait = patience.first * 2.0 ** (len(deaths) - 1)
            self._tell(f"{name} starts again in {wait:g} s")
            await asyncio.sleep(wait)
            child.restarts += 1

    def _on_late(self, child: Child, life: int) -> None:
        if child.restarts == life and not child.ready.is_set():
            self._tell(f"{child.spec.name} was not ready within {self._patience.ready:g} s: killed")
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
            child.leaving = True
            if child.pid is None:
                task.cancel()  # between two lives
            else:
                child.terminate()
                task.add_done_callback(_retrieve)
        _, pending = await asyncio.wait(tasks, timeout=self._patience.leave)
        for child, task in group:
            if task in pending:
                self._tell(f"{child.spec.name} did not leave within {self._patience.leave:g} s: killed")
                child.kill()
        if pending:
            await asyncio.wait(pending, timeout=1.0)
        for task in pending:
            task.cancel()


def _retrieve(task: asyncio.Task[None]) -> None:
    if not task.cancelled():
        task.exception()  # told already
