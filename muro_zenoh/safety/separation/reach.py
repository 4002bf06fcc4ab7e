"""How far a robot can have come toward a place by a time, whatever it does within its limits."""

from __future__ import annotations

import math
from typing import Final

from muro_zenoh.safety.separation.body import Body

_PIECES: Final = 3
_SQUARE: Final = 0.5 * math.pi


def travel_toward(v: float, turn: float, body: Body, time: float) -> float:
    """The most that a robot can approach in one direction, until it is at rest again.

    It speeds up and turns to the direction as fast as it can, forwards or backwards, drives for the time, and brakes; a
    bound from above.

    Args:
        v: its speed now [m/s].
        turn: the angle from its heading to the direction [rad, 0 to pi].
        body: its limits.
        time: how long it drives [s]; below 0 as 0.

    Returns:
        The distance [m], not below 0.
    """
    most = _travel(v, turn, body, time)
    # Backwards it comes nearer only when it drives so now, or has the time to turn its back.
    if v < 0.0 or math.pi - turn - body.omega_max * (max(time, 0.0) + body.lag) < _SQUARE:
        most = max(most, _travel(-v, math.pi - turn, body, time))
    return max(0.0, most)


def _travel(v: float, turn: float, body: Body, time: float) -> float:
    """The same, with the end that ``turn`` belongs to in front."""
    _, v_max, omega_max, a_max, _, brake, lag = body
    come = 0.0
    if v < 0.0:  # the other end is in front: to rest first
        come = -0.5 * v * v / brake * math.cos(turn)
        v, time = 0.0, time + v / brake
    dt = time / _PIECES
    if dt > 0.0:
        if v > v_max:
            v_max = v
        for _ in range(_PIECES):
            before = v
            v += a_max * dt
            if v > v_max:
                v = v_max
            turn -= omega_max * dt
            if turn < _SQUARE:
                if turn <= 0.0:
                    turn = 0.0
                    come += 0.5 * (before + v) * dt
                else:
                    come += 0.5 * (before + v) * dt * math.cos(turn)
    # while it brakes it turns on
    turn = max(0.0, turn - omega_max * lag)
    if turn < _SQUARE:
        come += (0.5 * v * v / brake + lag * v) * math.cos(turn)
    return come
