"""Densities over the arena: how much each place matters to a deployment."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from muro_zenoh.elementwise import Array

Density: TypeAlias = Callable[[Any, Any], Any]
"""How much each place matters: arrays ``x, y`` [m, world] to an array above 0, of any scale."""


@dataclass(frozen=True, slots=True)
class Peaks:
    """A density of Gaussian peaks on a floor, callable as a :data:`Density`.

    ``floor + sum of height exp(-((x - px)^2 + (y - py)^2) / (2 width^2))``

    Args:
        peaks: rows ``x, y, width, height``: place [m, world], width [m] above 0, height not below 0.
        floor: density far from every peak, above 0.

    Raises:
        ValueError: a number outside those ranges.
    """

    peaks: tuple[tuple[float, float, float, float], ...]
    floor: float = 0.05

    def __post_init__(self) -> None:
        if not (math.isfinite(self.floor) and self.floor > 0.0):
            raise ValueError(f"Peaks.floor: got {self.floor!r}, expected a finite number above 0")
        for row in self.peaks:
            if len(row) != 4 or not all(map(math.isfinite, row)) or row[2] <= 0.0 or row[3] < 0.0:
                raise ValueError(f"Peaks.peaks: got {row!r}, expected x, y, width above 0, height not below 0")

    def __call__(self, x: Array, y: Array) -> Array:
        """The density at places, of their shape.

        Args:
            x: places [m, world].
            y: places [m, world].
        """
        total = np.full(np.shape(x), self.floor)
        for px, py, width, height in self.peaks:
            total += height * np.exp(-((x - px) ** 2 + (y - py) ** 2) / (2.0 * width * width))
        return total
