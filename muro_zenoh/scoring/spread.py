"""Distributions of values as a few percentiles, for a score sheet. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from muro_zenoh.scoring.rows import Row, Table


def percentile(values: Sequence[float], percent: float) -> float | None:
    """A percentile, linear between the two nearest ranks; None without values.

    Args:
        values: in any order.
        percent: in [0, 100].
    """
    return float(np.percentile(values, percent)) if values else None


@dataclass(frozen=True, slots=True)
class ErrorSpread(Table):
    """Distribution of errors."""

    p50: Annotated[float | None, Row("median")]
    p95: Annotated[float | None, Row("95th percentile")]
    max: Annotated[float | None, Row("largest")]

    @classmethod
    def of(cls, values: Sequence[float]) -> ErrorSpread:
        """The distribution of errors; all None without values.

        Args:
            values: in any order.
        """
        return cls(percentile(values, 50), percentile(values, 95), max(values, default=None))


@dataclass(frozen=True, slots=True)
class DelaySpread(Table):
    """Distribution of delays."""

    p50: Annotated[float | None, Row("median")]
    p99: Annotated[float | None, Row("99th percentile")]

    @classmethod
    def of_seconds(cls, values: Sequence[float]) -> DelaySpread:
        """The distribution of delays in milliseconds; all None without values.

        Args:
            values: in any order [s].
        """
        milliseconds = [1e3 * value for value in values]
        return cls(percentile(milliseconds, 50), percentile(milliseconds, 99))
