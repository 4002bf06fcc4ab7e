"""A goal, whether a robot can be there, and the heading to arrive with when the goal specifies none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from muro_zenoh.errors import ParameterError
from muro_zenoh.geometry import Bounds, Pose2
from muro_zenoh.quantities import Coordinate, Quantity, check_quantities
from muro_zenoh.walls import Wall, require_clear


@dataclass(frozen=True, slots=True)
class Destination:
    """Where to go.

    Args:
        x: of the position [m, world].
        y: of the position [m, world].
        theta: the heading to arrive with [rad]; None when it does not matter.

    Raises:
        ParameterError: a number that is not finite.
    """

    x: Coordinate
    y: Coordinate
    theta: Annotated[float, Quantity("rad")] | None = None

    def __post_init__(self) -> None:
        check_quantities(self)


def require_inside(
    what: str, x: float, y: float, bounds: Bounds, margin: float = 0.0, walls: Sequence[Wall] = ()
) -> None:
    """Refuse a goal that a robot cannot reach.

    Args:
        what: names the goal in the error.
        x: the goal [m, world].
        y: the goal [m, world].
        bounds: the arena.
        margin: distance that the robot's centre keeps from the border [m], such as the robot's radius, and from walls.
        walls: the walls inside the arena.

    Raises:
        ParameterError: the goal is outside the arena, or too near its border or a wall.
    """
    inside = bounds.shrunk(margin)
    if not inside.holds(x, y):
        near, keep = (" or too near its border", f", {margin:g} m inside the border") if margin else ("", "")
        raise ParameterError(
            what,
            got=f"({x:g}, {y:g}), outside the arena{near}",
            expected=f"{inside}{keep}",
            hint="Choose a goal inside.",
        )
    require_clear(what, x, y, walls, margin)


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
