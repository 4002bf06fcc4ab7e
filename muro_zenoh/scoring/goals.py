"""How well robots reach their goals and follow their paths, from their true positions. Pure."""

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
"""A robot is at rest when it is stationary for at least this time [s]."""

NEAR: Final = 0.10
"""A robot at rest within this distance of a goal has reached it [m]."""

_REPORTED: Final = 1.0
"""Health is sent this often [s]."""


@dataclass(frozen=True, slots=True)
class GoalResult(Table):
    """One goal of a robot, and the accuracy at it."""

    x: Annotated[float, Row("position of the goal, world frame", "m")]
    y: Annotated[float, Row("position of the goal, world frame", "m")]
    theta: Annotated[float | None, Row("heading of the goal; `null` when it has none", "rad")]
    reached_s: Annotated[
        float | None, Row("scenario time at which the robot came to rest there; `null` when it did not", "s", 2)
    ] = None
    distance_m: Annotated[float | None, Row("distance of the robot at rest there from the goal", "m", 4)] = None
    heading_rad: Annotated[
        float | None, Row("angle between the heading of the robot at rest there and that of the goal", "rad", 4)
    ] = None


class Rest(NamedTuple):
    """A period in which a robot was stationary: begin, end [s], and the robot at its end."""

    begin: float
    end: float
    body: Body


class Tracked(NamedTuple):
    """How a robot followed its paths.

    Attributes:
        errors: distances from the path while it drove, unless others had diverted it from that path [m].
        peak: maximum speed on a straight [m/s]; None when it never drove on one.
    """

    errors: list[float]
    peak: float | None


def rests(track: Sequence[Moment]) -> list[Rest]:
    """When and where a robot was at rest.

    Args:
        track: the robot, in order of time.
    """
    found: list[Rest] = []
    since: float | None = None
    for t, body, _ in track:
        if not body.stationary:
            since = None
            continue
        if since is None:
            since = t
            found.append(Rest(t, t, body))
        found[-1] = Rest(since, t, body)
    return [rest for rest in found if rest.end - rest.begin >= REST - 1e-6]


def score_goals(goals: Sequence[Sequence[float]], track: Sequence[Moment]) -> tuple[GoalResult, ...]:
    """For each goal of one robot, when it was reached, and the accuracy there.

    A goal is reached at the first rest within :data:`NEAR` of it after the previous goal was reached. When a robot
    rests there several times, each time nearer, the last rest counts.

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
    """One robot's distance from its paths, and its maximum speed on their straights.

    A path from which the robot was diverted, to keep clear of others, does not count from then on: how far it is off
    says nothing of its law. Health says so up to :data:`_REPORTED` later, so that much before is left out as well.

    Args:
        paths: its paths, in order of time; each is valid until the next.
        track: the robot, in order of time.
    """
    errors: list[float] = []
    peak: float | None = None
    k, s = -1, 0.0
    on_path: dict[float, float] = {}
    off = False
    for t, body, diverted in track:
        while k + 1 < len(paths) and paths[k + 1].t <= t:
            errors += on_path.values()
            k, s, on_path, off = k + 1, 0.0, {}, False
        if diverted and not off:
            on_path, off = {at: error for at, error in on_path.items() if at < t - _REPORTED}, True
        if k < 0 or abs(body.v) < STATIONARY_SPEED:
            continue
        path = paths[k].path
        s = path_error(path, Pose2(body.x, body.y, body.theta), s).s
        nearest = path.pose_at(s)
        if not off:
            on_path[t] = math.hypot(body.x - nearest.x, body.y - nearest.y)
        if abs(path.curvature_at(s)) < STRAIGHT:
            peak = max(peak or 0.0, body.v)
    return Tracked([*errors, *on_path.values()], peak)


def _distance(body: Body, goal: Sequence[float]) -> float:
    return math.hypot(body.x - goal[0], body.y - goal[1])
