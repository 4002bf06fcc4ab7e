"""Liveness: which way a robot prefers so that a crowd dissolves. Deterministic, the robots told apart by name.

1. A direction that is not free is turned clockwise by the smallest angle that is. All do, so they pass on one side; but
   round one that is parked the shorter way is planned, and kept to.
2. A robot that stands too long prefers the other side for a while, then backs off; from a queue at once, unless it is
   its turn, and before a gate also to where there is less room. How long is too long depends on its place in the order
   of names, so that two that block each other do not do the same at the same time.
3. One that cannot go on turns to and fro where it stands: so the others see that it waits and is not parked.
4. One that is parked where it wants to be makes room for one that waits or comes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from muro_zenoh.geometry import Bounds, State
from muro_zenoh.safety.separation.guidance import Near, time_to

HORIZON: Final = 1.5
"""A direction is free when nothing is met within this time [s]."""
_TURN: Final = math.pi / 12.0
_TURNS: Final = 9
_MOVED: Final = 0.12
"""A robot that has come this far has not stood still [m]."""

_PATIENCE: Final = 2.5
_STAGGER: Final = 0.25
_RANKS: Final = 10
"""How long a robot stands before it tries something else, and how much longer than the one before it in the order of
names [s]; after so many robots it begins anew."""
_QUEUES_FOR: Final = 3.0
"""How long it waits in a queue instead [s]."""
_STILL_QUEUES: Final = 0.5
"""One that has waited in a queue until so recently does so still [s]: whose turn it is may change to and fro."""
_TRIES_FOR: Final = 2.5
"""How long it tries that [s]."""
_GAIN: Final = 0.05
"""So much more room is worth going for [m]."""
_AHEAD: Final = 0.1
"""For a robot that may not stay there has to be so much more room to the side than ahead, and twice as much behind [m]:
one that turns to where there is most at each moment turns to and fro, and never drives."""
_STEP: Final = 0.35
"""How far ahead room is looked for [m]."""
_LEAST_STEP: Final = 0.1
"""A robot that has to go somewhere goes where it gets this far [m]."""


def first_met(x: float, y: float, vx: float, vy: float, near: Sequence[Near]) -> tuple[float, Near | None]:
    """When a robot with a velocity first comes too near to a neighbour, and to which.

    Args:
        x: its position [m, world].
        y: the same.
        vx: its velocity [m/s].
        vy: the same.
        near: the neighbours.

    Returns:
        The time [s] and the neighbour; infinite and None when it meets none.
    """
    first, found = math.inf, None
    for other in near:
        when = time_to(x, y, vx, vy, other, other.keep)
        if when < first:
            first, found = when, other
    return first, found


def free_direction(
    x: float, y: float, vx: float, vy: float, near: Sequence[Near], inside: Bounds, side: float
) -> tuple[float, float]:
    """A velocity turned to one side by the smallest angle at which it is free; else the one that is free longest.

    Args:
        x: the robot's position [m, world].
        y: the same.
        vx: the preferred velocity [m/s].
        vy: the same.
        near: the neighbours.
        inside: where its centre may be.
        side: -1 to turn clockwise, +1 counter-clockwise.
    """
    best, found = -1.0, (vx, vy)
    for k in range(_TURNS):
        c, s = math.cos(k * _TURN), side * math.sin(k * _TURN)
        ux, uy = c * vx - s * vy, s * vx + c * vy
        free, _ = first_met(x, y, ux, uy, near)
        if not inside.holds(x + ux, y + uy):
            free = min(free, 0.5)
        if free >= HORIZON:
            return ux, uy
        if free > best:
            best, found = free, (ux, uy)
    return found


def goes_along(other: Near, vx: float, vy: float) -> bool:
    """Whether a neighbour drives the same way, so that one can follow it.

    Args:
        other: the neighbour.
        vx: the preferred velocity [m/s].
        vy: the same.
    """
    return other.vx * vx + other.vy * vy > 0.3 * math.hypot(vx, vy) * max(0.05, math.hypot(other.vx, other.vy))


def free_speed(x: float, y: float, vx: float, vy: float, near: Sequence[Near]) -> tuple[float, float]:
    """The preferred velocity slowed down until it is free; a quarter of it when it never is.

    Args:
        x: the robot's position [m, world].
        y: the same.
        vx: the preferred velocity [m/s].
        vy: the same.
        near: the neighbours.
    """
    for part in (0.75, 0.5):
        if first_met(x, y, part * vx, part * vy, near)[0] >= HORIZON:
            return part * vx, part * vy
    return 0.25 * vx, 0.25 * vy


class Patience:
    """What a robot does when it does not get on.

    Args:
        rank: its place in the order of names, from 0.
    """

    def __init__(self, rank: int) -> None:
        self._rank = rank % _RANKS
        self.begin_anew()

    def begin_anew(self) -> None:
        """Forget what was: the robot has not stood yet."""
        self._anchor: tuple[float, float] | None = None
        self._since = 0.0
        self._until = -math.inf
        self._tries = 0
        self._waited_at = -math.inf
        self._queued = False  # whether it backs off, or did so last, from a queue
        self.side = -1.0
        """The side to turn to: -1 clockwise."""
        self.retreating = False
        """Whether it has lost patience and backs off, unless :meth:`backs_off` says otherwise."""

    def look(self, now: float, state: State, wants: bool, queues: bool) -> float:
        """Notice whether the robot gets on.

        Args:
            now: the time [s].
            state: its state.
            wants: whether it wants to go anywhere and is not free to.
            queues: whether it waits for its turn at a gate: then it is patient for longer, and backs off at once.

        Returns:
            For how long it has stood [s].
        """
        here = state.x, state.y
        if queues:
            self._waited_at = now
        queues = now - self._waited_at <= _STILL_QUEUES or (self.retreating and self._queued)
        if not wants:
            self._tries = 0
        if not wants or self._anchor is None or math.dist(here, self._anchor) > _MOVED:
            self._anchor, self._since = here, now
        if now >= self._until:
            self.side, self.retreating = -1.0, False
            patience = _QUEUES_FOR if queues else _PATIENCE
            if now - self._since > patience + _STAGGER * self._rank:
                self._tries += 1
                self._since = now
                if self._tries % 2 and not queues:
                    self.side, self._until = 1.0, now + _TRIES_FOR
                else:
                    self.retreating, self._until = True, now + _TRIES_FOR + _STAGGER * self._rank
                    self._queued = queues
        return now - self._since

    def backs_off(self, queues: bool) -> bool:
        """Whether the robot backs off now; one that lost patience in a queue only while it has to wait there.

        Args:
            queues: whether there is a gate in its way, and it is not its turn.
        """
        return self.retreating and (queues or not self._queued)


def roomiest(
    state: State,
    near: Sequence[Near],
    inside: Bounds,
    speed: float,
    away_from: Near | None = None,
    may_stay: bool = True,
) -> tuple[float, float]:
    """The velocity toward the most room [m/s]; zero when there is nowhere to go.

    Args:
        state: the robot's state.
        near: the neighbours.
        inside: where its centre may be.
        speed: how fast [m/s].
        away_from: a neighbour out of whose way to go.
        may_stay: whether the robot stays where it has as much room as elsewhere; not in front of a gate, where it shuts
            in those who come out.
    """
    best, found = -math.inf, (0.0, 0.0)
    if may_stay:
        best = _room(state.x, state.y, near, inside, away_from) + _GAIN
    for k in range(16):
        angle = k * math.pi / 8.0
        c, s = math.cos(angle), math.sin(angle)
        free, _ = first_met(state.x, state.y, speed * c, speed * s, near)
        step = min(_STEP, speed * free)
        room = _room(state.x + step * c, state.y + step * s, near, inside, away_from)
        if not may_stay:
            room -= _AHEAD * (1.0 - math.cos(angle - state.theta))
        if room > best and (may_stay or step >= _LEAST_STEP):
            best, found = room, (speed * c, speed * s)
    return found


def _room(x: float, y: float, near: Sequence[Near], inside: Bounds, away_from: Near | None) -> float:
    room = min(x - inside.x_min, inside.x_max - x, y - inside.y_min, inside.y_max - y, 0.3)
    for other in near:
        room = min(room, math.hypot(other.x - x, other.y - y) - other.keep)
    if away_from is not None:
        # how far from the line that it wants to drive along
        dx, dy = x - away_from.x, y - away_from.y
        c, s = math.cos(away_from.theta), math.sin(away_from.theta)
        along, across = dx * c + dy * s, abs(dy * c - dx * s)
        room += min(across, away_from.keep + 0.05) if along > 0.0 else away_from.keep + 0.05
    return room
