"""How well robots went to their goals, and along their paths, from their true positions. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final, NamedTuple

from muro_zenoh.control.path_tracking import path_error
from muro_zenoh.geometry import Pose2, wrap_to_pi
from muro_zenoh.planning.path import STRAIGHT
from muro_zenoh.scoring.observed import STATIONARY_SPEED, Body, Moment, Planned
from muro_zenoh.scoring.rows import Row, Table

REST: Final = 0.4
"""A robot rests when it is stationary for at least this long [s]."""

NEAR: Final = 0.10
"""A robot that rests within this distance of a goal rests at that goal, however badly [m]."""


@dataclass(frozen=True, slots=True)
class GoalResult(Table):
    """One goal of a robot, and how well it was reached."""

    x: Annotated[float, Row("where the goal is, world frame", "m")]
    y: Annotated[float, Row("where the goal is, world frame", "m")]
    theta: Annotated[float | None, Row("the heading asked for; `null` when none is", "rad")]
    reached_s: Annotated[
        float | None, Row("scenario time at which the robot came to rest there; `null` when it did not", "s", 2)
    ] = None
    distance_m: Annotated[float | None, Row("distance of the robot at rest there from the goal", "m", 4)] = None
    heading_rad: Annotated[
        float | None, Row("angle between the heading of the robot at rest there and the one asked for", "rad", 4)
    ] = None


class Rest(NamedTuple):
    """A stretch of time in which a robot was stationary: from, to [s], and where it was at its end."""

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


def rests(track: Sequence[Moment]) -> list[Rest]:
    """When and where a robot rested.

    Args:
        track: the robot, in order of time.
    """
    found: list[Rest] = []
    since: float | None = None
    for t, body in track:
        if not body.stationary:
            since = None
            continue
        if since is None:
            since = t
            found.append(Rest(t, t, body))
        found[-1] = Rest(since, t, body)
    return [rest for rest in found if rest.end - rest.begin >= REST - 1e-6]


def score_goals(goals: Sequence[Sequence[float]], track: Sequence[Moment]) -> tuple[GoalResult, ...]:
    """Each goal of one robot: when it was reached, and how well.

    A goal is reached at the first rest within :data:`NEAR` of it after the goal before was reached. A robot that rests
    there several times, coming nearer, is judged by the last of them.

    Args:
        goals: rows ``(x, y)`` or ``(x, y, theta)`` [m, world; rad], in order.
        track: the robot, in order of time.
    """
    found, k = rests(track), 0
    results: list[GoalResult] = []
    for goal in goals:
        theta = goal[2] if len(goal) > 2 else None
        at = k
        while at < len(found) and _distance(found[at].body, goal) > NEAR:
            at += 1
        if at == len(found):
            results.append(GoalResult(goal[0], goal[1], theta))
            continue
        while at + 1 < len(found) and _distance(found[at + 1].body, goal) <= NEAR:
            at += 1
        k = at + 1
        rest = found[at]
        heading = abs(wrap_to_pi(rest.body.theta - theta)) if theta is not None else None
        results.append(GoalResult(goal[0], goal[1], theta, rest.begin, _distance(rest.body, goal), heading))
    return tuple(results)


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
        if k < 0 or abs(body.v) < STATIONARY_SPEED:
            continue
        path = paths[k].path
        s = path_error(path, Pose2(body.x, body.y, body.theta), s).s
        nearest = path.pose_at(s)
        errors.append(math.hypot(body.x - nearest.x, body.y - nearest.y))
        if abs(path.curvature_at(s)) < STRAIGHT:
            peak = max(peak or 0.0, body.v)
    return Tracked(errors, peak)


def _distance(body: Body, goal: Sequence[float]) -> float:
    return math.hypot(body.x - goal[0], body.y - goal[1])
