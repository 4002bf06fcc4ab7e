"""Planar geometry: poses, twists and angles.

World frame right-handed, x right, y up, theta counter-clockwise from x (REP 103); metres, radians, seconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

from muro_zenoh.quantities import Coordinate, Count, Height, Length, Quantity, check_quantities

TWO_PI = 2.0 * math.pi


class Pose2(NamedTuple):
    """A position and a heading: ``x`` [m], ``y`` [m], ``theta`` [rad, (-pi, pi]] in the world frame."""

    x: float
    y: float
    theta: float

    def compose(self, other: Pose2) -> Pose2:
        """Transform ``other`` from this pose's frame into the frame of this pose's coordinates."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        return Pose2(
            self.x + c * other.x - s * other.y,
            self.y + s * other.x + c * other.y,
            wrap_to_pi(self.theta + other.theta),
        )

    def inverse(self) -> Pose2:
        """The pose that composes with this one to the identity."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        return Pose2(-c * self.x - s * self.y, s * self.x - c * self.y, wrap_to_pi(-self.theta))


class Twist2(NamedTuple):
    """A planar velocity in the body frame: ``v`` [m/s] forwards, ``omega`` [rad/s] counter-clockwise."""

    v: float
    omega: float


STILL = Twist2(0.0, 0.0)


class State(NamedTuple):
    """A robot's pose and actual speeds: ``x``, ``y`` [m, world], ``theta`` [rad], ``v`` [m/s], ``omega`` [rad/s]. Each
    is a float, or an array with one entry per robot.
    """

    x: Any
    y: Any
    theta: Any
    v: Any
    omega: Any

    @property
    def pose(self) -> Pose2:
        """The position and heading."""
        return Pose2(self.x, self.y, self.theta)


def wrap_to_pi(angle: float) -> float:
    """The same angle in (-pi, pi] [rad].

    Args:
        angle: any [rad].

    Not the second formula of seed 001, ``((pi + a) % 2*pi) - pi``, which binds as ``((pi + a) % 2) * pi - pi``.
    """
    wrapped = math.remainder(angle, TWO_PI)
    return math.pi if wrapped == -math.pi else wrapped


def ccw_gap(start: float, end: float) -> float:
    """The counter-clockwise angle from angle ``start`` to angle ``end``, in [0, 2 pi) [rad]."""
    gap = math.fmod(end - start, TWO_PI)
    if gap < 0.0:
        gap += TWO_PI
    return 0.0 if gap >= TWO_PI else gap


@dataclass(frozen=True, slots=True)
class Circle:
    """A circle to follow.

    Args:
        x: of its centre [m, world].
        y: of its centre [m, world].
        radius: of it [m].
        clockwise: the direction of travel.

    Raises:
        ParameterError: a number outside its limits.
    """

    x: Coordinate
    y: Coordinate
    radius: Length
    clockwise: bool = False

    def __post_init__(self) -> None:
        check_quantities(self)

    @property
    def sigma(self) -> float:
        """+1 for counter-clockwise travel, -1 for clockwise."""
        return -1.0 if self.clockwise else 1.0


@dataclass(frozen=True, slots=True)
class Bounds:
    """The rectangle of floor that robots may use; one with minimum above maximum contains nothing.

    Args:
        x_min: left border [m, world].
        x_max: right border [m, world].
        y_min: lower border [m, world].
        y_max: upper border [m, world].

    Raises:
        ParameterError: a number that is not finite.
    """

    x_min: Coordinate
    x_max: Coordinate
    y_min: Coordinate
    y_max: Coordinate

    def __post_init__(self) -> None:
        check_quantities(self)

    def __str__(self) -> str:
        return f"x {self.x_min:g} to {self.x_max:g}, y {self.y_min:g} to {self.y_max:g} m"

    @property
    def width(self) -> float:
        """From the left border to the right one [m]."""
        return self.x_max - self.x_min

    @property
    def height(self) -> float:
        """From the lower border to the upper one [m]."""
        return self.y_max - self.y_min

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """The four corners, counter-clockwise from the lower left [m, world]."""
        return (
            (self.x_min, self.y_min),
            (self.x_max, self.y_min),
            (self.x_max, self.y_max),
            (self.x_min, self.y_max),
        )

    def holds(self, x: float, y: float, slack: float = 1e-9) -> bool:
        """Whether a position is inside, border included; NaN never is.

        Args:
            x: position [m, world].
            y: position [m, world].
            slack: tolerance outside the border [m], for rounding.
        """
        return self.x_min - slack <= x <= self.x_max + slack and self.y_min - slack <= y <= self.y_max + slack

    def nearest(self, x: float, y: float) -> tuple[float, float]:
        """The position inside that is nearest to a position [m, world].

        Args:
            x: position [m, world].
            y: position [m, world].
        """
        return min(max(x, self.x_min), self.x_max), min(max(y, self.y_min), self.y_max)

    def shrunk(self, margin: float) -> Bounds:
        """The rectangle shrunk by a margin on each side.

        Args:
            margin: the margin [m], such as a robot's radius; below 0 to enlarge the rectangle.
        """
        return Bounds(self.x_min + margin, self.x_max - margin, self.y_min + margin, self.y_max - margin)


@dataclass(frozen=True, slots=True)
class TagMount:
    """A fiducial tag and its mounting pose on a robot, in the base frame (origin: the middle of the axle, x forwards).

    The tag's own +x runs from its left edge to its right edge as printed, its +y from bottom to top, its origin is its
    centre. With ``yaw`` 0 the print's right edge points forwards and its top edge to the robot's left.

    Args:
        id: the tag's number.
        size: side of the tag's black square [m].
        x: the tag's centre, forwards of the axle [m].
        y: the tag's centre, to the left of the axle's middle [m].
        yaw: from the base's x to the tag's x, counter-clockwise [rad].
        z: of the tag above the floor [m].

    Raises:
        ParameterError: a number outside its limits.
    """

    id: Count
    size: Length
    x: Coordinate = 0.0
    y: Coordinate = 0.0
    yaw: Annotated[float, Quantity("rad")] = 0.0
    z: Height = 0.0

    def __post_init__(self) -> None:
        check_quantities(self)

    @property
    def pose(self) -> Pose2:
        """The tag's frame in the base frame."""
        return Pose2(self.x, self.y, wrap_to_pi(self.yaw))


class View(NamedTuple):
    """A point that a camera sees: pixel ``u`` (right), ``v`` (down), and position ``x``, ``y`` [m, world].

    Integer pixels are pixel centres, as in OpenCV: a picture's left edge is at u = -0.5.
    """

    u: float
    v: float
    x: float
    y: float
