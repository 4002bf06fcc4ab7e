"""A goal, and the heading to arrive with when the goal specifies none."""

from __future__ import annotations

import math
from typing import NamedTuple

from muro_zenoh.geometry import Pose2


class Destination(NamedTuple):
    """Where to go: ``x``, ``y`` [m, world], and ``theta``, the heading to arrive with [rad], None when it does not
    matter."""

    x: float
    y: float
    theta: float | None = None


def goal_heading(pose: Pose2, x: float, y: float) -> float:
    """The direction from the robot to the goal [rad, (-pi, pi]].

    ``theta = atan2(y_goal - y, x_goal - x)``; at the goal itself (within 1 mm) the heading that the robot has.

    Args:
        pose: the robot's pose [world].
        x: the goal [m, world].
        y: the goal [m, world].

    Source: seed 004, section 4.1, which writes the arctangent in two pieces.
    """
    dx, dy = x - pose.x, y - pose.y
    return math.atan2(dy, dx) if math.hypot(dx, dy) > 1e-3 else pose.theta


def goal_pose(pose: Pose2, x: float, y: float, theta: float | None) -> Pose2:
    """A goal's pose, with :func:`goal_heading` where the goal has no heading.

    Args:
        pose: the robot's pose [world].
        x: the goal [m, world].
        y: the goal [m, world].
        theta: the heading to arrive with [rad], or None.
    """
    return Pose2(x, y, goal_heading(pose, x, y) if theta is None else theta)
