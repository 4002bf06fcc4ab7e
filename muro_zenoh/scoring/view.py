"""The state of a run at one moment, for the live table."""

from __future__ import annotations

import statistics
from typing import NamedTuple

from muro_zenoh import channels
from muro_zenoh.config import Scenario
from muro_zenoh.messages import Health
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
        distance: distance from the circle [m]; None unless it is to follow the circle.
        gap: gap to the next robot in the direction of travel [rad]; None unless they are to spread evenly.
        command_rate: commands per second [Hz].
        calibrated: its estimated drive calibration.
        note: why it drives otherwise than its behaviour wants.
        complaints: what is wrong besides.
    """

    name: str
    state: str
    reasons: str
    pose_age: float | None
    distance: float | None
    gap: float | None
    command_rate: float | None
    calibrated: Calibrated
    note: str = ""
    complaints: str = ""

    @property
    def driving(self) -> bool:
        """Whether nothing keeps it from driving, as far as its agent reports."""
        return not self.reasons


class View(NamedTuple):
    """A run at one moment.

    Attributes:
        t: scenario time [s].
        duration: duration of the run [s].
        rows: one per robot.
        radius_error: the largest radius error [m]; None unless the robots are to follow the circle, and while the true
            position of a robot is unknown.
        spacing_error: the spacing error [rad]; None unless they are to spread evenly, and likewise.
        restarts: number of process restarts.
        faults: the scenario's faults that last now.
    """

    t: float
    duration: float
    rows: list[RobotRow]
    radius_error: float | None
    spacing_error: float | None
    restarts: int
    faults: tuple[str, ...] = ()

    @property
    def driving(self) -> int:
        """How many robots drive."""
        return sum(row.driving for row in self.rows)


def view_of(collector: Collector, scenario: Scenario, restarts: int, faults: tuple[str, ...] = ()) -> View:
    """The state of a run now.

    Args:
        collector: the collected data.
        scenario: its robots and its duration.
        restarts: number of process restarts.
        faults: the scenario's faults that last now.
    """
    sample, expected = collector.latest, collector.expected
    gaps = gaps_ahead(sample.positions, sample.circle) if expected.spreads else {}
    rows = []
    for name in scenario.robots:
        health, silence = _current_health(collector, name)
        reasons = ", ".join(health.reasons) if health is not None else silence
        ages = health.samples.get("pose_age_s", ()) if health is not None else ()
        position = sample.positions.get(name)
        rows.append(
            RobotRow(
                name,
                health.state if health is not None else "-",
                reasons or collector.wheels_stopped(name),
                statistics.median(ages) if ages else None,
                radius_error(position, sample.circle) if position is not None and expected.follows_circle else None,
                gaps.get(name),
                health.numbers.get("command_rate_hz") if health is not None else None,
                collector.calibrated(name),
                health.note if health is not None else "",
                ", ".join(health.complaints) if health is not None else "",
            )
        )
    all_known = len(sample.positions) == len(scenario.robots)
    return View(
        collector.elapsed,
        scenario.duration,
        rows,
        max(radius_error(p, sample.circle) for p in sample.positions.values())
        if all_known and expected.follows_circle
        else None,
        spacing_error(sample.positions, sample.circle) if all_known and expected.spreads else None,
        restarts,
        faults,
    )


def _current_health(collector: Collector, name: str) -> tuple[Health | None, str]:
    """What a robot's agent reports, or why that is not known: one that is frozen or blocked does not say so itself."""
    silent = collector.silence(name)
    if silent is None:
        return None, "no report yet"
    if silent > channels.HEALTH.stale_after:
        return None, f"no report for {silent:.0f} s"
    return collector.health[name].message, ""
