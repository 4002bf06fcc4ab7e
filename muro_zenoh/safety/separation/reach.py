"""How far a robot can have come toward a place by a time, whatever it does within its limits."""

from __future__ import annotations

import math
from typing import Final

from muro_zenoh.safety.separation.body import Body

_PIECES: Final = 3
_BACKWARDS: Final = 0.02
"""A robot that drives backwards faster than this may go anywhere [m/s]."""


def travel_toward(v: float, turn: float, body: Body, time: float) -> float:
    """The most that a robot can approach in one direction, until it is at rest again.

    It speeds up and turns to the direction as fast as it can, drives for the time, and brakes; a bound from above.

    Args:
        v: its speed now [m/s].
        turn: the angle from its heading to the direction [rad, 0 to pi].
        body: its limits.
        time: how long it drives [s]; below 0 as 0.

    Returns:
        The distance [m], not below 0.
    """
    if v < -_BACKWARDS:
        turn = 0.0
    v = abs(v)
    dt = max(time, 0.0) / _PIECES
    come = 0.0
    if dt > 0.0:
        for _ in range(_PIECES):
            v = min(max(body.v_max, v), v + body.a_max * dt)
            turn = max(0.0, turn - body.omega_max * dt)
            if turn < 0.5 * math.pi:
                come += v * dt * math.cos(turn)
    # while it brakes it turns on
    turn = max(0.0, turn - body.omega_max * body.lag)
    if turn < 0.5 * math.pi:
        come += (0.5 * v * v / body.brake + body.lag * v) * math.cos(turn)
    return come
