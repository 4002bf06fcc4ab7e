"""The checks that a scenario can make: one table, used by the score and by ``docs/scoresheet.md``.

Their limits are set in a scenario's ``[checks]``, under the same names; see :class:`~muro_zenoh.config.Checks`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from muro_zenoh.config import Checks
from muro_zenoh.scoring.sheet import CheckResult, ScoreSheet


class Bound(StrEnum):
    """On which side of its limit a value must be; the limit itself is allowed."""

    AT_MOST = "at most"
    AT_LEAST = "at least"


@dataclass(frozen=True, slots=True)
class Check:
    """One check.

    Args:
        name: the name of its limit in ``[checks]``.
        looks_at: the keys of the score sheet that it uses, as text.
        unit: the unit of value and limit.
        value: the value to compare with the limit; None when it is unknown.
        bound: on which side of the limit the value must be.
    """

    name: str
    looks_at: str
    unit: str
    value: Callable[[ScoreSheet], float | None]
    bound: Bound = Bound.AT_MOST

    def result(self, sheet: ScoreSheet, limit: float) -> CheckResult:
        """The result of the check.

        Args:
            sheet: the score sheet.
            limit: the scenario's limit.
        """
        value = self.value(sheet)
        if value is None:
            return CheckResult(None, limit, False)
        return CheckResult(value, limit, value <= limit if self.bound is Bound.AT_MOST else value >= limit)


def check_run(sheet: ScoreSheet, limits: Checks) -> dict[str, CheckResult]:
    """Every check whose limit is set.

    Args:
        sheet: the score sheet.
        limits: the scenario's limits.
    """
    return {
        check.name: check.result(sheet, limit) for check in CHECKS if (limit := getattr(limits, check.name)) is not None
    }


def _worst(which: Callable[[list[float]], float], values: Iterable[float | None]) -> float | None:
    """The worst robot's value; None when the value of any robot is unknown."""
    robots = list(values)
    known = [value for value in robots if value is not None]
    return which(known) if robots and len(known) == len(robots) else None


def _pose_age(sheet: ScoreSheet) -> float | None:
    age = sheet.pose_age_ms.p99
    return None if age is None else age / 1e3


CHECKS: Final = (
    Check("settle_time", "`settle_time_s`", "s", lambda sheet: sheet.settle_time_s),
    Check(
        "radius_error_p95",
        "the largest `radius_error_by_robot_m.<robot>.p95`",
        "m",
        lambda sheet: _worst(max, (spread.p95 for spread in sheet.radius_error_by_robot_m.values())),
    ),
    Check("spacing_error_p95", "`spacing_error_rad.p95`", "rad", lambda sheet: sheet.spacing_error_rad.p95),
    Check(
        "fix_rate",
        "the smallest `fix_rate_hz.<robot>`",
        "Hz",
        lambda sheet: _worst(min, sheet.fix_rate_hz.values()),
        Bound.AT_LEAST,
    ),
    Check("pose_age_p99", "`pose_age_ms.p99`, in seconds", "s", _pose_age),
    Check("collisions", "`collisions`", "", lambda sheet: sheet.collisions),
    Check(
        "goals_missed",
        "`goals_asked` minus `goals_reached`; unknown when the scenario has no goals",
        "",
        lambda sheet: sheet.goals_asked - sheet.goals_reached if sheet.goals_asked else None,
    ),
    Check("goal_distance", "`goal_distance_m`", "m", lambda sheet: sheet.goal_distance_m),
    Check("goal_heading", "`goal_heading_rad`", "rad", lambda sheet: sheet.goal_heading_rad),
    Check("tracking_error_p95", "`tracking_error_m.p95`", "m", lambda sheet: sheet.tracking_error_m.p95),
    Check("peak_speed_ratio", "`peak_speed_ratio`", "", lambda sheet: sheet.peak_speed_ratio, Bound.AT_LEAST),
    Check("command_ratio", "`command_ratio`", "", lambda sheet: sheet.command_ratio),
    Check("coverage_distance", "`coverage.distance_m`", "m", lambda sheet: sheet.coverage.distance_m),
    Check("coverage_gain", "`coverage.gain`", "", lambda sheet: sheet.coverage.gain),
    Check("coverage_rise", "`coverage.rise`", "", lambda sheet: sheet.coverage.rise),
    Check("density_error", "`density_error`", "", lambda sheet: sheet.density_error),
)
"""Every check, in the order of :class:`~muro_zenoh.config.Checks`."""
