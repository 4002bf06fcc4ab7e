"""Rows of a benchmark: numbers as JSON and tables have them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


def quantile(values: ArrayLike, q: float) -> float | None:
    """The least value that a share ``q`` of the values does not exceed; None when that one never came.

    Args:
        values: infinite where something never happened.
        q: 0 to 1.
    """
    value = float(np.quantile(np.asarray(values, dtype=float), q, method="higher"))
    return round(value, 4) if math.isfinite(value) else None


def cell(value: float | None) -> str:
    """A number in a table, eight wide."""
    return f"{'never' if value is None else format(value, '.3f'):>8}"


def write(file: Path | None, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as JSON, where a file is given.

    Args:
        file: which.
        rows: one mapping per line of the table.
    """
    if file is not None:
        file.write_text(json.dumps(list(rows), indent=2) + "\n", encoding="utf-8")
