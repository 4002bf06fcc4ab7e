"""Telemetry of robots, cameras and the base station: frames, fixes, estimates, commands."""

from __future__ import annotations

import math
from itertools import chain
from operator import attrgetter
from typing import Annotated, Literal

from msgspec import Meta, Struct

from muro_zenoh import geometry
from muro_zenoh.messages.base import LARGEST, Covariance, Message, require_names, require_usable
from muro_zenoh.messages.lease import Text


class Frame(Message, frozen=True, kw_only=True):
    """A picture of an overhead camera. ``data`` is a JPEG, or ``width * height`` grey bytes, row by row."""

    width: Annotated[int, Meta(gt=0, le=16384)]
    height: Annotated[int, Meta(gt=0, le=16384)]
    format: Literal["jpeg", "grey"]
    data: bytes


class PoseFix(Message, frozen=True, kw_only=True):
    """A robot's pose as seen by a camera.

    ``stamp``: when the base station sent it; ``age`` [s]: how long before that the frame was captured; ``x``, ``y``
    [m] and ``theta`` [rad]: the base frame in the world. ``camera``: the cameras that saw it, joined by ``+``, first
    the one whose frame it is.
    """

    age: Annotated[float, Meta(ge=0)]
    x: float
    y: float
    theta: float
    covariance: Covariance
    camera: str

    @property
    def pose(self) -> geometry.Pose2:
        """The position and heading."""
        return geometry.Pose2(self.x, self.y, self.theta)


class Estimate(Message, frozen=True, kw_only=True):
    """The pose filter's estimate at the time ``stamp``. ``v`` and ``omega`` are the actual speeds."""

    x: float
    y: float
    theta: float
    v: float
    omega: float
    covariance: Covariance

    @property
    def pose(self) -> geometry.Pose2:
        """The position and heading."""
        return geometry.Pose2(self.x, self.y, self.theta)


class Calibration(Message, frozen=True, kw_only=True):
    """A drive calibration (``cal0`` multiplies omega, ``calD`` multiplies v) and its standard deviation."""

    value: float
    sigma: float


RobotStatus = Literal["tracking", "silent", "disagrees", "stale", "lost"]
"""``tracking``: seen now. ``silent``: seen, but its agent says nothing, so that nobody knows how fast it drives.
``disagrees``: seen, but away from the agent's estimate. ``stale``: not seen for a short time. ``lost``: not seen for a
longer time; it remains an obstacle at its last position."""


class RobotState(Struct, frozen=True, forbid_unknown_fields=True):
    """One robot in a snapshot; the snapshot checks its values. ``age`` [s]: of the fix of ``x``, ``y``, ``theta``."""

    name: str
    x: float
    y: float
    theta: float
    v: float
    omega: float
    age: float
    state: RobotStatus

    @property
    def pose(self) -> geometry.Pose2:
        """The position and heading."""
        return geometry.Pose2(self.x, self.y, self.theta)


_NUMBER_FIELDS = ("x", "y", "theta", "v", "omega", "age")
_NUMBERS = attrgetter(*_NUMBER_FIELDS)
_NAME = attrgetter("name")


class FleetSnapshot(Message, frozen=True, kw_only=True):
    """All positions, as the cameras see them."""

    robots: tuple[RobotState, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        # Every agent decodes this at each frame. A pattern on the name and a check in each robot would take three times
        # as long as the rest of the decoding.
        require_names(tuple(map(_NAME, self.robots)))
        if not math.hypot(*chain.from_iterable(map(_NUMBERS, self.robots))) <= LARGEST:
            for robot in self.robots:
                for field, value in zip(_NUMBER_FIELDS, _NUMBERS(robot), strict=True):
                    require_usable(f"robots.{robot.name}.{field}", value)


class SpeedReference(Message, frozen=True, kw_only=True):
    """The desired speed of a robot along its path [m/s]. ``operator``: who wants it, while somebody holds the robot."""

    speed: float
    operator: Text = ""


class DriveWish(Message, frozen=True, kw_only=True):
    """How a hand at a stick wants a robot to drive: ``v`` [m/s] forwards, ``omega`` [rad/s] counter-clockwise.
    ``operator``: whose hand it is."""

    v: float
    omega: float
    operator: Text = ""


class VelocityCommand(Message, frozen=True, kw_only=True):
    """A command to the wheels: ``v`` [m/s] forwards, ``omega`` [rad/s] counter-clockwise, after calibration."""

    v: float
    omega: float


class PlannedPath(Message, frozen=True, kw_only=True):
    """A planned path: a start, and a chain of arcs and straights.

    Attributes:
        x: where it begins [m, world].
        y: where it begins [m, world].
        theta: in which direction [rad].
        segments: rows ``(length [m], curvature [1/m])``, the curvature positive to the left, 0 straight on; empty when
            there is no path any more.
        goal_theta: whether the goal specified the heading at the end; otherwise the heuristic chose it.
    """

    x: float
    y: float
    theta: float
    segments: tuple[tuple[float, float], ...]
    goal_theta: bool = False


class Cell(Message, frozen=True, kw_only=True):
    """A robot's Voronoi cell within the arena, and its (density-weighted) centroid.

    Attributes:
        corners: ``(x, y)`` counter-clockwise [m, world]; empty for an empty cell, or none any more.
        x: of the centroid [m, world].
        y: of the centroid [m, world].
    """

    corners: tuple[tuple[float, float], ...]
    x: float
    y: float


class Odometry(Message, frozen=True, kw_only=True):
    """The wheel encoders' pose, in a frame of its own, and twist."""

    x: float
    y: float
    theta: float
    v: float
    omega: float


class Truth(Message, frozen=True, kw_only=True):
    """The true state of a simulated robot. For score sheets and simulated cameras; no other
    task may read it."""

    x: float
    y: float
    theta: float
    v: float
    omega: float


class BaseState(Message, frozen=True, kw_only=True):
    """The state of a base.

    Attributes:
        battery: its charge, in [0, 1].
        charging: whether it is being charged.
        bumper: whether it touches something.
        cliff: whether there is no floor ahead.
        wheel_drop: whether a wheel hangs.
        dead_man: no fresh command, wheels at zero.
        contested: two processes command its wheels, which therefore stand.
        unruly: its wheels do not do what they are commanded: they are blocked, or somebody else turns them.
    """

    battery: float
    charging: bool
    bumper: bool
    cliff: bool
    wheel_drop: bool
    dead_man: bool
    contested: bool = False
    unruly: bool = False
