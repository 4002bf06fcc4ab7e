"""Keys of the live view that are orders: the space bar stops, r and then y resume."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Coroutine
from typing import Any, Final

from muro_zenoh import channels
from muro_zenoh.errors import MuroError
from muro_zenoh.orders.stop import resume_robots, send_stop, stop_robots
from muro_zenoh.orders.wording import receipt_lines, reply_line
from muro_zenoh.transport import Bus

HELP: Final = "space: stop every robot   r, then y: resume   Ctrl-C: end the run"

_SURE: Final = 5.0
"""The time within which y has to follow r [s]."""


class Desk:
    """Gives orders to all robots.

    The space bar stops, however often it is pressed and whatever else is under way; only the last one's receipt is
    shown. No key both stops and resumes, and a stop that somebody else has given since r was pressed is not lifted.

    Args:
        bus: the bus.
        say: shows a line to the operator, and logs it.
    """

    def __init__(self, bus: Bus, say: Callable[[str], None]) -> None:
        self._bus = bus
        self._say = say
        self._running: asyncio.Task[None] | None = None
        self._stop_is_sent = False  # until there is a word that it has arrived: a resume would end it
        self._asked = -math.inf
        self._stop_state = bus.latest(channels.STOP)
        self._seen: int | None = None  # the revision of the stop that there was when r was pressed

    def press(self, key: str) -> None:
        """Take a key; all others mean nothing.

        Args:
            key: the character.
        """
        now = self._bus.clock.now()
        sure = key == "y" and now - self._asked <= _SURE
        self._asked = now if key == "r" else -math.inf
        if key == " ":
            send_stop(self._bus, ())  # now: the run may end before the task below begins
            self._stop_is_sent = True
            self._begin(self._stop(), "stop every robot")
        elif key == "r":
            known = self._stop_state.get()
            self._seen = known.message.revision if known is not None else None
            self._say(f"resume every robot? Press y within {_SURE:g} s; any other key: no")
        elif sure and self._stop_is_sent:
            self._say("not resumed: the stop is still sent, and there is no word yet that it arrived; press r again")
        elif sure:
            self._begin(self._resume(), "resume every robot")

    def close(self) -> None:
        """Wait for no receipt any longer; orders that were sent stay."""
        if self._running is not None:
            self._running.cancel()

    def _begin(self, order: Coroutine[Any, Any, None], name: str) -> None:
        self.close()
        self._running = asyncio.create_task(order, name=name)

    async def _stop(self) -> None:
        try:
            result = await stop_robots(self._bus, (), self._note_arrival)
        except Exception:
            self._note_arrival()
            raise
        self._note_arrival()  # or it is sent no longer, unlike one that is cancelled by the next press
        self._say("\n".join(receipt_lines(result)))

    def _note_arrival(self) -> None:
        self._stop_is_sent = False

    async def _resume(self) -> None:
        try:
            result = await resume_robots(self._bus, (), self._seen)
        except MuroError as error:
            self._say(str(error))
            return
        still = f"; still stopped: {' '.join(result.still_stopped)}" if result.still_stopped else ""
        self._say(f"resume: {reply_line(result.reply)}{still}")
