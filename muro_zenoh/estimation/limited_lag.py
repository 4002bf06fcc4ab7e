"""The equation of :mod:`muro_zenoh.estimation.wheel_model` in closed form: for arrays, and where the sign changes."""

from __future__ import annotations

from typing import Any, Final

from muro_zenoh import elementwise
from muro_zenoh.elementwise import Array

LEAST_LAG: Final = 1e-6
"""Stands for no lag at all [s]: its decay over any step is exactly zero."""
_TINY: Final = 1e-12


def follow_array(speed: Array, target: Array, grow: Array, fall: Array, lag: float | Array, dt: float) -> Array:
    """:func:`muro_zenoh.estimation.wheel_model.follow` for many at once.

    Args:
        speed: now [m/s] or [rad/s].
        target: commanded, the same shape.
        grow: largest growth of its magnitude [1/s^2 of its unit], broadcasts.
        fall: largest fall of its magnitude, likewise.
        lag: time constant [s], likewise.
        dt: how long the command is held [s], >= 0.

    Returns:
        The speeds after ``dt``, of the same shape.
    """
    import numpy as np  # only where arrays are

    xp = elementwise.of(speed)
    lag = elementwise.of(lag).maximum(lag, LEAST_LAG)
    gap = target - speed
    reached: Array = _approach(xp, target, gap, xp.where(speed * gap < 0.0, fall, grow), lag, dt)
    reversing = speed * target < 0.0
    if np.count_nonzero(reversing):  # few are at any one time; any() takes four times as long
        few = [value[reversing] for value in np.broadcast_arrays(speed, target, grow, fall, lag)]
        reached[reversing] = reverse(xp, few[0], few[1], few[2], few[3], few[4], dt)
    return reached


def reverse(xp: Any, speed: Any, target: Any, grow: Any, fall: Any, lag: Any, dt: float) -> Any:
    """The speed after ``dt`` where the sign changes: braked to standstill, then driven from there.

    Args:
        xp: the functions for floats or for arrays, of :mod:`muro_zenoh.elementwise`; all others are such.
        speed: now [m/s] or [rad/s].
        target: commanded, of the other sign.
        grow: largest growth of its magnitude [1/s^2 of its unit].
        fall: largest fall of its magnitude, likewise.
        lag: time constant [s], at least :data:`LEAST_LAG`.
        dt: how long the command is held [s], >= 0.
    """
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
