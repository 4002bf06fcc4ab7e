"""The state of a run at one moment, for the live table."""

from __future__ import annotations

import statistics
from typing import NamedTuple

from muro_zenoh.config import Scenario
from muro_zenoh.scoring.circle import gaps_ahead, radius_error, spacing_error
from muro_zenoh.scoring.collector import Collector
from muro_zenoh.scoring.observed import Calibrated


class RobotRow(NamedTuple):
    """One robot in the table; None is unknown.

    Attributes:
        name: of the robot.
        state: in one word.
        reasons: why it does not drive.
        pose_age: median since the previous health message [s].
        distance: distance from the circle [m].
        gap: gap to the next robot in the direction of travel [rad].
        command_rate: commands per second [Hz].
        calibrated: its estimated drive calibration.
    """

    name: str
    state: str
    reasons: str
    pose_age: float | None
    distance: float | None
    gap: float | None
    command_rate: float | None
    calibrated: Calibrated


class View(NamedTuple):
    """A run at one moment.

    Attributes:
        t: scenario time [s].
        duration: duration of the run [s].
        rows: one per robot.
        radius_error: the largest radius error [m]; None while the true position of a robot is unknown.
        spacing_error: the spacing error [rad]; likewise.
        restarts: number of process restarts.
    """

    t: float
    duration: float
    rows: list[RobotRow]
    radius_error: float | None
    spacing_error: float | None
    restarts: int


def view_of(collector: Collector, scenario: Scenario, restarts: int) -> View:
    """The state of a run now.

    Args:
        collector: the collected data.
        scenario: its robots and its duration.
        restarts: number of process restarts.
    """
    sample, expected = collector.latest, collector.expected
    # Robots without expectations may circle, too: their behaviour is the user's own, or is changed later.
    circling = not (expected.goals or expected.v_min or expected.deployment)
    gaps = gaps_ahead(sample.positions, sample.circle)
    rows = []
    for name in scenario.robots:
        health = collector.health.get(name)
        ages = health.samples.get("pose_age_s", ()) if health is not None else ()
        position = sample.positions.get(name)
        rows.append(
            RobotRow(
                name,
                health.state if health is not None else "-",
                ", ".join(health.reasons) if health is not None else "no report yet",
                statistics.median(ages) if ages else None,
                radius_error(position, sample.circle) if position is not None and circling else None,
                gaps.get(name) if circling else None,
                health.numbers.get("command_rate_hz") if health is not None else None,
                collector.calibrated(name),
            )
        )
    all_known = circling and len(sample.positions) == len(scenario.robots)
    return View(
        collector.elapsed,
        scenario.duration,
        rows,
        max(radius_error(p, sample.circle) for p in sample.positions.values()) if all_known else None,
        spacing_error(sample.positions, sample.circle) if all_known else None,
        restarts,
    )
