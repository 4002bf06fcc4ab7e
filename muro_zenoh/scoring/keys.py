"""Values of a score sheet by their keys, as ``docs/scoresheet.md`` lists them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from muro_zenoh.config.checks import Bound
from muro_zenoh.scoring.rows import definitions
from muro_zenoh.scoring.sheet import ScoreSheet

UNITS: Final[Mapping[str, str]] = {row.key: row.unit for row in definitions(ScoreSheet)}
"""The unit of every key."""


def worst(sheet: ScoreSheet, key: str, bound: Bound) -> float | None:
    """The value of a key; of one such as ``fix_rate_hz.<robot>`` the worst robot's. None while any is unknown.

    Args:
        sheet: the score sheet.
        key: the key.
        bound: on which side of a limit a value should be.
    """
    values = list(_values(sheet, key))
    known = [value for value in values if value is not None]
    if not known or len(known) < len(values):
        return None
    return max(known) if bound is Bound.AT_MOST else min(known)


def total(sheet: ScoreSheet, key: str) -> float | None:
    """The sum of the known values of a key such as ``processes.<process>.cpu_percent``; None when none is known.

    Args:
        sheet: the score sheet.
        key: the key.
    """
    known = [value for value in _values(sheet, key) if value is not None]
    return sum(known) if known else None


def _values(sheet: ScoreSheet, key: str) -> Iterator[float | None]:
    return _steps(sheet, key.split("."))


def _steps(value: Any, steps: list[str]) -> Iterator[float | None]:
    if not steps:
        yield value
    elif isinstance(value, Mapping):
        for inner in value.values():
            yield from _steps(inner, steps[1:])
    else:
        yield from _steps(getattr(value, steps[0]), steps[1:])
