"""The robots' bases: which of them say that somebody else commands or turns their wheels."""

from __future__ import annotations

import asyncio
from collections.abc import Collection

from muro_zenoh import channels
from muro_zenoh.messages import BaseState
from muro_zenoh.transport import Bus, Received


class BasesTask:
    """Reads the states of all bases.

    Args:
        bus: the bus.
        robots: the names of the robots; strangers' bases are not heard.
        changed: set when another base says so, for the health report.
    """

    def __init__(self, bus: Bus, robots: Collection[str], changed: asyncio.Event) -> None:
        self._now = bus.clock.now
        self._robots = frozenset(robots)
        self._changed = changed
        self._states = bus.every(channels.BASE, "*", depth=256)
        self._wrong: dict[str, Received[BaseState]] = {}

    async def run(self) -> None:
        """Read until cancelled."""
        async for received in self._states:
            name, state = received.name, received.message
            if name not in self._robots:
                continue
            if not state.contested and not state.unruly:
                self._wrong.pop(name, None)
                continue
            if name not in self._wrong:
                self._changed.set()
            self._wrong[name] = received

    def reasons(self) -> list[str]:
        """What is wrong, in words; a base that is silent says nothing any longer."""
        now = self._now()
        return [
            f"two processes command the wheels of {name}"
            if received.message.contested
            else f"the wheels of {name} do not do what they are commanded: is it driven by somebody else?"
            for name, received in self._wrong.items()
            if received.age(now) <= channels.BASE.stale_after
        ]
