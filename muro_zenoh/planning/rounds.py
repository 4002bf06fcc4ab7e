"""Rounds of a deployment: all go, all stand for a while, all look where to go next."""

from __future__ import annotations

from typing import NamedTuple


class Round(NamedTuple):
    """Where a round is.

    Args:
        rest_since: since when all robots have stood [s]; None while one moves.
        due: whether all have stood for the hold time: the next round begins now.
    """

    rest_since: float | None = None
    due: bool = False


def next_round(now: float, rest: bool, before: Round, hold_time: float) -> Round:
    """Follow the rounds from one look at the fleet to the next.

    Robots that look at the same snapshots, and tell time by their stamps, begin every round together.

    Args:
        now: the time of this look [s].
        rest: whether all robots stand.
        before: what this function returned at the last look; ``Round()`` at first.
        hold_time: how long all must have stood [s].
    """
    if not rest:
        return Round()
    since = now if before.rest_since is None or before.due else before.rest_since
    return Round(since, now - since >= hold_time)
