"""Densities over the arena: the importance of each point for a deployment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from muro_zenoh.elementwise import Array
from muro_zenoh.errors import ParameterError
from muro_zenoh.quantities import Number, Positive, check_quantities

Density: TypeAlias = Callable[[Any, Any], Any]
"""The importance of each point: arrays ``x, y`` [m, world] to an array above 0, of any scale."""


@dataclass(frozen=True, slots=True)
class Peaks:
    """A density of Gaussian peaks on a floor, callable as a :data:`Density`.

    ``floor + sum of height exp(-((x - px)^2 + (y - py)^2) / (2 width^2))``

    Args:
        peaks: rows ``x, y, width, height``: position [m, world], width [m] above 0, height not below 0.
        floor: density far from every peak.

    Raises:
        ParameterError: a number outside those ranges, or a row of another length.
    """

    peaks: tuple[tuple[Number, ...], ...]
    floor: Positive = 0.05

    def __post_init__(self) -> None:
        check_quantities(self)
        for k, row in enumerate(self.peaks):
            if len(row) != 4 or row[2] <= 0.0 or row[3] < 0.0:
                raise ParameterError(
                    f"peaks[{k}]", got=str(list(row)), expected="x, y, width above 0, height at least 0 [m]"
                )

    def __call__(self, x: Array, y: Array) -> Array:
        """The density at points, of their shape.

        Args:
            x: positions [m, world].
            y: positions [m, world].
        """
        total = np.full(np.shape(x), self.floor)
        for px, py, width, height in self.peaks:
            total += height * np.exp(-((x - px) ** 2 + (y - py) ** 2) / (2.0 * width * width))
        return total
