"""Computes the score sheet from the data observed in a run. Pure."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

from muro_zenoh.config import Checks
from muro_zenoh.scoring.checks import check_run
from muro_zenoh.scoring.circle import radius_error, settle_time, spacing_error, within_bands
from muro_zenoh.scoring.density import density_error
from muro_zenoh.scoring.deployment import Coverage, score_deployment
from muro_zenoh.scoring.goals import Tracked, score_goals, score_tracking
from muro_zenoh.scoring.observed import Calibrated, Moment, Observed, Sample
from muro_zenoh.scoring.sheet import Calibration, FaultResult, ScoreSheet
from muro_zenoh.scoring.spread import DelaySpread, ErrorSpread
from muro_zenoh.scoring.verdict import passed


def score_run(seen: Observed, checks: Checks) -> ScoreSheet:
    """The score sheet of a run.

    Args:
        seen: the data observed in it.
        checks: the limits that it must meet, and the window in which errors are evaluated.
    """
    expected = seen.expected
    window = [s for s in seen.samples if s.t > seen.duration - checks.window - 1e-6]
    radius = _radius_errors(seen, window)
    tracks = {
        n: [Moment(s.t, s.bodies[n], n in s.diverted) for s in seen.samples if n in s.bodies] for n in seen.robots
    }
    goals = {name: score_goals(rows, tracks[name]) for name, rows in expected.goals.items()}
    results = [goal for of_robot in goals.values() for goal in of_robot]
    tracked = {name: score_tracking(paths, tracks[name]) for name, paths in seen.paths.items() if paths}
    density = None
    if expected.importance is not None and window:
        positions = [p for s in window for p in s.positions.values()]
        density = density_error(positions, window[-1].circle, expected.importance)
    reached = sum(1 for goal in results if goal.reached_s is not None)
    sheet = ScoreSheet(
        scenario=seen.scenario,
        robots=len(seen.robots),
        duration_s=seen.duration,
        seed=seen.seed,
        ended=seen.ended,
        settle_time_s=_settle_time(seen),
        radius_error_m=ErrorSpread.of([e for errors in radius.values() for e in errors]),
        radius_error_by_robot_m={name: ErrorSpread.of(errors) for name, errors in radius.items()},
        spacing_error_rad=ErrorSpread.of(_spacing_errors(seen, window)),
        goals_asked=len(results),
        goals_reached=reached,
        goals_missed=len(results) - reached if results else None,
        goal_distance_m=max((g.distance_m for g in results if g.distance_m is not None), default=None),
        goal_heading_rad=max((g.heading_rad for g in results if g.heading_rad is not None), default=None),
        goals=goals,
        tracking_error_m=ErrorSpread.of([e for robot in tracked.values() for e in robot.errors]),
        peak_speed_ratio=_peak_speed_ratio(seen, list(tracked.values())),
        command_ratio=seen.command_ratio,
        coverage=_coverage(seen),
        density_error=density,
        truth_known=_truth_known(seen),
        min_separation_m=seen.min_separation,
        collisions=seen.collisions,
        wall_contacts=seen.wall_contacts,
        pose_age_ms=DelaySpread.of_seconds(seen.pose_age),
        pose_to_command_ms=DelaySpread.of_seconds(seen.pose_to_command),
        fix_rate_hz={name: seen.fix_rate.get(name) for name in seen.robots},
        calibration={name: _calibration(seen, name) for name in seen.robots},
        never_seen=tuple(name for name in seen.robots if name not in seen.seen),
        stopped_s={name: _stopped_time(seen, name) for name in seen.robots},
        failures={name: seen.failures[name] for name in seen.robots if name in seen.failures},
        faults=tuple(FaultResult(f.kind, f.target, f.begin, f.end, f.stamp, f.note) for f in seen.faults),
        restarts=seen.restarts,
        processes=seen.processes,
        checks={},
        passed=None,
    )
    checked = replace(sheet, checks=check_run(sheet, checks))
    return replace(checked, passed=passed(checked))


def _stopped_time(seen: Observed, name: str) -> float:
    return sum(after.t - before.t for before, after in pairwise(seen.samples) if name in before.stopped)


def _radius_errors(seen: Observed, window: list[Sample]) -> dict[str, list[float]]:
    errors: dict[str, list[float]] = {name: [] for name in seen.robots}
    if seen.expected.follows_circle:
        for sample in window:
            for name, position in sample.positions.items():
                errors[name].append(radius_error(position, sample.circle))
    return errors


def _spacing_errors(seen: Observed, window: list[Sample]) -> list[float]:
    if not seen.expected.spreads:
        return []
    return [spacing_error(s.positions, s.circle) for s in window if len(s.positions) == len(seen.robots)]


def _settle_time(seen: Observed) -> float | None:
    if not seen.expected.follows_circle:
        return None
    return settle_time([(s.t, within_bands(s, len(seen.robots), spread=seen.expected.spreads)) for s in seen.samples])


def _peak_speed_ratio(seen: Observed, tracked: list[Tracked]) -> float | None:
    """The slowest robot's peak speed over the speed on arcs; None when that of any robot is unknown."""
    peaks = [robot.peak for robot in tracked if robot.peak is not None]
    if seen.expected.v_min is None or not len(peaks) == len(tracked) == len(seen.robots):
        return None
    return min(peaks) / seen.expected.v_min


def _coverage(seen: Observed) -> Coverage:
    if seen.expected.deployment is None:
        return Coverage(None, None, None, None, 0)
    fleet = [(s.t, s.bodies) for s in seen.samples]
    return Coverage(*score_deployment(seen.expected.deployment, fleet, len(seen.robots)))


def _truth_known(seen: Observed) -> float:
    if not seen.samples:
        return 0.0
    return sum(len(s.positions) for s in seen.samples) / (len(seen.samples) * len(seen.robots))


def _calibration(seen: Observed, name: str) -> Calibration:
    c = seen.calibration.get(name, Calibrated())
    return Calibration(
        cal0=c.cal0,
        calD=c.calD,
        true_cal0=1.0 / c.s_omega if c.s_omega else None,
        true_calD=1.0 / c.s_v if c.s_v else None,
        error=c.error,
        error_after_10s=seen.calibration_error_10s.get(name),
    )
