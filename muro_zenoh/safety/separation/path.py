"""The path of a command that is held until the dead-man acts, and of the braking that follows.

The wheels follow as in :mod:`muro_zenoh.estimation.wheel_model`; this is its closed form with the distance, in plain
floats, because a filter looks at many commands in each step.
"""

from __future__ import annotations

import math
from typing import Final

from muro_zenoh.geometry import State, Twist2
from muro_zenoh.safety.separation.body import Body

_PIECES: Final = 4
"""Points of the held part."""
_BRAKING: tuple[float, ...] = (0.12, 0.15, 20.0)
"""Times between the points of the braking part [s]; the last one is until rest, whatever the speed."""
_REST: Final = tuple((0.0, 0.0, dt) for dt in _BRAKING)
_LEAST_LAG: Final = 1e-6


def advance(speed: float, target: float, grow: float, fall: float, lag: float, dt: float) -> tuple[float, float]:
    """The speed of a wheel coordinate after a time, and the distance until then.

    Args:
        speed: now [m/s] or [rad/s].
        target: commanded.
        grow: largest growth of its magnitude per second.
        fall: largest fall of its magnitude per second.
        lag: time constant [s], above 0.
        dt: the time [s].

    Returns:
        The speed after ``dt`` and the distance [m] or angle [rad]. On a change of sign the distance until standstill is
        that of a ramp, which is too far by up to 0.4 mm in a quarter of 0.35 s, 1.6 mm in 0.15 s.
    """
    distance = 0.0
    if speed * target < 0.0:  # to standstill first
        size, rest, knee = abs(target - speed), abs(target), fall * lag
        stopping = (size - max(rest, knee)) / fall if size > max(rest, knee) else 0.0
        if min(size, knee) > rest:
            stopping += lag * math.log(min(size, knee) / rest)
        if stopping < dt:
            distance, speed, dt = 0.5 * speed * stopping, 0.0, dt - stopping
    gap = target - speed
    if gap == 0.0:
        return speed, distance + speed * dt
    limit = fall if speed * gap < 0.0 else grow
    size = abs(gap)
    ramp = size / limit - lag
    if ramp > 0.0:
        rate = math.copysign(limit, gap)
        if ramp >= dt:
            return speed + rate * dt, distance + (speed + 0.5 * rate * dt) * dt
        distance += (speed + 0.5 * rate * ramp) * ramp
        gap -= rate * ramp
        dt -= ramp
    left = gap * math.exp(-dt / lag)
    return target - left, distance + target * dt - lag * (gap - left)


def stopping_distance(v: float, body: Body) -> float:
    """How far a robot travels until it is at rest, braking from now on [m]; negative backwards.

    Args:
        v: its speed [m/s].
        body: its limits.
    """
    return advance(v, 0.0, body.a_max, body.brake, max(body.lag, _LEAST_LAG), _BRAKING[-1])[1]


def braking_path(state: State, command: Twist2, held: float, body: Body) -> list[tuple[float, float]]:
    """Points of the path under a command that is held for a time and then replaced by zero.

    Args:
        state: now [world].
        command: what the wheels follow meanwhile; with ``held`` 0 it is not looked at.
        held: for how long [s].
        body: the robot's limits.

    Returns:
        x, y [m, world] from now to rest, at most 0.1 s apart while the command is held.
    """
    x, y, theta, v, omega = state
    lag, grow, fall = max(body.lag, _LEAST_LAG), body.a_max, body.brake
    turn_grow, turn_fall = body.alpha_max, body.alpha_max * max(1.0, body.brake / body.a_max)
    points = [(x, y)]
    legs = [(command.v, command.omega, held / _PIECES)] * _PIECES if held > 0.0 else []
    for v_goal, omega_goal, dt in (*legs, *_REST):
        # A difference that the lag alone takes away is what is left most of the time: it is written out.
        gap = v_goal - v
        if v * v_goal >= 0.0 and -grow * lag <= gap <= grow * lag and grow <= fall:
            left = gap * math.exp(-dt / lag)
            v, length = v_goal - left, v_goal * dt - lag * (gap - left)
        else:
            v, length = advance(v, v_goal, grow, fall, lag, dt)
        if omega == omega_goal:
            turn = omega * dt
        else:
            gap = omega_goal - omega
            if omega * omega_goal >= 0.0 and -turn_grow * lag <= gap <= turn_grow * lag:
                left = gap * math.exp(-dt / lag)
                omega, turn = omega_goal - left, omega_goal * dt - lag * (gap - left)
            else:
                omega, turn = advance(omega, omega_goal, turn_grow, turn_fall, lag, dt)
        along = theta + 0.5 * turn
        x += length * math.cos(along)
        y += length * math.sin(along)
        theta += turn
        points.append((x, y))
    return points
