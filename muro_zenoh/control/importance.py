"""An importance function on the circle: how often each stretch of it should be visited.

Seed 000, sections 5.2 and 6: "add an importance function to the map so that the TurtleBots would cover a certain part
of the lab more densely".
"""

from __future__ import annotations

import itertools
import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from muro_zenoh.elementwise import Array, Scalar
from muro_zenoh.errors import BehaviourError, ParameterError
from muro_zenoh.geometry import TWO_PI

CELLS = 720
"""Number of cells in the table of an importance: half a degree each."""


@dataclass(frozen=True, slots=True, eq=False)
class Importance:
    """A positive density on the circle with mean 1, piecewise linear between :data:`CELLS` angles.

    Made by :meth:`from_table` or :meth:`from_function`.

    Args:
        values: the density at ``2 pi k / CELLS`` for k = 0 to CELLS inclusive [-], mean 1.
        masses: its integral from angle 0 to there [rad]; 0 first, 2 pi last.
    """

    values: Array
    masses: Array

    @classmethod
    def from_function(cls, weight: Callable[[float], float]) -> Importance:
        """From a function of the angle.

        Args:
            weight: weight at an angle [rad, 0 to 2 pi]; positive, of any scale.

        Raises:
            ParameterError: a weight is not a finite number above 0.
            BehaviourError: the function raised an exception, or returned what is not a number.
        """
        weights = []
        for k in range(CELLS):
            angle = TWO_PI * k / CELLS
            try:
                value = float(weight(angle))
            except (Exception, SystemExit) as error:
                raise BehaviourError(
                    f"importance: got {error!r} at angle {angle:.4f} rad, expected a finite number above 0"
                ) from error
            weights.append(_positive(value, "importance", f" at angle {angle:.4f} rad"))
        return cls._normalised(weights)

    @classmethod
    def from_table(cls, angles: Sequence[float], weights: Sequence[float]) -> Importance:
        """From a table, interpolated linearly and periodically.

        Args:
            angles: angles [rad], each once, in any order and any turn.
            weights: the weight at each angle; positive, of any scale.

        Raises:
            ParameterError: an empty table, lengths that differ, two equal angles, or a weight that is not above 0.
        """
        if not angles or len(angles) != len(weights):
            raise ParameterError(
                "weights", got=f"{len(weights)} for {len(angles)} angles", expected="as many as angles, at least one"
            )
        for angle in angles:
            if not math.isfinite(angle):
                raise ParameterError("angles", got=repr(angle), expected="a finite number [rad]")
        rows = sorted(
            (angle % TWO_PI, _positive(float(w), "weights", f" at angle {angle:g} rad"))
            for angle, w in zip(angles, weights, strict=True)
        )
        for (a, _), (b, _) in itertools.pairwise(rows):
            if b - a < 1e-9:
                raise ParameterError("angles", got=f"{a:.6f} rad twice", expected="each angle once")
        rows = [(rows[-1][0] - TWO_PI, rows[-1][1]), *rows, (rows[0][0] + TWO_PI, rows[0][1])]
        starts = [a for a, _ in rows]

        def weight(angle: float) -> float:
            k = min(bisect_right(starts, angle), len(rows) - 1)
            (a, wa), (b, wb) = rows[k - 1], rows[k]
            return wa + (wb - wa) * (angle - a) / (b - a)

        return cls.from_function(weight)

    @classmethod
    def _normalised(cls, weights: Sequence[float]) -> Importance:
        values = np.array([*weights, weights[0]])
        values /= values[:-1].mean()
        masses = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * (TWO_PI / CELLS))])
        masses *= TWO_PI / masses[-1]
        values.setflags(write=False)
        masses.setflags(write=False)
        return cls(values, masses)

    @property
    def lowest(self) -> float:
        """The minimum density [-]."""
        return float(self.values.min())

    @property
    def highest(self) -> float:
        """The maximum density [-]."""
        return float(self.values.max())

    @property
    def contrast(self) -> float:
        """Maximum over minimum density; the speeds along the circle vary by the same ratio."""
        return self.highest / self.lowest

    def density(self, angle: Scalar) -> Scalar:
        """The density at an angle [-].

        Args:
            angle: angle seen from the centre [rad], any turn.
        """
        place = angle * (CELLS / TWO_PI)
        if isinstance(place, np.ndarray):
            floor = np.floor(place)
            part = place - floor
            k = floor.astype(np.intp) % CELLS
            result: Scalar = self.values[k] + part * (self.values[k + 1] - self.values[k])
            return result
        cell = math.floor(place)
        i = cell % CELLS
        low = self.values.item(i)
        return low + (place - cell) * (self.values.item(i + 1) - low)

    def mass(self, angle: Scalar) -> Scalar:
        """The integral of the density from angle 0 to ``angle`` [rad]; it grows by 2 pi per turn.

        Args:
            angle: angle seen from the centre [rad], any turn.
        """
        place = angle * (CELLS / TWO_PI)
        half = 0.5 * TWO_PI / CELLS
        if isinstance(place, np.ndarray):
            floor = np.floor(place)
            part = place - floor
            whole = floor.astype(np.intp)
            k = whole % CELLS
            low = self.values[k]
            inside = half * part * (2.0 * low + part * (self.values[k + 1] - low))
            result: Scalar = TWO_PI * (whole // CELLS) + self.masses[k] + inside
            return result
        cell = math.floor(place)
        part = place - cell
        i = cell % CELLS
        low = self.values.item(i)
        inside = half * part * (2.0 * low + part * (self.values.item(i + 1) - low))
        return TWO_PI * (cell // CELLS) + self.masses.item(i) + inside


def _positive(value: float, what: str, where: str) -> float:
    if not (math.isfinite(value) and value > 0.0):
        raise ParameterError(what, got=f"{value!r}{where}", expected="a finite number above 0")
    return value
