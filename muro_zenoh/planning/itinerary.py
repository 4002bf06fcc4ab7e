"""The goals of one robot: a list, visited in order, or one goal from an operator that replaces it."""

from __future__ import annotations

from collections.abc import Sequence

from muro_zenoh.planning.destination import Destination


class Itinerary:
    """Which goal is current, and what comes next.

    Args:
        goals: the goals, visited in order.
        pause: how long to stay at a goal before the next one of the list [s].

    Attributes:
        current: the goal now; None between two goals and at the end.
        reached: how many have been reached.
        given_up: which goal was given up last, and why; empty since one was reached or ordered.
    """

    def __init__(self, goals: Sequence[Destination] = (), pause: float = 0.0) -> None:
        self.current: Destination | None = None
        self.reached = 0
        self._left = list(goals)
        self._pause = pause
        self._next_at = float("-inf")
        self.given_up = ""

    def begin_next(self, now: float) -> bool:
        """Make the next goal of the list the current one when it is due; True when it did.

        Args:
            now: the time [s].
        """
        if self.current is not None or not self._left or now < self._next_at:
            return False
        self.current = self._left.pop(0)
        return True

    def replace(self, goal: Destination) -> None:
        """Replace the current goal, and drop the rest of the list.

        Args:
            goal: the new goal.
        """
        self.current, self._left, self.given_up = goal, [], ""

    def arrive(self, now: float) -> None:
        """Mark the current goal as reached.

        Args:
            now: the time [s].
        """
        self.current, self.given_up = None, ""
        self.reached += 1
        self._next_at = now + self._pause

    def give_up(self, now: float, reason: str) -> None:
        """Skip the current goal because it cannot be reached; the next one of the list follows.

        Args:
            now: the time [s].
            reason: why.
        """
        if self.current is not None:
            self.given_up = f"goal ({self.current.x:g}, {self.current.y:g}) given up: {reason}"
        self.current = None
        self._next_at = now + self._pause

    @property
    def waiting(self) -> str:
        """Why there is no current goal."""
        if self.given_up:
            return self.given_up
        if self._left:
            return f"at goal {self.reached}, pausing before the next"
        return "all goals reached" if self.reached else "no goal"
