"""The goals of one robot: a list, gone to one after the other, or one that an operator sent in its place."""

from __future__ import annotations

from collections.abc import Sequence

from muro_zenoh.planning.destination import Destination


class Itinerary:
    """Which goal is current, and what comes next.

    Args:
        goals: gone to one after the other.
        pause: how long to stay at a goal before the next one of the list [s].

    Attributes:
        current: the goal now; None between two goals and at the end.
        reached: how many have been reached.
    """

    def __init__(self, goals: Sequence[Destination] = (), pause: float = 0.0) -> None:
        self.current: Destination | None = None
        self.reached = 0
        self._left = list(goals)
        self._pause = pause
        self._next_at = float("-inf")
        self._given_up = ""

    def begin_next(self, now: float) -> bool:
        """Make the next goal of the list the current one when it is due; whether it did.

        Args:
            now: the time [s].
        """
        if self.current is not None or not self._left or now < self._next_at:
            return False
        self.current = self._left.pop(0)
        return True

    def replace(self, goal: Destination) -> None:
        """Go to this goal instead of the current one; it ends the list.

        Args:
            goal: where to go.
        """
        self.current, self._left, self._given_up = goal, [], ""

    def arrive(self, now: float) -> None:
        """The current goal has been reached.

        Args:
            now: the time [s].
        """
        self.current, self._given_up = None, ""
        self.reached += 1
        self._next_at = now + self._pause

    def give_up(self, now: float, reason: str) -> None:
        """The current goal cannot be reached; the next one of the list will be tried.

        Args:
            now: the time [s].
            reason: why.
        """
        if self.current is not None:
            self._given_up = f"goal ({self.current.x:g}, {self.current.y:g}) given up: {reason}"
        self.current = None
        self._next_at = now + self._pause

    @property
    def waiting(self) -> str:
        """Why there is nothing to do."""
        if self._given_up:
            return self._given_up
        if self._left:
            return f"at goal {self.reached}, waiting before the next"
        return "all goals reached" if self.reached else "no goal"
