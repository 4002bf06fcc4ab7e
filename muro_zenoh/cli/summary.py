"""A score sheet as text."""

from __future__ import annotations

from collections.abc import Iterable

from muro_zenoh.scoring.rows import as_json
from muro_zenoh.scoring.sheet import ScoreSheet
from muro_zenoh.scoring.spread import DelaySpread, ErrorSpread


def summary(sheet: ScoreSheet) -> str:
    """A score sheet as lines of text; rows that do not apply to the scenario are left out.

    Args:
        sheet: the score sheet.
    """
    lines = [f"{sheet.scenario}: {sheet.robots} robots, {sheet.duration_s:g} s, seed {_number(sheet.seed)}"]
    lines += [f"  {name:<20}{text}" for name, text in (*_task_lines(sheet), *_fleet_lines(sheet))]
    for name, check in sheet.checks.items():
        met = "met" if check.passed else "NOT MET"
        lines.append(f"  check {name}: {_number(check.value)} (limit {_number(check.limit)}) {met}")
    lines += [f"  {name}: {failure}" for name, failure in sheet.failures.items()]
    lines.append(_verdict(sheet))
    return "\n".join(lines)


def _verdict(sheet: ScoreSheet) -> str:
    if sheet.passed is None:
        return "nothing was checked: the scenario has no [checks]"
    if sheet.passed:
        return "passed"
    missed = [name for name, check in sheet.checks.items() if not check.passed]
    why = [
        *((sheet.ended,) if sheet.ended != "duration" else ()),
        *((f"the behaviour of {' '.join(sheet.failures)} failed or ended early",) if sheet.failures else ()),
        *((f"{', '.join(missed)} not met",) if missed else ()),
        *(() if sheet.checks else ("nothing was checked",)),
    ]
    return f"NOT PASSED ({'; '.join(why)})"


def _task_lines(sheet: ScoreSheet) -> Iterable[tuple[str, str]]:
    """How well the robots did their task."""
    if sheet.radius_error_m.p50 is not None:
        yield "settled after", _number(sheet.settle_time_s, " s")
        yield "radius error", _spread(sheet.radius_error_m, " m")
    if sheet.spacing_error_rad.p50 is not None:
        yield "spacing error", _spread(sheet.spacing_error_rad, " rad")
    if sheet.density_error is not None:
        yield "density error", _number(sheet.density_error)
    if sheet.goals_asked:
        worst = f"{_number(sheet.goal_distance_m, ' m')} and {_number(sheet.goal_heading_rad, ' rad')}"
        yield "goals", f"{sheet.goals_reached} of {sheet.goals_asked} reached, errors at most {worst}"
    if sheet.tracking_error_m.p50 is not None:
        yield "path error", _spread(sheet.tracking_error_m, " m")
    coverage = sheet.coverage
    if coverage.cost is not None:
        yield (
            "centroid distance",
            f"at most {_number(coverage.distance_m, ' m')}, after {coverage.rounds} rounds; cost: remaining gain "
            f"{_number(coverage.gain)}, largest rise {_number(coverage.rise)}",
        )


def _fleet_lines(sheet: ScoreSheet) -> Iterable[tuple[str, str]]:
    """How well the fleet ran, independent of its task."""
    rates = [rate for rate in sheet.fix_rate_hz.values() if rate is not None]
    errors = [robot.error for robot in sheet.calibration.values() if robot.error is not None]
    cpu = [use.cpu_percent for use in sheet.processes.values() if use.cpu_percent is not None]
    yield "min separation", f"{_number(sheet.min_separation_m, ' m')}, {_number(sheet.collisions)} collisions"
    yield "pose age", _spread(sheet.pose_age_ms, " ms")
    yield "pose to command", _spread(sheet.pose_to_command_ms, " ms")
    yield "fix rate", f"at least {_number(min(rates, default=None), ' Hz')}"
    yield "calibration error", f"at most {_number(max(errors, default=None))}"
    stopped = {name: time for name, time in sheet.stopped_s.items() if time > 0.0}
    if stopped:
        yield "stop order", ", ".join(f"{name} for {_number(time, ' s')}" for name, time in stopped.items())
    if sheet.never_seen:
        yield "never seen", f"{' '.join(sheet.never_seen)} (by any camera)"
    yield "restarts", str(sheet.restarts)
    yield "processor", f"{_number(round(sum(cpu), 1) if cpu else None, ' %')} of one core, all processes"


def _number(value: float | None, unit: str = "") -> str:
    return "-" if value is None else f"{value:g}{unit}"


def _spread(spread: ErrorSpread | DelaySpread, unit: str) -> str:
    return "  ".join(f"{name} {_number(value, unit)}" for name, value in as_json(spread).items())
