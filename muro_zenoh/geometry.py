"""Planar geometry: poses, twists and angles.

World frame right-handed, x right, y up, theta counter-clockwise from x (REP 103); metres, radians, seconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

TWO_PI = 2.0 * math.pi


class Pose2(NamedTuple):
    """A place and a heading: ``x`` [m], ``y`` [m], ``theta`` [rad, (-pi, pi]] in the world frame."""

    x: float
    y: float
    theta: float

    def compose(self, other: Pose2) -> Pose2:
        """``other``, given in this pose's frame, in the frame that this pose is given in."""
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

    def distance_to(self, other: Pose2) -> float:
        """Distance between this place and that of ``other`` [m]."""
        return math.hypot(other.x - self.x, other.y - self.y)


class Twist2(NamedTuple):
    """A planar velocity in the body frame: ``v`` [m/s] forwards, ``omega`` [rad/s] counter-clockwise."""

    v: float
    omega: float


STILL = Twist2(0.0, 0.0)


class State(NamedTuple):
    """Where a robot is and how fast it really goes: ``x``, ``y`` [m, world], ``theta`` [rad], ``v`` [m/s], ``omega``
    [rad/s]. Each a float, or an array with an entry per robot.
    """

    x: Any
    y: Any
    theta: Any
    v: Any
    omega: Any

    @property
    def pose(self) -> Pose2:
        """The place and heading."""
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


class Circle(NamedTuple):
    """A circle to follow: centre ``x``, ``y`` [m, world], ``radius`` [m]; ``clockwise`` is the direction of travel."""

    x: float
    y: float
    radius: float
    clockwise: bool = False

    @property
    def sigma(self) -> float:
        """+1 for counter-clockwise travel, -1 for clockwise."""
        return -1.0 if self.clockwise else 1.0


@dataclass(frozen=True, slots=True)
class TagMount:
    """A fiducial tag and where it sits on a robot, in the base frame (origin: the middle of the axle, x forwards).

    The tag's own +x runs from its left edge to its right edge as printed, its +y from bottom to top, its origin is its
    centre. With ``yaw`` 0 the print's right edge looks forwards and its top edge to the robot's left.

    Attributes:
        id: the number that the tag encodes.
        size: side of the tag's black square [m].
        x: the tag's centre, forwards of the axle [m].
        y: the tag's centre, to the left of the axle's middle [m].
        yaw: from the base's x to the tag's x, counter-clockwise [rad].

    Raises:
        ValueError: a size that is not positive.
    """

    id: int
    size: float
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def __post_init__(self) -> None:
        if not self.size > 0.0:
            raise ValueError(f"tag {self.id} of size {self.size} m, expected more than 0")

    @property
    def pose(self) -> Pose2:
        """The tag's frame in the base frame."""
        return Pose2(self.x, self.y, wrap_to_pi(self.yaw))


class View(NamedTuple):
    """A point that a camera sees: pixel ``u`` (right), ``v`` (down), and place ``x``, ``y`` [m, world].

    Integer pixels are pixel centres, as in OpenCV: a picture's left edge is at u = -0.5.
    """

    u: float
    v: float
    x: float
    y: float


def straight_down_view(
    x_min: float, y_min: float, x_max: float, y_max: float, width: int, height: int, margin: float = 0.0
) -> tuple[View, View, View, View]:
    """Four points of a camera that looks straight down and sees a whole rectangle with square pixels.

    Args:
        x_min: left edge of the rectangle [m].
        y_min: lower edge [m].
        x_max: right edge [m].
        y_max: upper edge [m].
        width: of the picture [px].
        height: of the picture [px].
        margin: seen beyond each edge, at least [m].

    Returns:
        The rectangle's corners, from the lower left one counter-clockwise. World y is up, the picture's v down.
    """
    metres_per_pixel = max((x_max - x_min + 2.0 * margin) / width, (y_max - y_min + 2.0 * margin) / height)
    x_mid, y_mid = 0.5 * (x_min + x_max), 0.5 * (y_min + y_max)
    u_mid, v_mid = 0.5 * (width - 1), 0.5 * (height - 1)

    def seen(x: float, y: float) -> View:
        return View(u_mid + (x - x_mid) / metres_per_pixel, v_mid - (y - y_mid) / metres_per_pixel, x, y)

    return seen(x_min, y_min), seen(x_max, y_min), seen(x_max, y_max), seen(x_min, y_max)
