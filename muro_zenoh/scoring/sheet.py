"""The score sheet: what a run was worth, from what was seen of it. Pure; ``docs/scoresheet.md`` defines every key."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from muro_zenoh.config import Checks
from muro_zenoh.control import ring
from muro_zenoh.control.importance import Importance
from muro_zenoh.geometry import Circle
from muro_zenoh.scoring.deployment import Deployed, Deployment, density_error, score_deployment
from muro_zenoh.scoring.goals import Body, Moment, Planned, goals_table, score_goals, score_tracking

SAMPLE_PERIOD: Final = 0.1
"""Time from one sample of the fleet to the next [s]."""

RADIUS_BAND: Final = 0.03
"""A settled robot is at most so far from the circle [m]."""

SPACING_BAND: Final = 0.10
"""A settled fleet's spacing error is at most this [rad]."""

HOLD: Final = 5.0
"""Settled is who stays within the bands for so long [s]."""

_GAP: Final = 5.0 * SAMPLE_PERIOD
"""Samples further apart than this do not belong to one stay within the bands [s]."""


class Sample(NamedTuple):
    """The fleet at one moment.

    Attributes:
        t: scenario time [s].
        places: x, y [m, world] of each robot whose truth is known then.
        circle: the circle to follow then.
        bodies: each robot whose truth is known then, with heading and speeds.
    """

    t: float
    places: Mapping[str, tuple[float, float]]
    circle: Circle
    bodies: Mapping[str, Body] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class Observed:
    """What was seen of a run.

    Attributes:
        scenario: its name.
        robots: their names.
        duration: scenario time that passed [s].
        seed: of the simulator.
        ended: ``duration``, ``interrupted`` or ``failed``.
        follows_circle: whether the robots shall follow the circle.
        spreads: whether they shall spread evenly round it.
        samples: the fleet at 10 Hz.
        pose_age: from capture to the estimate that used it [s], each.
        pose_to_command: from the arrival of a pose to the command that followed [s], each.
        fix_rate: accepted fixes per second, by robot.
        collisions: the simulator's count; None without a simulator.
        min_separation: least distance of two centres [m]; None without a simulator, or for one robot.
        calibration: cal0, calD, and the simulator's hidden scales of omega and v, by robot.
        calibration_error_10s: worst relative error of the two after 10 s of circling, by robot.
        restarts: of processes.
        processes: ``cpu_percent`` and ``rss_mb`` by process.
        goals: rows ``(x, y)`` or ``(x, y, theta)`` [m, world; rad] that the scenario asks of each robot.
        paths: the paths that each robot planned.
        v_min: the speed of the robots on arcs [m/s]; None for robots that plan no path.
        command_ratio: the largest speed commanded of any robot over its limit; None when it was not looked at.
        deployment: what robots that cover the floor were asked for.
        importance: how a ring's time round the circle should be shared out.
    """

    scenario: str
    robots: tuple[str, ...]
    duration: float
    seed: int | None = None
    ended: str = "duration"
    follows_circle: bool = True
    spreads: bool = True
    samples: Sequence[Sample] = ()
    pose_age: Sequence[float] = ()
    pose_to_command: Sequence[float] = ()
    fix_rate: Mapping[str, float | None] = field(default_factory=dict)
    collisions: int | None = None
    min_separation: float | None = None
    calibration: Mapping[str, Calibrated] = field(default_factory=dict)
    calibration_error_10s: Mapping[str, float | None] = field(default_factory=dict)
    restarts: int = 0
    processes: Mapping[str, Mapping[str, float | None]] = field(default_factory=dict)
    goals: Mapping[str, Sequence[Sequence[float]]] = field(default_factory=dict)
    paths: Mapping[str, Sequence[Planned]] = field(default_factory=dict)
    v_min: float | None = None
    command_ratio: float | None = None
    deployment: Deployment | None = None
    importance: Importance | None = None


class Calibrated(NamedTuple):
    """A robot's drive calibrations, found and true.

    Attributes:
        cal0: found; multiplies omega.
        calD: found; multiplies v.
        s_omega: hidden: the robot turns so many times what its wheels say.
        s_v: hidden: the robot drives so many times what its wheels say.
    """

    cal0: float | None
    calD: float | None  # noqa: N815 - the channel's name
    s_omega: float | None
    s_v: float | None

    @property
    def error(self) -> float | None:
        """The larger relative error of the two against one over the hidden scale; None while one is not known."""
        if self.cal0 is None or self.calD is None or self.s_omega is None or self.s_v is None:
            return None
        return max(abs(self.cal0 * self.s_omega - 1.0), abs(self.calD * self.s_v - 1.0))


