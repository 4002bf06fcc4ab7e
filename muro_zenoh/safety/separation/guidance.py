"""Guidance: from the desired twist to one that others leave room for, by the velocity of the point ahead of the axle.

It is what makes robots pass each other smoothly; it promises nothing. What it gives is certified afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from muro_zenoh.geometry import Bounds, State, Twist2
from muro_zenoh.safety.separation.projection import Row, nearest_velocity

AHEAD: Final = 0.15
"""How far ahead of the axle the guided point is [m]."""
REACTION: Final = 0.2
"""Time until a velocity is changed [s]."""
TURNING: Final = 0.2
"""A robot turns at least as fast as for this speed [m/s]."""
DECELERATION: Final = 0.5
"""How robots are expected to slow down for each other [m/s^2]."""


class Near(NamedTuple):
    """A neighbour now: ``x``, ``y`` [m, world], velocity ``vx``, ``vy`` [m/s], ``keep``, the distance of the centres to
    keep [m], its ``name``, ``theta`` [rad] and ``omega`` [rad/s]; a piece of wall is one that stands."""

    x: float
    y: float
    vx: float
    vy: float
    keep: float
    name: str
    theta: float = 0.0
    omega: float = 0.0


UNHURRIED: Final = 0.2
"""A robot that makes room, or goes back after that, drives no faster [m/s]: nobody makes room for it in turn."""
FIDGET: Final = 0.4
"""A robot that cannot go on turns to and fro with this rate [rad/s]: so others see that it waits."""


def is_busy(other: Near) -> bool:
    """Whether a neighbour drives somewhere, or waits to; one that is parked or makes room does neither.

    Args:
        other: the neighbour.
    """
    speed = math.hypot(other.vx, other.vy)
    return speed > 1.2 * UNHURRIED or (speed < 0.03 and 0.5 * FIDGET < abs(other.omega) < 1.3 * FIDGET)


def approach_speed(free: float) -> float:
    """How fast two robots may approach along the free distance between them, each [m/s]; negative when it lacks.

    Args:
        free: the distance beyond the one to keep [m].
    """
    if free < 0.0:
        return max(free, -0.1)
    reach = DECELERATION * REACTION
    return -reach + math.sqrt(reach * reach + DECELERATION * free)


def rows_of(x: float, y: float, near: Sequence[Near]) -> list[Row]:
    """What the neighbours allow.

    Args:
        x: the robot's position [m, world].
        y: the same.
        near: the neighbours.
    """
    rows = []
    for other in near:
        dx, dy = other.x - x, other.y - y
        away = math.hypot(dx, dy) or 1e-9
        nx, ny = dx / away, dy / away
        leaving = max(0.0, nx * other.vx + ny * other.vy)
        rows.append(Row(nx, ny, approach_speed(away - other.keep) + leaving))
    return rows


def wall_rows(x: float, y: float, inside: Bounds) -> list[Row]:
    """What the walls around the arena allow.

    Args:
        x: the robot's position [m, world].
        y: the same.
        inside: where its centre may be.
    """
    free = (
        (1.0, 0.0, inside.x_max - x),
        (-1.0, 0.0, x - inside.x_min),
        (0.0, 1.0, inside.y_max - y),
        (0.0, -1.0, y - inside.y_min),
    )
    return [Row(nx, ny, approach_speed(away)) for nx, ny, away in free]


def velocity_of(state: State, twist: Twist2) -> tuple[float, float]:
    """The velocity of the point ahead [m/s, world].

    Args:
        state: the robot's state.
        twist: its twist.
    """
    c, s = math.cos(state.theta), math.sin(state.theta)
    across = AHEAD * twist.omega
    return twist.v * c - across * s, twist.v * s + across * c


def twist_for(state: State, vx: float, vy: float, omega_max: float) -> Twist2:
    """The twist that moves the point ahead with a velocity; turning on the spot while that is behind.

    Args:
        state: the robot's state.
        vx: the velocity [m/s, world].
        vy: the same.
        omega_max: largest turning rate [rad/s].
    """
    c, s = math.cos(state.theta), math.sin(state.theta)
    along, across = vx * c + vy * s, -vx * s + vy * c
    speed = math.hypot(along, across)
    omega = across / AHEAD
    if along < 0.0:
        omega, along = math.copysign(speed / AHEAD, across), 0.0
    if 0.0 < speed < TURNING:  # a slow robot need not turn slowly
        omega *= TURNING / speed
    return Twist2(along, min(max(omega, -omega_max), omega_max))


def time_to(x: float, y: float, vx: float, vy: float, other: Near, within: float) -> float:
    """When a robot with a constant velocity comes nearer than it may to a neighbour with a constant velocity [s].

    Args:
        x: its position [m].
        y: the same.
        vx: its velocity [m/s].
        vy: the same.
        other: the neighbour.
        within: the distance [m].

    Returns:
        The time [s]; infinite when they do not meet, 0 when they are nearer already and approach.
    """
    px, py = other.x - x, other.y - y
    wx, wy = vx - other.vx, vy - other.vy
    closing = px * wx + py * wy
    if closing <= 1e-9:
        return math.inf
    c = px * px + py * py - within * within
    if c <= 0.0:
        return 0.0
    a = wx * wx + wy * wy
    inside = closing * closing - a * c
    return (closing - math.sqrt(inside)) / a if inside > 0.0 else math.inf


def guided(state: State, rows: Sequence[Row], vx: float, vy: float, v_max: float, omega_max: float) -> Twist2:
    """The twist for the allowed velocity that is nearest to a preferred one.

    Args:
        state: the robot's state.
        rows: what is allowed.
        vx: the preferred velocity of the point ahead [m/s, world].
        vy: the same.
        v_max: largest speed [m/s].
        omega_max: largest turning rate [rad/s].
    """
    ux, uy = nearest_velocity(rows, vx, vy, v_max)
    return twist_for(state, ux, uy, omega_max)
