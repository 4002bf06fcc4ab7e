"""The robots' bases: which of them say that somebody else commands or turns their wheels."""

from __future__ import annotations

import asyncio

from muro_zenoh import channels
from muro_zenoh.transport import Bus


class BasesTask:
    """Reads the states of all bases.

    Args:
        bus: the bus.
        changed: set when another base says so, for the health report.

    Attributes:
        reasons: what is wrong, in words, by the robot's name.
    """

    def __init__(self, bus: Bus, changed: asyncio.Event) -> None:
        self.reasons: dict[str, str] = {}
        self._changed = changed
        self._states = bus.every(channels.BASE, "*", depth=256)

    async def run(self) -> None:
        """Read until cancelled."""
        async for received in self._states:
            name, state = received.name, received.message
            if not state.contested and not state.unruly:
                self.reasons.pop(name, None)
                continue
            if name not in self.reasons:
                self._changed.set()
            self.reasons[name] = (
                f"two processes command the wheels of {name}"
                if state.contested
                else f"the wheels of {name} do not do what they are commanded: is it driven by somebody else?"
            )
