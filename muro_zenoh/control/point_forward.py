"""Point-forward steering to an angle and to a goal.

A unicycle cannot move sideways, but the point ``l`` ahead of its axle can move in any direction: command that point to
move at ``V`` in the direction ``phi``, and speed and turning rate follow, with ``l`` the only parameter (seed 001,
eq. 5.4)::

    alpha = wrap(phi - theta),   v = V cos(alpha),   omega = (V / l) sin(alpha)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Final, NamedTuple

from muro_zenoh.elementwise import Scalar, of
from muro_zenoh.geometry import STILL, Pose2, Twist2
from muro_zenoh.quantities import Length, Quantity, Speed, check_quantities

REVERSE_LIMIT: Final = 0.75 * math.pi
"""The limit on reversing that seed 001 suggests: 3 pi / 4."""


def steer_to_angle(
    theta: Scalar, phi: Scalar, speed: Scalar, ahead: float, reverse_from: float = math.pi
) -> tuple[Scalar, Scalar]:
    """Speed and turning rate that turn the robot towards an angle as it drives; floats or arrays.

    With ``alpha = wrap(phi - theta)``::

        v = V cos(alpha),   omega = (V / l) sin(alpha)

    Between a quarter turn and ``reverse_from`` the robot drives backwards while it turns to the angle, as the page's
    law does. Where ``|alpha|`` is beyond ``reverse_from`` it turns on the spot at the full rate instead::

        v = 0,   omega = (V / l) sign(alpha)

    ``reverse_from = pi`` allows all reversing, ``pi / 2`` forbids it, :data:`REVERSE_LIMIT` is the page's suggestion.

    Args:
        theta: heading [rad].
        phi: the direction to drive in [rad].
        speed: V, the commanded speed of the point ahead [m/s], not below 0.
        ahead: l, how far ahead of the axle that point is [m], above 0.
        reverse_from: reversing is forbidden for ``|alpha|`` beyond this [rad, pi / 2 to pi].

    Returns:
        ``v`` [m/s] and ``omega`` [rad/s]; the limits belong to `drive`.

    Source: seed 001, eq. 5.4 and section 5.4.2.2.
    """
    xp = of(theta)
    alpha = xp.wrap(phi - theta)
    forbidden = abs(alpha) > reverse_from
    v: Scalar = xp.where(forbidden, 0.0 * alpha, speed * xp.cos(alpha))
    sine = xp.where(forbidden, xp.copysign(1.0, alpha), xp.sin(alpha))
    omega: Scalar = speed / ahead * sine
    return v, omega


@dataclass(frozen=True, slots=True)
class GoToGoal:
    """Point-forward steering to a position.

    Args:
        speed: maximum speed [m/s], above 0.
        ahead: l, how far ahead of the axle the steered point is [m], above 0.
        slope: speed per remaining distance near the goal [1/s], above 0: the robot slows down within ``speed / slope``.
        tolerance: the robot stops within this distance of the goal [m], above 0.
        reverse_from: reversing is forbidden beyond this angle from the goal [rad, pi / 2 to pi].

    Raises:
        ParameterError: a number outside those ranges.
    """

    speed: Speed = 0.2
    ahead: Length = 0.15
    slope: Annotated[float, Quantity("1/s", above=0.0)] = 1.0
    tolerance: Length = 0.02
    # Limits rounded to four digits in a settings file are still within the limits.
    reverse_from: Annotated[float, Quantity("rad", at_least=round(math.pi / 2, 3) - 1e-3, at_most=3.1426)] = math.pi / 2

    def __post_init__(self) -> None:
        check_quantities(self)

    def twist(self, pose: Pose2, x: float, y: float) -> Twist2:
        """The twist that takes the robot to a position; zero within the tolerance.

        Args:
            pose: the robot's pose [world].
            x: the goal [m, world].
            y: the goal [m, world].
        """
        dx, dy = x - pose.x, y - pose.y
        distance = math.hypot(dx, dy)
        if distance <= self.tolerance:
            return STILL
        speed = min(self.speed, self.slope * distance)
        return Twist2(*steer_to_angle(pose.theta, math.atan2(dy, dx), speed, self.ahead, self.reverse_from))


class WheelSpeeds(NamedTuple):
    """Speeds of both wheels: m/s at the rim, or rad/s when divided by the wheel's radius.

    Args:
        left: the left wheel's.
        right: the right wheel's.
    """

    left: Any
    right: Any


def wheel_speeds(v: Scalar, omega: Scalar, wheel_base: float, wheel_radius: float | None = None) -> WheelSpeeds:
    """The wheel speeds of a differential drive for a twist; floats or arrays.

    ``right = (v + omega L / 2) / R``, ``left = (v - omega L / 2) / R``; for the point-forward law this is the page's
    ``V (cos alpha +- K sin alpha)`` with ``K = L / (2 l)``, for which 1/2 to 1 is sensible.

    Args:
        v: speed [m/s].
        omega: turning rate [rad/s].
        wheel_base: L, distance between the wheels [m].
        wheel_radius: R [m]; None leaves the speeds in m/s at the rim.

    Source: seed 001, section 5.4.2.3.
    """
    scale = 1.0 if wheel_radius is None else wheel_radius
    half = 0.5 * wheel_base * omega
    return WheelSpeeds((v - half) / scale, (v + half) / scale)


def turning_gain(wheel_base: float, ahead: float) -> float:
    """K = L / (2 l) of seed 001 [-].

    Args:
        wheel_base: L, distance between the wheels [m].
        ahead: l, how far ahead of the axle the steered point is [m].
    """
    return wheel_base / (2.0 * ahead)
