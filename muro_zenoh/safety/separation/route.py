"""The way of a robot that drives to a place: round walls, through gates when it is its turn, past standing robots."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

from muro_zenoh.geometry import STILL, Bounds, State, Twist2, wrap_to_pi
from muro_zenoh.safety.separation.gates import Gate, Waits, gate_ahead, gates_between, place_to_wait
from muro_zenoh.safety.separation.guidance import Near, is_busy
from muro_zenoh.safety.separation.knowledge import WALL
from muro_zenoh.safety.separation.line import Point, nearest_on
from muro_zenoh.safety.separation.planner import Planner, Segment
from muro_zenoh.walls import Wall

_STANDS: Final = 1.0
"""A robot that has stood for this time looks for a way round what is near [s] ..."""
_FOLLOWS: Final = 3.0
"""... and follows it for this time [s]."""
_PARKED: Final = 1.0
"""A neighbour that has stood for this time is parked [s]: the way leads round it at once."""
_PLAN_PERIOD: Final = 1.0
"""The way is planned anew after this time [s]."""
_STILL: Final = 0.05
"""A neighbour that is slower stands [m/s]."""
_CLOSE: Final = 0.02
"""So much nearer to a parked neighbour than it should be is no detour [m]."""
_LOOK_AHEAD: Final = 0.5
"""A robot heads for the point of its way that is so far ahead [m], if nothing is between."""
_AT_PLACE: Final = 0.1
"""A robot so near to its place in a queue is there [m]."""
_FACES: Final = 0.3
"""A robot that waits at a gate looks at it within this angle [rad]."""


class Route:
    """The way of one robot.

    Args:
        arena: the floor.
        inside: where the robot's centre may be.
        walls: walls inside the arena.
        keep: what its centre keeps from a wall [m].
    """

    def __init__(self, arena: Bounds, inside: Bounds, walls: Sequence[Wall], keep: float) -> None:
        self._planner = Planner(inside, [Segment(x, y, p - x, q - y, keep) for x, y, p, q in walls])
        self.gates = gates_between(walls, arena, keep)
        """The narrow passages between the walls."""
        self._plan: list[Point] = []
        self._search: Iterator[list[Point] | None] | None = None
        self._plan_again = self._follow_until = -math.inf
        self._gate: Gate | None = None
        self._waits = Waits()
        self._still_since: dict[str, float] = {}
        self.waits = False
        """Whether the robot lets others through a gate now."""
        self.passes = False
        """Whether there is a gate in the robot's way, and it is its turn to go through."""
        self.parked: list[Near] = []
        """The neighbours that are parked: the way leads round them."""

    def toward(
        self,
        now: float,
        here: Point,
        velocity: Point,
        target: Point,
        near: Sequence[Near],
        stood: float,
        gives_way: bool,
        clock: float,
        fleet: Sequence[Near] = (),
    ) -> Point:
        """The preferred velocity on the way to a place.

        Args:
            now: the time [s].
            here: the robot's position [m, world].
            velocity: the desired velocity [m/s], straight toward the place.
            target: the place [m, world].
            near: the neighbours.
            stood: for how long the robot has stood [s].
            gives_way: whether it goes to its place in the queue when it has to let others through a gate first.
            clock: the time that all robots share [s].
            fleet: all other robots, however far.

        Returns:
            The velocity [m/s], no faster than the desired one.
        """
        self.waits = self.passes = False
        self._notice_parked(now, near)
        straight = self._sees(here, target) and stood < _STANDS and now >= self._follow_until
        if straight and not self.gates:
            return velocity
        if straight:
            self._plan, self._search = [here, target], None
        elif now >= self._plan_again:
            slow = [(o.x, o.y, o.keep) for o in near if o.name != WALL and math.hypot(o.vx, o.vy) < _STILL]
            self._search = self._planner.search(here, target, slow)
            self._plan_again = now + _PLAN_PERIOD
            if stood >= _STANDS:
                self._follow_until = now + _FOLLOWS
        if self._search is not None:  # a slice in each step: until it has found, the plan before it counts
            found = next(self._search)
            if found is not None:
                self._plan, self._search = found, None
        speed = math.hypot(*velocity)
        self._gate = gate_ahead(self.gates, [here, *self._plan[1:]]) if self.gates else None
        waits = self._waits.look(now, here, near) if self.gates else ()
        if self._gate is not None:
            place = place_to_wait(self._gate, *here, near, clock, waits, fleet)
            self.passes = place is None
            if place is not None and gives_way:
                self.waits = True
                away = math.dist(place, here)
                return _toward(here, place, min(speed, away)) if away > _AT_PLACE else (0.0, 0.0)
        if straight:
            return velocity
        ahead = (p for p in reversed(self._plan) if math.dist(p, here) <= _LOOK_AHEAD and self._sees(here, p))
        point = next(ahead, None)
        return velocity if point is None or math.dist(point, here) < 0.05 else _toward(here, point, speed)

    def _notice_parked(self, now: float, near: Sequence[Near]) -> None:
        """One that waits turns to and fro, so a neighbour that has stood still for a while is parked."""
        still = [o for o in near if o.name != WALL and math.hypot(o.vx, o.vy) < _STILL and not is_busy(o)]
        self._still_since = {o.name: self._still_since.get(o.name, now) for o in still}
        self.parked = [o for o in still if now - self._still_since[o.name] >= _PARKED]

    def _sees(self, start: Point, end: Point) -> bool:
        """Whether no wall and no parked neighbour is between two positions."""
        x, y = start
        dx, dy = end[0] - x, end[1] - y
        for other in self.parked:
            px, py = nearest_on(x, y, dx, dy, other.x, other.y)
            away = math.hypot(px - other.x, py - other.y)
            if away < other.keep - _CLOSE and away < math.dist(start, (other.x, other.y)) - _CLOSE:
                return False
        return self._planner.sees(start, end)

    @property
    def at_gate(self) -> bool:
        """Whether there is a gate in the robot's way, and near."""
        return self._gate is not None

    def leave(self) -> None:
        """There is no place to drive to any more, or another one: no way to follow, and no turn to wait for."""
        self._gate, self.waits, self.passes, self.parked = None, False, False, []
        self._plan, self._search = [], None
        self._plan_again = self._follow_until = -math.inf

    def face_gate(self, state: State) -> Twist2:
        """A turn on the spot toward the gate in front of which the robot waits; none when it looks that way.

        Args:
            state: its state.
        """
        if self._gate is None:
            return STILL
        alpha = wrap_to_pi(math.atan2(self._gate.y - state.y, self._gate.x - state.x) - state.theta)
        return Twist2(0.0, math.copysign(min(1.0, 2.0 * abs(alpha)), alpha)) if abs(alpha) > _FACES else STILL


def _toward(here: Point, there: Point, speed: float) -> Point:
    away = math.dist(here, there)
    return speed * (there[0] - here[0]) / away, speed * (there[1] - here[1]) / away
