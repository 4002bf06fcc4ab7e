"""A run at one moment, from what was collected of it so far: what the live table shows."""

from __future__ import annotations

import statistics
from typing import NamedTuple

from muro_zenoh.config import Scenario
from muro_zenoh.scoring.circle import gaps_ahead, radius_error, spacing_error
from muro_zenoh.scoring.collector import Collector
from muro_zenoh.scoring.observed import Calibrated


class RobotRow(NamedTuple):
    """One robot in the table; None is not known.

    Attributes:
        name: of the robot.
        state: in a word.
        reasons: why it is not driving.
        pose_age: median since the last health [s].
        distance: from the circle [m].
        gap: to the next robot in the direction of travel [rad].
        command_rate: commands per second [Hz].
        calibrated: what was found of its drive.
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
        duration: how long the run takes [s].
        rows: one per robot.
        radius_error: the largest [m]; None while a robot's truth is not known.
        spacing_error: [rad]; the same.
        restarts: of processes.
    """

    t: float
    duration: float
    rows: list[RobotRow]
    radius_error: float | None
    spacing_error: float | None
    restarts: int


def view_of(collector: Collector, scenario: Scenario, restarts: int) -> View:
    """A run as it is now.

    Args:
        collector: what was seen of it.
        scenario: its robots and its duration.
        restarts: of processes.
    """
    sample, asked = collector.latest, collector.asked
    # Robots that are asked for nothing may circle, too: their behaviour is the user's own, or is changed later.
    circling = not (asked.goals or asked.v_min or asked.deployment)
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
