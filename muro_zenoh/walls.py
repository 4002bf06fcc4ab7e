"""Walls inside the arena: straight, and of no thickness."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from muro_zenoh import elementwise
from muro_zenoh.errors import ParameterError
from muro_zenoh.geometry import Bounds


class Wall(NamedTuple):
    """A wall, from (``x``, ``y``) to (``x_end``, ``y_end``) [m, world]. Its ends are different points."""

    x: float
    y: float
    x_end: float
    y_end: float

    def __str__(self) -> str:
        return f"the wall from ({self.x:g}, {self.y:g}) to ({self.x_end:g}, {self.y_end:g})"

    def nearest(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Its point that is nearest to a position [m, world]; floats, or arrays of them.

        Args:
            x: position [m, world].
            y: position [m, world].
        """
        dx, dy = self.x_end - self.x, self.y_end - self.y
        part = ((x - self.x) * dx + (y - self.y) * dy) / (dx * dx + dy * dy)
        part = elementwise.of(part).clip(part, 0.0, 1.0)
        return self.x + part * dx, self.y + part * dy

    def distance(self, x: Any, y: Any) -> Any:
        """Its distance from a position [m]; of floats, or of arrays of them.

        Args:
            x: position [m, world].
            y: position [m, world].
        """
        near_x, near_y = self.nearest(x, y)
        dx, dy = near_x - x, near_y - y
        return elementwise.of(dx).hypot(dx, dy)


def edges(arena: Bounds) -> tuple[Wall, ...]:
    """The walls around an arena.

    Args:
        arena: the floor; not an empty one.
    """
    corners = arena.corners
    return tuple(Wall(*one, *other) for one, other in zip(corners, (*corners[1:], corners[0]), strict=True))


def require_clear(what: str, x: float, y: float, walls: Sequence[Wall], margin: float) -> None:
    """Refuse a place at which a robot would touch a wall.

    Args:
        what: names the place in the error.
        x: the place [m, world].
        y: the place [m, world].
        walls: the walls inside the arena.
        margin: distance that the robot's centre keeps from a wall [m].

    Raises:
        ParameterError: the place is too near a wall.
    """
    for wall in walls:
        away = wall.distance(x, y)
        if away < margin - 1e-9:
            raise ParameterError(
                what,
                got=f"({x:g}, {y:g}), {away:.3f} m from {wall}",
                expected=f"at least {margin:g} m from every wall",
                hint="Choose a place farther from it.",
            )
