"""From a desired twist to a command within the robot's limits."""

from __future__ import annotations

import math

from muro_zenoh.geometry import STILL, Twist2


def limit(twist: Twist2, *, v_max: float, omega_max: float) -> Twist2:
    """A twist within limits; one that is not finite gives zero.

    Args:
        twist: the twist [m/s, rad/s].
        v_max: maximum |v| [m/s].
        omega_max: maximum |omega| [rad/s].
    """
    v, omega = twist
    if not math.isfinite(v) or not math.isfinite(omega):
        return STILL
    return Twist2(min(max(v, -v_max), v_max), min(max(omega, -omega_max), omega_max))


def calibrate_and_limit(desired: Twist2, *, cal_v: float, cal_omega: float, v_max: float, omega_max: float) -> Twist2:
    """The command that gives a robot with drive errors the desired twist, within its limits.

    Calibration is applied once, here, before the limits. A twist that is not finite gives zero.

    Args:
        desired: desired twist of the body [m/s, rad/s].
        cal_v: calD, the inverse of the drive scale of v.
        cal_omega: cal0, the inverse of the drive scale of omega.
        v_max: maximum |v| of the command [m/s].
        omega_max: maximum |omega| of the command [rad/s].

    Source: seed 000, sections 4.3 and 8.1 (``u2 = u2*OmegaC; u1 = u1*OmegaD``, then the limits).
    """
    return limit(Twist2(desired.v * cal_v, desired.omega * cal_omega), v_max=v_max, omega_max=omega_max)
