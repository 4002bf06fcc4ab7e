"""What a run to goals was worth, from the robots' true places. Pure; ``docs/scoresheet.md`` defines the numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

from muro_zenoh.control.path_tracking import path_error
from muro_zenoh.geometry import Pose2, wrap_to_pi
from muro_zenoh.planning.path import STRAIGHT, Path

STANDS_BELOW: Final = 0.01
"""A robot slower than this stands [m/s] ..."""

STANDS_TURNING_BELOW: Final = 0.05
"""... when it turns slower than this, too [rad/s] ..."""

STAND: Final = 0.4
"""... for at least so long [s]."""

NEAR: Final = 0.10
"""Who stands so near a goal stands at it, well or badly [m]."""


class Body(NamedTuple):
    """A robot as it truly is: x, y [m, world], theta [rad], v [m/s], omega [rad/s]."""

    x: float
    y: float
    theta: float
    v: float
    omega: float

    @property
    def stands(self) -> bool:
        """Whether it neither drives nor turns."""
        return abs(self.v) < STANDS_BELOW and abs(self.omega) < STANDS_TURNING_BELOW


class Moment(NamedTuple):
    """A robot at one scenario time ``t`` [s]."""

    t: float
    body: Body


class Planned(NamedTuple):
    """A path, and the scenario time from which on the robot followed it [s]."""

    t: float
    path: Path


class Stand(NamedTuple):
    """A stretch of time in which a robot stood: from, to [s], and where at its end."""

    begin: float
    end: float
    body: Body


class Tracked(NamedTuple):
    """How a robot followed its paths.

    Attributes:
        errors: distance from the path while it drove [m].
        peak: greatest speed on a straight [m/s]; None when it never drove on one.
    """

    errors: list[float]
    peak: float | None


def stands(track: Sequence[Moment]) -> list[Stand]:
    """When and where a robot stood.

    Args:
        track: the robot, in order of time.
    """
    found: list[Stand] = []
    since: float | None = None
    for k, (t, body) in enumerate(track):
        if not body.stands:
            since = None
            continue
        if since is None:
            since = t
            found.append(Stand(t, t, body))
        found[-1] = Stand(since, track[k].t, body)
    return [stand for stand in found if stand.end - stand.begin >= STAND - 1e-6]


def score_goals(goals: Sequence[Sequence[float]], track: Sequence[Moment]) -> list[dict[str, Any]]:
    """Each goal of one robot: when it was reached, and how well.

    A goal is reached at the first stand within :data:`NEAR` of it after the goal before was reached. A robot that
    stands there several times, coming nearer, is judged by the last of them.

    Args:
        goals: rows ``(x, y)`` or ``(x, y, theta)`` [m, world; rad], in order.
        track: the robot, in order of time.
    """
    found, k = stands(track), 0
    rows: list[dict[str, Any]] = []
    for goal in goals:
        row: dict[str, Any] = {
            "x": goal[0],
            "y": goal[1],
            "theta": goal[2] if len(goal) > 2 else None,
            "reached_s": None,
            "distance_m": None,
            "heading_rad": None,
        }
        rows.append(row)
        there = k
        while there < len(found) and _distance(found[there].body, goal) > NEAR:
            there += 1
        if there == len(found):
            continue
        while there + 1 < len(found) and _distance(found[there + 1].body, goal) <= NEAR:
            there += 1
        k = there + 1
        at = found[there]
        row["reached_s"] = round(at.begin, 2)
        row["distance_m"] = round(_distance(at.body, goal), 4)
        if len(goal) > 2:
            row["heading_rad"] = round(abs(wrap_to_pi(at.body.theta - goal[2])), 4)
    return rows


def score_tracking(paths: Sequence[Planned], track: Sequence[Moment]) -> Tracked:
    """How near its paths one robot drove, and how fast on their straights.

    Args:
        paths: its paths, in order of time; each holds until the next.
        track: the robot, in order of time.
    """
    errors: list[float] = []
    peak: float | None = None
    k, s = -1, 0.0
    for t, body in track:
        while k + 1 < len(paths) and paths[k + 1].t <= t:
            k, s = k + 1, 0.0
        if k < 0 or abs(body.v) < STANDS_BELOW:
            continue
        path = paths[k].path
        s = path_error(path, Pose2(body.x, body.y, body.theta), s).s
        there = path.pose_at(s)
        errors.append(math.hypot(body.x - there.x, body.y - there.y))
        if abs(path.curvature_at(s)) < STRAIGHT:
            peak = max(peak or 0.0, body.v)
    return Tracked(errors, peak)


def goals_table(goals: Mapping[str, Sequence[Mapping[str, Any]]]) -> dict[str, Any]:
    """All robots' goals in four numbers.

    Args:
        goals: by robot, as :func:`score_goals` has them.
    """
    rows = [row for of_robot in goals.values() for row in of_robot]
    return {
        "goals_asked": len(rows),
        "goals_reached": sum(1 for row in rows if row["reached_s"] is not None),
        "goal_distance_m": max((r["distance_m"] for r in rows if r["distance_m"] is not None), default=None),
        "goal_heading_rad": max((r["heading_rad"] for r in rows if r["heading_rad"] is not None), default=None),
    }


def _distance(body: Body, goal: Sequence[float]) -> float:
    return math.hypot(body.x - goal[0], body.y - goal[1])
