"""A process of a fleet in memory: its tasks, its clock, its link; it can be killed, frozen and started anew."""

from __future__ import annotations

import asyncio
import contextvars
import random
from collections.abc import Callable, Coroutine, Iterable
from typing import Any

from muro_zenoh.channels import Role
from muro_zenoh.runtime.virtual_time import VirtualClock, VirtualLoop, VirtualProcess
from muro_zenoh.transport import Bus, MemoryNetwork, draw_epoch, make_bus
from muro_zenoh.transport.memory_faults import Trouble
from muro_zenoh.transport.memory_link import MemoryLink, Witness

Main = Callable[[Bus], Coroutine[Any, Any, None]]
"""Puts a process together on its bus, and returns what it runs."""


class Process:
    """One process.

    Args:
        network: what it is connected to.
        name: its name, as a fault's target.
        main: puts it together at each start.
        roles: what it is on the bus.
        computers: where it runs.
        rng: draws its epochs.
        witnesses: what looks at the messages that reach it, by key expression.

    Attributes:
        name: its name.
        clock: its clock.
        task: what it runs; None before the first start.
        bus: its bus, from the first start on.
        held_down: by how many faults; nothing starts it meanwhile.
        ended: called with an exception that ended it, or None, when it has ended by itself.
        killed: called when it is killed, before anything of it runs again.
    """

    bus: Bus

    def __init__(
        self,
        network: MemoryNetwork,
        name: str,
        main: Main,
        *,
        roles: Iterable[Role],
        computers: Iterable[str],
        rng: random.Random,
        witnesses: dict[str, Witness] | None = None,
    ) -> None:
        self.name = name
        self.clock = VirtualClock()
        self.task: asyncio.Task[None] | None = None
        self.ended: Callable[[BaseException | None], None] | None = None
        self.killed: Callable[[], None] = lambda: None
        self._network = network
        self._main = main
        self._roles = tuple(roles)
        self._computers = tuple(computers)
        self._rng = rng
        self._witnesses = witnesses or {}
        self._troubles: list[tuple[Trouble, str]] = []
        self._tasks: VirtualProcess | None = None
        self._link: MemoryLink | None = None
        self._leaving = False
        self.held_down = 0

    @property
    def running(self) -> bool:
        """Whether it is there, frozen or not."""
        return self.task is not None and not self.task.done() and self._link is not None and not self._link.closed

    @property
    def frozen(self) -> bool:
        """Whether it does not run for now."""
        return self._tasks is not None and self._tasks.frozen

    def start(self) -> asyncio.Task[None]:
        """Start it.

        Returns:
            What it runs.
        """
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualLoop)
        self._leaving = False
        self._tasks = VirtualProcess(loop, self.name)
        self.bus, coroutine = self._tasks.run(self._put_together)
        self.task = self._tasks.create_task(_live(self.bus, coroutine), name=self.name)
        self.task.add_done_callback(self._note_end)
        return self.task

    def start_again(self) -> None:
        """Start it anew, as a supervisor does: unless it is there, or a fault holds it down; one that does not come up
        has ended."""
        if self.running or self.held_down:
            return
        try:
            self.start()
        except Exception as error:
            if self.ended is not None:
                self.ended(error)

    def start_after_end(self, pause: float = 0.0) -> None:
        """Start it anew when it has ended.

        Args:
            pause: how long after that [s].
        """

        def wait(task: asyncio.Task[None] | None = None) -> None:
            asyncio.get_running_loop().call_later(pause, self.start_again, context=contextvars.Context())

        if self.task is not None and not self.task.done():
            self.task.add_done_callback(wait, context=contextvars.Context())
        else:
            wait()

    def _put_together(self) -> tuple[Bus, Coroutine[Any, Any, None]]:
        self._link = self._network.link(*self._computers, witnesses=self._witnesses)
        for trouble, direction in self._troubles:
            self._link.begin(trouble, direction)
        bus = make_bus(self._link, roles=self._roles, clock=self.clock, epoch=draw_epoch(self._rng))
        return bus, self._main(bus)

    def _note_end(self, task: asyncio.Task[None]) -> None:
        if self._leaving or task is not self.task or self.ended is None:
            return
        self.ended(None if task.cancelled() else task.exception())

    def end(self) -> None:
        """Ask it to end, as by SIGTERM; its task is done when it has."""
        self._leaving = True
        if self.task is not None:
            self.task.cancel()

    def end_for_good(self) -> None:
        """The same, and nothing starts it anew."""
        self.held_down += 1
        self.thaw()
        self.end()

    def kill(self) -> None:
        """End it as by SIGKILL: what its tasks still do when they are cancelled reaches nobody."""
        if self.running and self._link is not None:
            self._link.leave()
            self.killed()
        self.end()
        if self._tasks is not None and self._tasks.frozen:
            self._tasks.thaw()

    def freeze(self) -> None:
        """Stop it, as by SIGSTOP."""
        if self.running and self._tasks is not None and self._link is not None:
            self._tasks.freeze()
            self._link.freeze()

    def thaw(self) -> None:
        """Let it go on, as by SIGCONT."""
        if not self.frozen or self._tasks is None or self._link is None:
            return
        self._tasks.thaw()
        # The threads that take messages wake together with the loop: either may be first.
        link = self._link
        asyncio.get_running_loop().call_soon(self._take_backlog, link, context=contextvars.Context())

    def _take_backlog(self, link: MemoryLink) -> None:
        if not self.frozen or link is not self._link:
            link.thaw()

    def begin(self, trouble: Trouble, direction: str) -> None:
        """Its link has a trouble from now on, also after a new start.

        Args:
            trouble: which.
            direction: ``in``, ``out`` or ``both``.
        """
        self._troubles.append((trouble, direction))
        if self._link is not None:
            self._link.begin(trouble, direction)

    def cease(self, trouble: Trouble, direction: str) -> None:
        """Its link has a trouble no more.

        Args:
            trouble: which.
            direction: ``in``, ``out`` or ``both``.
        """
        self._troubles.remove((trouble, direction))
        if self._link is not None:
            self._link.end(trouble, direction)


async def _live(bus: Bus, coroutine: Coroutine[Any, Any, None]) -> None:
    async with bus:
        await coroutine
