"""A parked robot makes room for one that drives or waits next to it, and goes back when that has gone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from muro_zenoh.geometry import Bounds, State
from muro_zenoh.safety.separation.gates import Gate
from muro_zenoh.safety.separation.guidance import UNHURRIED, Near, is_busy
from muro_zenoh.safety.separation.knowledge import WALL
from muro_zenoh.safety.separation.line import Point
from muro_zenoh.safety.separation.liveness import roomiest

_NEXT_TO: Final = 0.25
"""It makes room for robots that are nearer than the distance to keep and this [m] ..."""
_GONE: Final = 0.45
"""... until they are further than the distance to keep and this [m] ..."""
_LEAST: Final = 4.0
_MOST: Final = 7.0
"""... but for this time at least and at most [s]. Then it goes back, and makes no room for the least time multiplied by
how often it has made room already: robots that are in each other's way would make room in turns for ever. One that is
parked in a passage never refuses: nobody gets by."""
_STEP: Final = 0.4
"""How far it goes [m]."""
_PARKED: Final = 0.8
"""A robot that has been where it wants to be counts as parked up to this far from there [m]."""
_BESIDE: Final = 0.35
"""It keeps out of a passage by this [m]."""


class _Yield(NamedTuple):
    other: str
    spot: Point
    since: float


class Courtesy:
    """Whether one robot makes room now, and where to.

    Args:
        gates: passages: who makes room keeps out of them, and who is parked in one never refuses to.
    """

    def __init__(self, gates: Sequence[Gate] = ()) -> None:
        self._passages = [Near(gate.x, gate.y, 0.0, 0.0, gate.half + _BESIDE, WALL) for gate in gates]
        self._home: Point | None = None
        self._yields: _Yield | None = None
        self._again = -math.inf
        self._times = 0
        self.returns = False
        """Whether the robot goes back to where it was parked."""

    def look(
        self, now: float, state: State, rests: bool, target: Point | None, near: Sequence[Near], inside: Bounds
    ) -> tuple[Point, str] | None:
        """The velocity with which to make room, and for whom; None for a robot that does as it wants.

        Args:
            now: the time [s].
            state: the robot's state.
            rests: whether it is where it wants to be, or as near as it gets.
            target: where it wants to be [m, world]; None for where it is.
            near: the neighbours.
            inside: where its centre may be.
        """
        here = state.x, state.y
        if rests:
            self._home = target or here
        home = self._home
        leaves = not rests if target is None else home is not None and math.dist(home, target) > 0.01
        if home is None or leaves or math.dist(home, here) > _PARKED:
            self._home = self._yields = None
            self._times, self._again = 0, -math.inf
            self.returns = False
            return None
        self.returns = not rests and target is not None
        if self._yields is None and rests and now >= self._again:
            self._yields = self._asked(now, state, near, inside)
            self._times += self._yields is not None
        if self._yields is None:
            return None
        other, spot, since = self._yields
        there = next((one for one in near if one.name == other), None)
        gone = there is None or math.hypot(there.x - state.x, there.y - state.y) > there.keep + _GONE
        if now - since > _MOST or (now - since > _LEAST and gone):
            self._yields, self._again = None, now if self.blocks(home) else now + _LEAST * self._times
            return None
        away = math.dist(here, spot)
        speed = min(UNHURRIED, away) / away if away > 0.05 else 0.0
        return (speed * (spot[0] - here[0]), speed * (spot[1] - here[1])), other

    def blocks(self, place: Point) -> bool:
        """Whether who is parked at a place is in the way of those who go through a passage.

        Args:
            place: the place [m, world].
        """
        return any(math.dist(place, (passage.x, passage.y)) < passage.keep for passage in self._passages)

    def _asked(self, now: float, state: State, near: Sequence[Near], inside: Bounds) -> _Yield | None:
        for other in near:
            dx, dy = state.x - other.x, state.y - other.y
            away = math.hypot(dx, dy)
            if not is_busy(other) or away > other.keep + _NEXT_TO:
                continue
            if dx * math.cos(other.theta) + dy * math.sin(other.theta) < 0.25 * away:
                continue
            ux, uy = roomiest(state, [*near, *self._passages], inside, UNHURRIED, other)
            if (ux, uy) != (0.0, 0.0):
                x, y = inside.nearest(state.x + ux / UNHURRIED * _STEP, state.y + uy / UNHURRIED * _STEP)
                return _Yield(other.name, (x, y), now)
        return None
