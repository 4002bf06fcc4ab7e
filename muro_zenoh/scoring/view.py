"""A run at one moment, from what was collected of it so far."""

from __future__ import annotations

import statistics
from typing import NamedTuple

from muro_zenoh.config import Scenario
from muro_zenoh.control import ring
from muro_zenoh.geometry import Circle
from muro_zenoh.scoring.collector import Collector
from muro_zenoh.scoring.sheet import Calibrated, radius_error, spacing_error

_NO_CIRCLE = ("dubins", "coverage", "steer")
"""Scenarios whose robots have nothing to do with the circle."""


class Row(NamedTuple):
    """One robot in the table; None is not known.

    Attributes:
        name: whose row.
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
        duration: how long it goes on [s].
        rows: one per robot.
        radius_error: the largest [m]; None while a robot's truth is not known.
        spacing_error: [rad]; the same.
        restarts: of processes.
    """

    t: float
    duration: float
    rows: list[Row]
    radius_error: float | None
    spacing_error: float | None
    restarts: int


def gaps_ahead(places: dict[str, tuple[float, float]], circle: Circle) -> dict[str, float]:
    """The gap from each robot to the next in the direction of travel [rad]; a whole turn for a robot alone.

    Args:
        places: x, y [m, world] by robot.
        circle: whose centre, and whose direction.
    """
    return ring.gaps_ahead(ring.angles_round(places, circle), circle.clockwise)


def view_of(collector: Collector, scenario: Scenario, restarts: int) -> View:
    """A run as it is now.

    Args:
        collector: what was seen of it.
        scenario: its robots and its duration.
        restarts: of processes.
    """
    sample = collector.latest
    circling = scenario.behaviour.name not in _NO_CIRCLE
    gaps = gaps_ahead(dict(sample.places), sample.circle)
    rows = []
    for name in scenario.robots:
        health = collector.health.get(name)
        ages = health.samples.get("pose_age_s", ()) if health is not None else ()
        place = sample.places.get(name)
        rows.append(
            Row(
                name,
                health.state if health is not None else "-",
                ", ".join(health.reasons) if health is not None else "not heard yet",
                statistics.median(ages) if ages else None,
                radius_error(place, sample.circle) if place is not None and circling else None,
                gaps.get(name) if circling else None,
                health.numbers.get("command_rate_hz") if health is not None else None,
                collector.calibrated(name),
            )
        )
    everybody = circling and len(sample.places) == len(scenario.robots)
    return View(
        collector.elapsed,
        scenario.duration,
        rows,
        max(radius_error(p, sample.circle) for p in sample.places.values()) if everybody else None,
        spacing_error(sample.places, sample.circle) if everybody else None,
        restarts,
    )
