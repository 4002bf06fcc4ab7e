"""The floor that robots may use."""

from __future__ import annotations

from typing import NamedTuple


class Bounds(NamedTuple):
    """The floor that robots may use, a rectangle.

    Args:
        x_min: left border [m, world].
        x_max: right border [m, world].
        y_min: lower border [m, world].
        y_max: upper border [m, world].
    """

    x_min: float
    x_max: float
    y_min: float
    y_max: float

    def __str__(self) -> str:
        return f"x {self.x_min:g} to {self.x_max:g}, y {self.y_min:g} to {self.y_max:g} m"

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """The four corners, counter-clockwise from the lower left [m, world]."""
        return (
            (self.x_min, self.y_min),
            (self.x_max, self.y_min),
            (self.x_max, self.y_max),
            (self.x_min, self.y_max),
        )

    def nearest(self, x: float, y: float) -> tuple[float, float]:
        """The place inside nearest to a place [m, world].

        Args:
            x: place [m, world].
            y: place [m, world].
        """
        return min(max(x, self.x_min), self.x_max), min(max(y, self.y_min), self.y_max)

    def shrunk(self, margin: float) -> Bounds:
        """The places that keep ``margin`` [m] from the walls.

        Args:
            margin: distance to keep [m], such as a robot's radius.
        """
        return Bounds(self.x_min + margin, self.x_max - margin, self.y_min + margin, self.y_max - margin)

    def holds(self, x: float, y: float, slack: float = 1e-9) -> bool:
        """Whether a place is inside, border included.

        Args:
            x: place [m, world].
            y: place [m, world].
            slack: how far outside still counts [m]; rounding.
        """
        return (
            self.x_min - slack <= x <= self.x_max + slack and self.y_min - slack <= y <= self.y_max + slack
        )  # comparisons with NaN are false, so NaN is outside
