"""How driven wheels follow a command: a first-order lag under an acceleration limit.

The one wheel model of the project: the simulator's plant drives with it, the filter predicts with it when odometry is
silent, and the agent looks ahead with it. Without it the transients of a command bias both drive scales of the filter.

    dv/dt = clip((v_cmd - v) / lag, -limit, +limit),   limit = a_max while |v| grows, brake while |v| falls
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from muro_zenoh import elementwise
from muro_zenoh.elementwise import Scalar

_LEAST_LAG = 1e-6
"""Stands for no lag at all [s]: its decay over any step is exactly zero."""
_TINY = 1e-12


class WheelLimits(NamedTuple):
    """What a robot's wheels can do. Each field is a float, or an array with one entry per robot.

    ``lag``: time constant of the speed control [s], 0 for ideal wheels. ``a_max``: largest growth of \\|v\\| [m/s^2].
    ``alpha_max``: largest growth of \\|omega\\| [rad/s^2]. ``brake``: largest fall of \\|v\\| [m/s^2].
    """

    lag: Any = 0.1
    a_max: Any = 0.5
    alpha_max: Any = 3.0
    brake: Any = 1.0

    @property
    def alpha_brake(self) -> Any:
        """Largest fall of \\|omega\\| [rad/s^2]: ``alpha_max * max(1, brake / a_max)``, so a stop ends turning too."""
        ratio = self.brake / self.a_max
        return self.alpha_max * elementwise.of(ratio).maximum(1.0, ratio)


def step_wheels(
    v: Scalar, omega: Scalar, v_cmd: Scalar, omega_cmd: Scalar, limits: WheelLimits, dt: float
) -> tuple[Scalar, Scalar]:
    """The speeds of the wheels ``dt`` later, under a command held meanwhile.

    Exact for the equation above at any ``dt``: two half steps end where one whole step does. A change of sign brakes to
    zero first and grows from there.

    Args:
        v: forward speed of the nominal wheels now [m/s], float or array.
        omega: turning speed of the nominal wheels now [rad/s], the same shape.
        v_cmd: commanded forward speed [m/s], the same shape. A stop is (0, 0), never a ramp.
        omega_cmd: commanded turning speed [rad/s], the same shape.
        limits: the wheels' lag and acceleration limits.
        dt: how long the command is held [s], >= 0.

    Returns:
        ``(v, omega)`` after ``dt``.
    """
    one: Any = _follow_float if isinstance(v, float) else follow
    return (
        one(v, v_cmd, limits.a_max, limits.brake, limits.lag, dt),
        one(omega, omega_cmd, limits.alpha_max, limits.alpha_brake, limits.lag, dt),
    )


def follow(speed: Scalar, target: Scalar, grow: Any, fall: Any, lag: Any, dt: float) -> Scalar:
    """One coordinate of :func:`step_wheels`, forward or turning.

    Args:
        speed: now [m/s] or [rad/s], float or array.
        target: commanded, the same shape.
        grow: largest growth of its magnitude [1/s^2 of its unit], float or array that broadcasts.
        fall: largest fall of its magnitude, likewise.
        lag: time constant [s], likewise.
        dt: how long the command is held [s], >= 0.

    Returns:
        The speed after ``dt``.
    """
    xp = elementwise.of(speed)
    if xp is elementwise.FLOATS:
        result: Scalar = _follow_float(speed, target, grow, fall, lag, dt)
        return result
    import numpy as np  # only where arrays are

    lag = elementwise.of(lag).maximum(lag, _LEAST_LAG)
    gap = target - speed
    reached = _approach(xp, target, gap, xp.where(speed * gap < 0.0, fall, grow), lag, dt)
    reversing: Any = speed * target < 0.0
    if np.count_nonzero(reversing):  # few are at any one time; any() takes four times as long
        few: list[Any] = [value[reversing] for value in np.broadcast_arrays(speed, target, grow, fall, lag)]
        reached[reversing] = _reverse(xp, few[0], few[1], few[2], few[3], few[4], dt)
    moved: Scalar = reached
    return moved


def _follow_float(speed: Any, target: Any, grow: float, fall: float, lag: float, dt: float) -> Any:
    """:func:`follow` for plain floats, written out, because agents and bases ask for it all the time."""
    if lag < _LEAST_LAG:
        lag = _LEAST_LAG
    gap = target - speed
    if gap == 0.0:  # steady, or at rest: most of the time
        return target
    if speed * target < 0.0:
        return _reverse(elementwise.FLOATS, speed, target, grow, fall, lag, dt)
    size = abs(gap)
    limit = fall if speed * gap < 0.0 else grow
    ramp = size / limit - lag
    if ramp > dt:
        ramp = dt
    elif not ramp > 0.0:
        ramp = 0.0
    return target - math.copysign((size - limit * ramp) * math.exp((ramp - dt) / lag), gap)


def _reverse(xp: Any, speed: Any, target: Any, grow: Any, fall: Any, lag: Any, dt: float) -> Any:
    """The speed after ``dt`` where the sign changes: braked to standstill, then driven from there."""
    # Braking to standstill takes the gap from |gap| down to |target|: a ramp down to the knee, an exponential below it.
    gap = target - speed
    size, rest, knee = abs(gap), xp.maximum(abs(target), _TINY), fall * lag
    braking = xp.maximum(0.0, size - xp.maximum(rest, knee)) / fall
    braking = braking + lag * xp.log(xp.maximum(xp.minimum(size, knee), rest) / rest)
    from_rest = _approach(xp, target, target, grow, lag, xp.maximum(0.0, dt - braking))
    return xp.where(braking < dt, from_rest, _approach(xp, target, gap, fall, lag, dt))


def _approach(xp: Any, target: Any, gap: Any, limit: Any, lag: Any, dt: Any) -> Any:
    """Closed form of the limited lag: a ramp until the gap is ``limit * lag``, then an exponential."""
    size = abs(gap)
    ramp = xp.minimum(xp.maximum(size / limit - lag, 0.0), dt)
    left = (size - limit * ramp) * xp.exp((ramp - dt) / lag)
    return target - xp.copysign(left, gap)
