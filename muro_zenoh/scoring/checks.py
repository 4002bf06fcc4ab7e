"""Whether a run meets the checks of its scenario. They are declared in :mod:`muro_zenoh.config.checks`."""

from __future__ import annotations

from typing import Annotated, Final, NamedTuple, get_args, get_origin, get_type_hints

from muro_zenoh.config.checks import Bound, Check, Checks
from muro_zenoh.quantities import quantities
from muro_zenoh.scoring.keys import UNITS, worst
from muro_zenoh.scoring.sheet import CheckResult, ScoreSheet

_CONVERSIONS: Final = {("ms", "s"): 1e-3}
"""The factor from a value in the report's unit to one in its limit's unit."""


class Judged(NamedTuple):
    """A check, with what its limit and its key say of it.

    Attributes:
        name: name of its limit in ``[checks]``.
        check: the check that the limit belongs to.
        unit: unit of the limit.
        factor: factor from the report's value to that unit.
    """

    name: str
    check: Check
    unit: str
    factor: float

    @property
    def of_worst_robot(self) -> bool:
        """Whether its value is that of the worst robot, and not one of the whole fleet."""
        return "<robot>" in self.check.key

    def result(self, sheet: ScoreSheet, limit: float) -> CheckResult:
        """The result of the check.

        Args:
            sheet: the score sheet.
            limit: the scenario's limit.
        """
        value = worst(sheet, self.check.key, self.check.bound)
        if value is None:
            return CheckResult(None, limit, False)
        value *= self.factor
        met = value <= limit if self.check.bound is Bound.AT_MOST else value >= limit
        return CheckResult(value, limit, met)


def check_run(sheet: ScoreSheet, limits: Checks) -> dict[str, CheckResult]:
    """Every check whose limit is set.

    Args:
        sheet: the score sheet.
        limits: the scenario's limits.
    """
    return {
        judged.name: judged.result(sheet, limit)
        for judged in CHECKS
        if (limit := getattr(limits, judged.name)) is not None
    }


def judged_checks(kind: type[Checks]) -> tuple[Judged, ...]:
    """The checks that a settings section declares.

    Args:
        kind: the section.

    Raises:
        TypeError: a check of a key that the report does not have, or with a limit of another unit.
    """
    found = []
    for name, hint in get_type_hints(kind, include_extras=True).items():
        check = next((note for note in get_args(hint) if isinstance(note, Check)), None)
        if get_origin(hint) is not Annotated or check is None:
            continue
        if check.key not in UNITS:
            raise TypeError(f"check {name}: got {check.key!r}, expected a key of docs/scoresheet.md")
        ours, theirs = quantities(kind)[name].unit, UNITS[check.key]
        factor = 1.0 if ours == theirs else _CONVERSIONS.get((theirs, ours))
        if factor is None:
            raise TypeError(f"check {name}: got a limit in {ours!r}, expected {theirs!r}, as {check.key} has")
        found.append(Judged(name, check, ours, factor))
    return tuple(found)


CHECKS: Final = judged_checks(Checks)
"""Every check, in the order of the settings."""
