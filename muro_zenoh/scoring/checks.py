"""Whether a run meets the checks of its scenario. They are declared in :mod:`muro_zenoh.config.checks`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Final, NamedTuple, get_args, get_origin, get_type_hints

from muro_zenoh.config.checks import Bound, Check, Checks
from muro_zenoh.quantities import quantities
from muro_zenoh.scoring.rows import definitions
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

    def result(self, sheet: ScoreSheet, limit: float) -> CheckResult:
        """The result of the check.

        Args:
            sheet: the score sheet.
            limit: the scenario's limit.
        """
        at_most = self.check.bound is Bound.AT_MOST
        values = list(_values(sheet, self.check.key.split(".")))
        known = [value * self.factor for value in values if value is not None]
        if not known or len(known) < len(values):  # not known while one robot's is not
            return CheckResult(None, limit, False)
        worst = max(known) if at_most else min(known)
        return CheckResult(worst, limit, worst <= limit if at_most else worst >= limit)


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
    units = {row.key: row.unit for row in definitions(ScoreSheet)}
    found = []
    for name, hint in get_type_hints(kind, include_extras=True).items():
        check = next((note for note in get_args(hint) if isinstance(note, Check)), None)
        if get_origin(hint) is not Annotated or check is None:
            continue
        if check.key not in units:
            raise TypeError(f"check {name}: got {check.key!r}, expected a key of docs/scoresheet.md")
        ours, theirs = quantities(kind)[name].unit, units[check.key]
        factor = 1.0 if ours == theirs else _CONVERSIONS.get((theirs, ours))
        if factor is None:
            raise TypeError(f"check {name}: got a limit in {ours!r}, expected {theirs!r}, as {check.key} has")
        found.append(Judged(name, check, ours, factor))
    return tuple(found)


def _values(value: Any, steps: list[str]) -> Iterator[float | None]:
    """The values of a key such as ``fix_rate_hz.<robot>``; every robot's, where it names robots."""
    if not steps:
        yield value
    elif isinstance(value, Mapping):
        for inner in value.values():
            yield from _values(inner, steps[1:])
    else:
        yield from _values(getattr(value, steps[0]), steps[1:])


CHECKS: Final = judged_checks(Checks)
"""Every check, in the order of the settings."""
