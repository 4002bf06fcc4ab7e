"""What can be wrong with a link of the in-memory network: delays, losses, cuts, each on its way in or out."""

from __future__ import annotations

import asyncio
import contextvars
import random
from collections.abc import Callable
from dataclasses import dataclass, field

Deliver = Callable[[], None]


@dataclass(slots=True, eq=False)
class Passage:
    """One message on one way.

    Attributes:
        deliver: hands it over at the end of the way.
        due: when it arrives, if nothing holds it back [s, loop].
        reliable: whether the middleware repeats it until it has arrived, so that only a cut loses it.
        lost: whether it never arrives.
        held_back: by how much it is late besides, so that others overtake it [s].
        copies: how much later it arrives again [s].
    """

    deliver: Deliver
    due: float
    reliable: bool
    lost: bool = False
    held_back: float = 0.0
    copies: list[float] = field(default_factory=list)


class Trouble:
    """Something wrong with a way.

    Attributes:
        count: messages that it has affected.
        silences: whether nothing passes, so that the link's lease runs out.
    """

    silences = False

    def __init__(self) -> None:
        self.count = 0

    def affect(self, passage: Passage) -> None:
        """Change what becomes of a message.

        Args:
            passage: the message.
        """


class Delay(Trouble):
    """Later by ``delay`` [s], and by a random time up to ``jitter`` [s]; in order."""

    def __init__(self, rng: random.Random, delay: float, jitter: float = 0.0) -> None:
        super().__init__()
        self._rng, self._delay, self._jitter = rng, delay, jitter

    def affect(self, passage: Passage) -> None:
        passage.due += self._delay + (self._jitter * self._rng.random() if self._jitter else 0.0)
        self.count += 1


class _Sometimes(Trouble):
    """Affects a ``fraction`` of the messages."""

    def __init__(self, rng: random.Random, fraction: float, delay: float = 0.0) -> None:
        super().__init__()
        self._rng, self._fraction, self._delay = rng, fraction, delay

    def affect(self, passage: Passage) -> None:
        if not passage.reliable and self._rng.random() < self._fraction:
            self.count += 1
            self._hit(passage)

    def _hit(self, passage: Passage) -> None:
        """Change what becomes of an affected message."""


class Loss(_Sometimes):
    """A fraction is lost."""

    def _hit(self, passage: Passage) -> None:
        passage.lost = True


class Duplication(_Sometimes):
    """A fraction arrives twice, the second time ``delay`` [s] later."""

    def _hit(self, passage: Passage) -> None:
        passage.copies.append(self._delay)


class Reordering(_Sometimes):
    """A fraction is held back by ``delay`` [s], and overtaken."""

    def _hit(self, passage: Passage) -> None:
        passage.held_back += self._delay


class Cut(Trouble):
    """Nothing passes, and what is under way is lost."""

    silences = True

    def affect(self, passage: Passage) -> None:
        passage.lost = True
        self.count += 1


class Stall(Trouble):
    """Nothing passes; at the end everything arrives at once."""

    silences = True


class Way:
    """One direction of a link.

    Args:
        changed: called when it has become calm, or is so no more.

    Attributes:
        calm: whether a message passes at once; what uses it then need not ask it.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self.calm = True
        self._changed = changed
        self._troubles: list[Trouble] = []
        self._last = 0.0  # when the newest message that is in order arrives
        self._underway: dict[Passage, None] = {}
        self._held: list[Passage] = []
        self._outside = contextvars.Context()  # what is under way belongs to no process

    @property
    def silent(self) -> bool:
        """Whether nothing passes."""
        return any(trouble.silences for trouble in self._troubles)

    def begin(self, trouble: Trouble) -> None:
        """Have a trouble from now on.

        Args:
            trouble: which.
        """
        self._troubles.append(trouble)
        if isinstance(trouble, Cut):
            trouble.count += len(self._underway) + len(self._held)
            self._underway.clear()
            self._held.clear()
        self._settle()

    def end(self, trouble: Trouble) -> None:
        """Have a trouble no more.

        Args:
            trouble: which.
        """
        self._troubles.remove(trouble)
        if not self._stalls():
            held, self._held = self._held, []
            for passage in held:
                passage.deliver()
        self._settle()

    def send(self, deliver: Deliver, reliable: bool = False) -> None:
        """Send a message.

        Args:
            deliver: hands it over at the end of the way.
            reliable: whether it is repeated until it has arrived.
        """
        if self.calm:
            deliver()
            return
        now = asyncio.get_running_loop().time()
        passage = Passage(deliver, now, reliable)
        for trouble in self._troubles:
            trouble.affect(passage)
        if passage.lost:
            return
        self._last = passage.due = max(passage.due, self._last)
        for late in (0.0, *passage.copies):
            self._dispatch(Passage(deliver, passage.due + passage.held_back + late, reliable), now)

    def _dispatch(self, passage: Passage, now: float) -> None:
        if passage.due <= now:
            self._arrive(passage)
            return
        self._underway[passage] = None
        asyncio.get_running_loop().call_at(passage.due, self._land, passage, context=self._outside)

    def _land(self, passage: Passage) -> None:
        if passage in self._underway:  # else it was cut off
            del self._underway[passage]
            self._arrive(passage)
            self._settle()

    def _arrive(self, passage: Passage) -> None:
        stalls = self._stalls()
        if stalls:
            self._held.append(passage)
            for stall in stalls:
                stall.count += 1
        else:
            passage.deliver()

    def _stalls(self) -> list[Trouble]:
        return [trouble for trouble in self._troubles if isinstance(trouble, Stall)]

    def _settle(self) -> None:
        """Behind what is still under way a message does not pass at once."""
        calm = not self._troubles and not self._underway
        if calm is not self.calm:
            self.calm = calm
            self._changed()
