"""``[[wall]]`` rows: the walls inside the arena."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from muro_zenoh.config.schema import Section
from muro_zenoh.errors import ParameterError
from muro_zenoh.quantities import LEAST, Coordinate
from muro_zenoh.walls import Wall

Point = Annotated[tuple[Coordinate, ...], Meta(min_length=2, max_length=2)]


class WallRow(Section, frozen=True, kw_only=True):
    """A straight wall inside the arena. No robot drives through it; a doorway is a gap between two of them.

    Attributes:
        start: where it begins: x, y [m, world].
        end: where it ends: x, y [m, world].

    Raises:
        ParameterError: a number that is not finite, or a wall of no length.
    """

    start: Point
    end: Point

    def __post_init__(self) -> None:
        Section.__post_init__(self)
        if max(abs(a - b) for a, b in zip(self.start, self.end, strict=True)) < LEAST:
            x, y = self.end
            raise ParameterError("end", got=f"({x:g}, {y:g}), where it starts", expected="another place than start")

    @property
    def wall(self) -> Wall:
        """The wall."""
        return Wall(*self.start, *self.end)