def radius_error(place: tuple[float, float], circle: Circle) -> float:
    """Distance of a place from a circle's line [m].

    Args:
        place: x, y [m, world].
        circle: the circle.
    """
    return abs(math.hypot(place[0] - circle.x, place[1] - circle.y) - circle.radius)


def spacing_error(places: Mapping[str, tuple[float, float]], circle: Circle) -> float:
    """The largest |gap - 2 pi / N| between neighbours round a circle's centre [rad]; 0 for fewer than two robots.

    The same for both directions of travel.

    Args:
        places: x, y [m, world] by robot.
        circle: round whose centre.
    """
    return ring.spacing_error(ring.angles_round(places, circle))


def settle_time(moments: Sequence[tuple[float, bool]], hold: float = HOLD) -> float | None:
    """The first time from which on all was well for ``hold`` at least [s]; None when there is none.

    Args:
        moments: time [s] and whether all was well then, in order. A gap of half a second ends a stay.
        hold: how long [s].
    """
    since = last = math.nan
    for t, well in moments:
        if not well:
            since = math.nan
        elif not t - last <= _GAP or math.isnan(since):
            since = t
        last = t
        # Times are multiples of the period, in floats.
        if well and t - since >= hold - 1e-6:
            return since
    return None


def percentile(values: Sequence[float], percent: float) -> float | None:
    """A percentile, linear between the two nearest ranks as in numpy; None of nothing.

    Args:
        values: in any order.
        percent: in [0, 100].
    """
    if not values:
        return None
    ordered = sorted(values)
    rank = (len(ordered) - 1) * percent / 100.0
    low = math.floor(rank)
    high = min(low + 1, len(ordered) - 1)
    return ordered[low] + (ordered[high] - ordered[low]) * (rank - low)


def score_sheet(seen: Observed, checks: Checks) -> dict[str, Any]:
    """The score sheet, ready for JSON.

    Args:
        seen: what was seen of the run.
        checks: what it must meet, and over how long its errors are judged.
    """
    window = [s for s in seen.samples if s.t > seen.duration - checks.window - 1e-6]
    by_robot: dict[str, list[float]] = {name: [] for name in seen.robots}
    spacing: list[float] = []
    for sample in window:
        if seen.follows_circle:
            for name, place in sample.places.items():
                by_robot[name].append(radius_error(place, sample.circle))
        if seen.spreads and len(sample.places) == len(seen.robots):
            spacing.append(spacing_error(sample.places, sample.circle))
    known = sum(len(s.places) for s in seen.samples)
    sheet: dict[str, Any] = {
        "scenario": seen.scenario,
        "robots": len(seen.robots),
        "duration_s": _round(seen.duration, 2),
        "seed": seen.seed,
        "ended": seen.ended,
        "settle_time_s": _round(settle_time([(s.t, _is_well(seen, s)) for s in seen.samples]), 2)
        if seen.follows_circle
        else None,
        "radius_error_m": _spread([e for errors in by_robot.values() for e in errors], (50, 95), 5),
        "radius_error_by_robot_m": {name: _spread(errors, (50, 95), 5) for name, errors in by_robot.items()},
        "spacing_error_rad": _spread(spacing, (50, 95), 5),
        **_goal_keys(seen),
        "command_ratio": _round(seen.command_ratio, 4),
        "coverage": _coverage(seen),
        "density_error": _round(
            density_error([p for s in window for p in s.places.values()], window[-1].circle, seen.importance), 4
        )
        if seen.importance is not None and window
        else None,
        "truth_known": _round(known / (len(seen.samples) * len(seen.robots)), 4) if seen.samples else 0.0,
        "min_separation_m": _round(seen.min_separation, 4),
        "collisions": seen.collisions,
        "pose_age_ms": _spread([1e3 * age for age in seen.pose_age], (50, 99), 2, with_max=False),
        "pose_to_command_ms": _spread([1e3 * t for t in seen.pose_to_command], (50, 99), 3, with_max=False),
        "fix_rate_hz": {name: _round(seen.fix_rate.get(name), 2) for name in seen.robots},
        "calibration": {name: _calibration(seen, name) for name in seen.robots},
        "restarts": seen.restarts,
        "processes": {name: dict(use) for name, use in seen.processes.items()},
    }
    sheet["checks"] = _check(sheet, checks)
    sheet["passed"] = seen.ended == "duration" and all(check["passed"] for check in sheet["checks"].values())
    return sheet


