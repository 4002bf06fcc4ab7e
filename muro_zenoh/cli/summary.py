"""A score sheet as text."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from muro_zenoh.config.checks import Bound
from muro_zenoh.scoring.checks import CHECKS
from muro_zenoh.scoring.keys import UNITS, total, worst
from muro_zenoh.scoring.rows import as_json
from muro_zenoh.scoring.sheet import ScoreSheet
from muro_zenoh.scoring.verdict import verdict
from muro_zenoh.wording import counted

_CHECKS: Final = {judged.name: judged for judged in CHECKS}


def summary(sheet: ScoreSheet) -> str:
    """A score sheet as lines of text; rows that do not apply to the scenario are left out.

    Args:
        sheet: the score sheet.
    """
    fleet = counted(sheet.robots, "robot")
    lines = [f"{sheet.scenario}: {fleet}, {_value(sheet, 'duration_s')}, seed {_number(sheet.seed)}"]
    lines += [f"  {name:<20}{text}" for name, text in (*_task_lines(sheet), *_fleet_lines(sheet))]
    lines += [_check_line(sheet, name) for name in sheet.checks]
    lines += [f"  {name}: {failure}" for name, failure in sheet.failures.items()]
    lines.append(verdict(sheet))
    return "\n".join(lines)


def _check_line(sheet: ScoreSheet, name: str) -> str:
    result, judged = sheet.checks[name], _CHECKS[name]
    whose = " (worst robot)" if judged.of_worst_robot and sheet.robots > 1 else ""
    met = "met" if result.passed else "NOT MET"
    limit = f"{judged.check.bound} {_number(result.limit, judged.unit)}"
    return f"  check {name}{whose}: {_number(result.value, judged.unit)}, limit {limit}: {met}"


def _task_lines(sheet: ScoreSheet) -> Iterable[tuple[str, str]]:
    """How well the robots did their task."""
    if sheet.radius_error_m.p50 is not None:
        yield "settled after", _value(sheet, "settle_time_s")
        yield "radius error", f"{_spread(sheet, 'radius_error_m')} (all robots)"
    if sheet.spacing_error_rad.p50 is not None:
        yield "spacing error", _spread(sheet, "spacing_error_rad")
    if sheet.density_error is not None:
        yield "density error", _value(sheet, "density_error")
    if sheet.goals_asked:
        errors = f"{_value(sheet, 'goal_distance_m')} and {_value(sheet, 'goal_heading_rad')}"
        yield "goals", f"{sheet.goals_reached} of {sheet.goals_asked} reached, errors at most {errors}"
    if sheet.tracking_error_m.p50 is not None:
        yield "path error", _spread(sheet, "tracking_error_m")
    if sheet.coverage.cost is not None:
        yield (
            "centroid distance",
            f"at most {_value(sheet, 'coverage.distance_m')}, after {counted(sheet.coverage.rounds, 'round')}; "
            f"cost: remaining gain {_value(sheet, 'coverage.gain')}, largest rise {_value(sheet, 'coverage.rise')}",
        )


def _fleet_lines(sheet: ScoreSheet) -> Iterable[tuple[str, str]]:
    """How well the fleet ran, independent of its task."""
    touched = counted(sheet.collisions, "collision") if sheet.collisions is not None else "- collisions"
    if sheet.wall_contacts:
        touched += f", {counted(sheet.wall_contacts, 'contact')} with walls"
    cpu = "processes.<process>.cpu_percent"
    yield "min separation", f"{_value(sheet, 'min_separation_m')}, {touched}"
    yield "pose age", _spread(sheet, "pose_age_ms")
    yield "pose to command", _spread(sheet, "pose_to_command_ms")
    yield "fix rate", f"at least {_value(sheet, 'fix_rate_hz.<robot>', Bound.AT_LEAST)}"
    yield "calibration error", f"at most {_value(sheet, 'calibration.<robot>.error')}"
    stopped = {name: time for name, time in sheet.stopped_s.items() if time > 0.0}
    if stopped:
        unit = UNITS["stopped_s.<robot>"]
        yield "stop order", ", ".join(f"{name} for {_number(time, unit)}" for name, time in stopped.items())
    if sheet.never_seen:
        yield "never seen", f"{' '.join(sheet.never_seen)} (by any camera)"
    yield "restarts", str(sheet.restarts)
    yield "processor", f"{_number(total(sheet, cpu), UNITS[cpu])} of one core, all processes"


def _value(sheet: ScoreSheet, key: str, bound: Bound = Bound.AT_MOST) -> str:
    """The value of a key with its unit, for all robots the worst one's."""
    return _number(worst(sheet, key, bound), UNITS[key])


def _spread(sheet: ScoreSheet, key: str) -> str:
    values = as_json(getattr(sheet, key))
    return "  ".join(f"{name} {_number(value, UNITS[f'{key}.{name}'])}" for name, value in values.items())


def _number(value: float | None, unit: str = "") -> str:
    return "-" if value is None else f"{value:g} {unit}".rstrip()
