"""Following a planned path: the Frenet law, and one step of the path follower.

In the frame of the nearest point of the path, with ``l`` the lateral offset (left of the path positive), ``dtheta`` the
heading error and ``c`` the path's signed curvature, a unicycle obeys::

    d l / dt      = v sin(dtheta)
    d s / dt      = v cos(dtheta) / (1 - c l)
    d dtheta / dt = omega - c d s / dt
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Final, NamedTuple

from muro_zenoh.control.speed_profile import SpeedProfile, path_speed
from muro_zenoh.elementwise import Scalar, of
from muro_zenoh.geometry import Pose2, Twist2, wrap_to_pi
from muro_zenoh.planning.path import Path
from muro_zenoh.quantities import Positive, Quantity, check_quantities

GUARD: Final = 0.1
"""Minimum of ``1 - c l`` to divide by [-]: it is 0 at the centre of an arc."""


@dataclass(frozen=True, slots=True)
class TrackingGains:
    """Gains of :func:`frenet_law`.

    Args:
        ka: lateral gain [1/m^2]: near the path the error falls over a distance of about ``1 / sqrt(ka)``.
        zeta: damping [-]; ``kb = 2 zeta |v| sqrt(ka)``.

    Raises:
        ParameterError: a gain not above 0.
    """

    ka: Annotated[float, Quantity("1/m^2", above=0.0)] = 30.0
    zeta: Positive = 0.9

    def __post_init__(self) -> None:
        check_quantities(self)

    @property
    def lateral_max(self) -> float:
        """The offset [m] that demands a heading of about 90 degrees to the path; a larger one would turn back."""
        # There d^2 / sin(d) = sqrt(ka) l / (2 zeta) with d = 1.3 rad.
        return 1.75 * 2.0 * self.zeta / math.sqrt(self.ka)


def frenet_law(lateral: Scalar, dtheta: Scalar, curvature: Scalar, v: Scalar, gains: TrackingGains) -> Scalar:
    """Turning rate [rad/s] that takes a unicycle to a path and along it; floats or arrays.

    ::

        omega = -ka v l sinc(dtheta) - kb dtheta + v cos(dtheta) c / (1 - c l),   kb = 2 zeta |v| sqrt(ka)

    with ``sinc(x) = sin(x) / x``, so that d dtheta / dt = -ka v l sinc(dtheta) - kb dtheta exactly, and
    ``ka l^2 / 2 + dtheta^2 / 2`` falls. Near the centre of an arc ``1 - c l`` is held at :data:`GUARD`. The seed prints
    ``1 + c l`` for an offset of the other sign, and a gain on the last term that must be 1. At ``v = 0`` it does not
    turn.

    Args:
        lateral: l, how far left of the path [m].
        dtheta: heading minus the path's [rad, (-pi, pi]].
        curvature: c, the path's at its nearest point [1/m], to the left positive.
        v: speed [m/s].
        gains: the gains.

    Source: seed 004, section 4.4 (de Luca, Oriolo, Samson: Feedback control of a nonholonomic car-like robot, 1998).
    """
    xp = of(dtheta)
    kb = 2.0 * gains.zeta * abs(v) * math.sqrt(gains.ka)
    room = xp.maximum(1.0 - curvature * lateral, GUARD)
    omega: Scalar = -gains.ka * v * lateral * xp.sinc(dtheta) - kb * dtheta + v * xp.cos(dtheta) * curvature / room
    return omega


_TURN = 0.9 * math.pi
"""Maximum turn of the path within the search [rad]; beyond half a turn the far side of a tight arc may be nearest."""


class PathError(NamedTuple):
    """Where a robot is relative to a path.

    Args:
        s: the distance along the path to its nearest point [m].
        lateral: how far left of it the robot is [m].
        dtheta: heading minus the path's there [rad, (-pi, pi]].
        curvature: the path's there [1/m], to the left positive.
    """

    s: float
    lateral: float
    dtheta: float
    curvature: float


def path_error(path: Path, pose: Pose2, s: float, behind: float = 0.1, ahead: float = 0.4) -> PathError:
    """Where a robot is relative to a path, searched near its last position because a path may cross itself.

    Args:
        path: the path.
        pose: the robot's pose [world].
        s: the distance along the path at the previous step [m]; 0 at first.
        behind: how far back to search for the nearest point [m].
        ahead: how far forward to search [m]; more than a robot drives in one step. In both directions the search ends
            where the path has turned by :data:`_TURN`.
    """
    s = path.project(pose.x, pose.y, s - path.reach(s, -behind, _TURN), s + path.reach(s, ahead, _TURN))
    there = path.pose_at(s)
    dx, dy = pose.x - there.x, pose.y - there.y
    lateral = math.cos(there.theta) * dy - math.sin(there.theta) * dx
    return PathError(s, lateral, wrap_to_pi(pose.theta - there.theta), path.curvature_at(s))


class Progress(NamedTuple):
    """The state of :func:`follow_path`.

    Args:
        s: the distance along the path so far [m].
        v: the previous speed command [m/s].
    """

    s: float = 0.0
    v: float = 0.0


class FollowStep(NamedTuple):
    """The result of :func:`follow_path`.

    Args:
        twist: the desired twist.
        progress: the state for the next step.
        error: where the robot is relative to the path.
        to_go: the remaining distance [m].
        arrived: whether it is within the tolerance; the twist's speed is then 0.
    """

    twist: Twist2
    progress: Progress
    error: PathError
    to_go: float
    arrived: bool


def follow_path(
    path: Path, pose: Pose2, progress: Progress, dt: float, gains: TrackingGains, profile: SpeedProfile
) -> FollowStep:
    """One step along a path: speed by the profile, turning by the Frenet law.

    Args:
        path: the path.
        pose: the robot's pose [world].
        progress: from the previous step; ``Progress()`` on a new path, with ``v`` kept if the robot is driving.
        dt: time since the previous step [s].
        gains: the tracking gains.
        profile: the speed limits.
    """
    error = path_error(path, pose, progress.s)
    v = path_speed(path, error.s, progress.v, dt, profile)
    lateral = min(max(error.lateral, -gains.lateral_max), gains.lateral_max)
    omega = frenet_law(lateral, error.dtheta, error.curvature, v, gains)
    to_go = path.length - error.s
    return FollowStep(Twist2(v, omega), Progress(error.s, v), error, to_go, to_go <= profile.tolerance)