def _goal_keys(seen: Observed) -> dict[str, Any]:
    """What concerns goals and the paths to them."""
    tracks = {n: [Moment(s.t, s.bodies[n]) for s in seen.samples if n in s.bodies] for n in seen.robots}
    goals = {name: score_goals(rows, tracks[name]) for name, rows in seen.goals.items()}
    tracked = {name: score_tracking(paths, tracks[name]) for name, paths in seen.paths.items() if paths}
    peaks = [t.peak for t in tracked.values()]
    ratio = None
    if seen.v_min is not None and len(tracked) == len(seen.robots) and None not in peaks:
        ratio = min(peak for peak in peaks if peak is not None) / seen.v_min
    return {
        **goals_table(goals),
        "goals": goals,
        "tracking_error_m": _spread([e for t in tracked.values() for e in t.errors], (50, 95), 5),
        "peak_speed_ratio": _round(ratio, 3),
    }


def _coverage(seen: Observed) -> dict[str, float | None]:
    found = Deployed(None, None, None, None, 0)
    if seen.deployment is not None:
        found = score_deployment(seen.deployment, [(s.t, s.bodies) for s in seen.samples], len(seen.robots))
    return {
        "distance_m": _round(found.distance, 4),
        "cost": _round(found.cost, 5),
        "gain": _round(found.gain, 5),
        "rise": _round(found.rise, 5),
        "rounds": found.rounds,
    }


def _is_well(seen: Observed, sample: Sample) -> bool:
    """Whether every robot's truth is known, and within the bands."""
    if len(sample.places) < len(seen.robots):
        return False
    if any(radius_error(place, sample.circle) > RADIUS_BAND for place in sample.places.values()):
        return False
    return not seen.spreads or spacing_error(sample.places, sample.circle) <= SPACING_BAND


def _check(sheet: Mapping[str, Any], checks: Checks) -> dict[str, dict[str, Any]]:
    """Each check that is set: the value, its limit, whether it is met. A value that is not known does not meet it."""
    ages = sheet["pose_age_ms"]["p99"]
    at_most = {
        "settle_time": (sheet["settle_time_s"], checks.settle_time),
        "radius_error_p95": (
            _worst(max, (errors["p95"] for errors in sheet["radius_error_by_robot_m"].values())),
            checks.radius_error_p95,
        ),
        "spacing_error_p95": (sheet["spacing_error_rad"]["p95"], checks.spacing_error_p95),
        "pose_age_p99": (None if ages is None else ages / 1e3, checks.pose_age_p99),
        "collisions": (sheet["collisions"], checks.collisions),
        "goals_missed": (
            sheet["goals_asked"] - sheet["goals_reached"] if sheet["goals_asked"] else None,
            checks.goals_missed,
        ),
        "goal_distance": (sheet["goal_distance_m"], checks.goal_distance),
        "goal_heading": (sheet["goal_heading_rad"], checks.goal_heading),
        "tracking_error_p95": (sheet["tracking_error_m"]["p95"], checks.tracking_error_p95),
        "command_ratio": (sheet["command_ratio"], checks.command_ratio),
        "coverage_distance": (sheet["coverage"]["distance_m"], checks.coverage_distance),
        "coverage_gain": (sheet["coverage"]["gain"], checks.coverage_gain),
        "coverage_rise": (sheet["coverage"]["rise"], checks.coverage_rise),
        "density_error": (sheet["density_error"], checks.density_error),
    }
    out = {
        name: {"value": value, "limit": limit, "passed": value is not None and value <= limit}
        for name, (value, limit) in at_most.items()
        if limit is not None
    }
    at_least = {
        "fix_rate": (_worst(min, sheet["fix_rate_hz"].values()), checks.fix_rate),
        "peak_speed_ratio": (sheet["peak_speed_ratio"], checks.peak_speed_ratio),
    }
    out |= {
        name: {"value": value, "limit": limit, "passed": value is not None and value >= limit}
        for name, (value, limit) in at_least.items()
        if limit is not None
    }
    return out


def _worst(which: Any, values: Any) -> float | None:
    """The worst robot's value; unknown when one robot's is."""
    known = list(values)
    return None if not known or None in known else which(known)


def _calibration(seen: Observed, name: str) -> dict[str, float | None]:
    c = seen.calibration.get(name, Calibrated(None, None, None, None))
    return {
        "cal0": _round(c.cal0, 4),
        "calD": _round(c.calD, 4),
        "true_cal0": _round(1.0 / c.s_omega, 4) if c.s_omega else None,
        "true_calD": _round(1.0 / c.s_v, 4) if c.s_v else None,
        "error": _round(c.error, 4),
        "error_after_10s": _round(seen.calibration_error_10s.get(name), 4),
    }


def _spread(
    values: Sequence[float], percents: Sequence[int], digits: int, *, with_max: bool = True
) -> dict[str, float | None]:
    out = {f"p{p}": _round(percentile(values, p), digits) for p in percents}
    if with_max:
        out["max"] = _round(max(values, default=None), digits)
    return out


def _round(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)
