"""How far a robot can have come toward a place by a time, whatever it does within its limits."""

from __future__ import annotations

import math
from typing import Final

from muro_zenoh.safety.separation.body import Body

_PIECES: Final = 3


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
    return max(0.0, _travel(v, turn, body, time), _travel(-v, math.pi - turn, body, time))


def _travel(v: float, turn: float, body: Body, time: float) -> float:
    """The same, with the end that ``turn`` belongs to in front."""
    come = 0.0
    if v < 0.0:  # the other end is in front: to rest first
        come = -0.5 * v * v / body.brake * math.cos(turn)
        v, time = 0.0, time + v / body.brake
    dt = max(time, 0.0) / _PIECES
    if dt > 0.0:
        for _ in range(_PIECES):
            before, v = v, min(max(body.v_max, v), v + body.a_max * dt)
            turn = max(0.0, turn - body.omega_max * dt)
            if turn < 0.5 * math.pi:
                come += 0.5 * (before + v) * dt * math.cos(turn)
    # while it brakes it turns on
    turn = max(0.0, turn - body.omega_max * body.lag)
    if turn < 0.5 * math.pi:
        come += (0.5 * v * v / body.brake + body.lag * v) * math.cos(turn)
    return come
