"""How driven wheels follow a command: a first-order lag under an acceleration limit.

The one wheel model of the project: the simulator's plant drives with it, the filter predicts with it when odometry is
silent, and the agent looks ahead with it. Without it the transients of a command bias both drive scales of the filter.

    dv/dt = clip((v_cmd - v) / lag, -limit, +limit),   limit = a_max while |v| grows, brake while |v| falls

Here for plain floats, written out, because agents and bases ask for it all the time; for arrays, and where the sign
changes, see :mod:`muro_zenoh.estimation.limited_lag`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from muro_zenoh.elementwise import FLOATS
from muro_zenoh.estimation.limited_lag import LEAST_LAG, reverse


class WheelLimits(NamedTuple):
    """What a robot's wheels can do.

    ``lag``: time constant of the speed control [s], 0 for ideal wheels. ``a_max``: largest growth of \\|v\\| [m/s^2].
    ``alpha_max``: largest growth of \\|omega\\| [rad/s^2]. ``brake``: largest fall of \\|v\\| [m/s^2].
    """

    lag: float = 0.1
    a_max: float = 0.5
    alpha_max: float = 3.0
    brake: float = 1.0

    @property
    def alpha_brake(self) -> float:
        """Largest fall of \\|omega\\| [rad/s^2]: ``alpha_max * max(1, brake / a_max)``, so a stop ends turning too."""
        return self.alpha_max * max(1.0, self.brake / self.a_max)


def step_wheels(
    v: float, omega: float, v_cmd: float, omega_cmd: float, limits: WheelLimits, dt: float
) -> tuple[float, float]:
    """The speeds of the wheels ``dt`` later, under a command held meanwhile.

    Exact for the equation above at any ``dt``: two half steps end where one whole step does. A change of sign brakes to
    zero first and grows from there.

    Args:
        v: forward speed of the nominal wheels now [m/s].
        omega: turning speed of the nominal wheels now [rad/s].
        v_cmd: commanded forward speed [m/s]. A stop is (0, 0), never a ramp.
        omega_cmd: commanded turning speed [rad/s].
        limits: the wheels' lag and acceleration limits.
        dt: how long the command is held [s], >= 0.

    Returns:
        ``(v, omega)`` after ``dt``.
    """
    return (
        follow(v, v_cmd, limits.a_max, limits.brake, limits.lag, dt),
        follow(omega, omega_cmd, limits.alpha_max, limits.alpha_brake, limits.lag, dt),
    )


def follow(speed: float, target: float, grow: float, fall: float, lag: float, dt: float) -> float:
    """One coordinate of :func:`step_wheels`, forward or turning.

    Args:
        speed: now [m/s] or [rad/s].
        target: commanded, the same unit.
        grow: largest growth of its magnitude [1/s^2 of its unit].
        fall: largest fall of its magnitude, likewise.
        lag: time constant [s].
        dt: how long the command is held [s], >= 0.

    Returns:
        The speed after ``dt``.
    """
    if lag < LEAST_LAG:
        lag = LEAST_LAG
    gap = target - speed
    if gap == 0.0:  # steady, or at rest: most of the time
        return target
    if speed * target < 0.0:
        reversed_speed: float = reverse(FLOATS, speed, target, grow, fall, lag, dt)
        return reversed_speed
    size = abs(gap)
    limit = fall if speed * gap < 0.0 else grow
    ramp = size / limit - lag
    if ramp > dt:
        ramp = dt
    elif not ramp > 0.0:
        ramp = 0.0
    return target - math.copysign((size - limit * ramp) * math.exp((ramp - dt) / lag), gap)
