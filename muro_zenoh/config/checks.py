"""The checks that a scenario can make of its run, one line each; nothing else is needed to add one.

A line has the limit, a key of ``[checks]`` with its unit, and the key of ``report.json`` to compare with it, as listed
in ``docs/scoresheet.md``; for a key with ``<robot>`` the worst robot counts. :mod:`muro_zenoh.scoring.checks` evaluates
them.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from muro_zenoh.config.schema import Section
from muro_zenoh.quantities import AngleSize, Count, Length, Period, Positive, Rate


class Bound(StrEnum):
    """On which side of its limit a value must be; the limit itself is allowed."""

    AT_MOST = "at most"
    AT_LEAST = "at least"


@dataclass(frozen=True, slots=True)
class Check:
    """The value that a limit applies to.

    Args:
        key: its key in ``report.json``.
        bound: on which side of the limit it must be.
    """

    key: str
    bound: Bound = Bound.AT_MOST


def at_most(key: str) -> Check:
    """An upper limit of a value of the report.

    Args:
        key: its key in ``report.json``.
    """
    return Check(key, Bound.AT_MOST)


def at_least(key: str) -> Check:
    """A lower limit of a value of the report.

    Args:
        key: its key in ``report.json``.
    """
    return Check(key, Bound.AT_LEAST)


class Checks(Section, frozen=True, kw_only=True):
    """What a run must meet for exit code 0; a check that is not set is not made.

    Attributes:
        window: errors are evaluated over this time at the end of the run [s].
    """

    window: Period = 15.0

    settle_time: Annotated[Period | None, at_most("settle_time_s")] = None
    radius_error_p95: Annotated[Length | None, at_most("radius_error_by_robot_m.<robot>.p95")] = None
    spacing_error_p95: Annotated[AngleSize | None, at_most("spacing_error_rad.p95")] = None
    fix_rate: Annotated[Rate | None, at_least("fix_rate_hz.<robot>")] = None
    pose_age_p99: Annotated[Period | None, at_most("pose_age_ms.p99")] = None
    collisions: Annotated[Count | None, at_most("collisions")] = None
    wall_contacts: Annotated[Count | None, at_most("wall_contacts")] = None
    goals_missed: Annotated[Count | None, at_most("goals_missed")] = None
    goal_distance: Annotated[Length | None, at_most("goal_distance_m")] = None
    goal_heading: Annotated[AngleSize | None, at_most("goal_heading_rad")] = None
    tracking_error_p95: Annotated[Length | None, at_most("tracking_error_m.p95")] = None
    peak_speed_ratio: Annotated[Positive | None, at_least("peak_speed_ratio")] = None
    command_ratio: Annotated[Positive | None, at_most("command_ratio")] = None
    coverage_distance: Annotated[Length | None, at_most("coverage.distance_m")] = None
    coverage_gain: Annotated[Positive | None, at_most("coverage.gain")] = None
    coverage_rise: Annotated[Positive | None, at_most("coverage.rise")] = None
    density_error: Annotated[Positive | None, at_most("density_error")] = None
