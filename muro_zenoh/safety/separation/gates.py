"""Right of way where two robots cannot pass: the nearest goes first, those of the other side wait beside the gate."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from muro_zenoh.geometry import Bounds
from muro_zenoh.safety.separation.guidance import Near, is_busy
from muro_zenoh.safety.separation.line import Point, Stretch, nearest_points

_WIDEST: Final = 1.5
"""A passage is a gate below this multiple of what two robots need side by side."""
_ZONE: Final = 1.3
"""Robots this near to a gate's middle take part in its traffic [m]."""
_BESIDE: Final = (0.5, 0.8)
"""Where to wait, from the gate's middle: back from it, and to the robot's right [m]."""


class Gate(NamedTuple):
    """A narrow passage: its middle ``x``, ``y`` [m, world] and the direction across its walls, ``nx``, ``ny``, a unit
    vector along which robots pass; ``half``, half its width [m]."""

    x: float
    y: float
    nx: float
    ny: float
    half: float


def gates_between(walls: Sequence[tuple[float, float, float, float]], arena: Bounds, keep: float) -> list[Gate]:
    """The narrow passages between walls, and between walls and the arena's.

    Args:
        walls: from x, y to x, y [m, world].
        arena: the floor.
        keep: what a robot's centre keeps from a wall [m].
    """
    corners = arena.corners
    edges = [(*corners[k], *corners[(k + 1) % 4]) for k in range(4)]
    gates = []
    for k, wall in enumerate(walls):
        for other in (*walls[k + 1 :], *edges):
            (ax, ay), (bx, by) = nearest_points(_stretch(wall), _stretch(other))
            width = math.hypot(bx - ax, by - ay)
            if 2.0 * keep <= width <= _WIDEST * 4.0 * keep:
                nx, ny = -(by - ay) / width, (bx - ax) / width
                gates.append(Gate(0.5 * (ax + bx), 0.5 * (ay + by), nx, ny, 0.5 * width))
    return gates


def _stretch(wall: tuple[float, float, float, float]) -> Stretch:
    return Stretch(*wall, 0.0, 0.0, 0.0)


def gate_ahead(gates: Sequence[Gate], way: Sequence[Point]) -> Gate | None:
    """The first gate that a planned way goes through; None when there is none near.

    Args:
        gates: all gates.
        way: from the robot's position on [m, world].
    """
    for (ax, ay), (bx, by) in itertools.pairwise(way):
        for gate in gates:
            before = (ax - gate.x) * gate.nx + (ay - gate.y) * gate.ny
            after = (bx - gate.x) * gate.nx + (by - gate.y) * gate.ny
            if before * after <= 0.0 and before != after:
                s = before / (before - after)
                x, y = ax + s * (bx - ax), ay + s * (by - ay)
                if math.hypot(x - gate.x, y - gate.y) <= gate.half and math.dist((gate.x, gate.y), way[0]) < _ZONE:
                    return gate
    return None


def place_to_wait(gate: Gate, x: float, y: float, near: Sequence[Near]) -> Point | None:
    """Where a robot waits that has to let others through first; None when it may go.

    Args:
        gate: the gate in its way.
        x: its position [m, world].
        y: the same.
        near: the neighbours.
    """
    side = (x - gate.x) * gate.nx + (y - gate.y) * gate.ny
    sign = 1.0 if side >= 0.0 else -1.0
    mine = math.hypot(x - gate.x, y - gate.y)
    for other in near:
        if not is_busy(other):
            continue
        px, py = other.x - gate.x, other.y - gate.y
        theirs = math.hypot(px, py)
        across = sign * (px * gate.nx + py * gate.ny)
        coming = sign * (math.cos(other.theta) * gate.nx + math.sin(other.theta) * gate.ny)
        inside = theirs < gate.half + 0.1 and coming > 0.2
        if (inside and theirs < mine) or (across < -0.05 and theirs < mine and coming > -0.5):
            back, right = _BESIDE
            nx, ny = sign * gate.nx, sign * gate.ny
            # looking at the gate, -n, the right is n turned counter-clockwise
            return gate.x + back * nx - right * ny, gate.y + back * ny + right * nx
    return None
