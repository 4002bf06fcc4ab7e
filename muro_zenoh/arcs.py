"""Arcs: the motion of a unicycle at constant speeds. The only place where a pose is integrated.

A unicycle that turns by ``turn`` over ``length`` ends at the end of the arc's chord, which points along the mid
heading and is shorter than the arc by ``sinc(turn / 2)``: exact for any turn. Floats, or arrays that broadcast.
"""

from __future__ import annotations

import math
from typing import Any

from muro_zenoh import elementwise
from muro_zenoh.geometry import Pose2, wrap_to_pi


def chord(theta: Any, length: Any, half: Any) -> tuple[Any, Any, Any]:
    """The chord of an arc.

    Args:
        theta: heading at its start [rad].
        length: length of the arc [m], below 0 backwards.
        half: half of the turn from its start to its end, counter-clockwise [rad].

    Returns:
        Length of the chord [m], below 0 backwards; cosine and sine of its direction [world].
    """
    if isinstance(theta, float):  # written out: an agent's filter asks for it some hundred times a second
        along = theta + half
        return length * (math.sin(half) / half if half else 1.0), math.cos(along), math.sin(along)
    xp = elementwise.of(theta)
    sin, cos = xp.sincos(theta + half)
    return length * xp.sinc(half), cos, sin


def carry(x: Any, y: Any, theta: Any, v: Any, omega: Any, dt: Any) -> tuple[Any, Any, Any]:
    """A pose moved along one arc.

    Args:
        x: position [m, world].
        y: position [m, world].
        theta: heading [rad].
        v: speed [m/s].
        omega: turning rate [rad/s].
        dt: duration [s].

    Returns:
        x, y [m, world] and theta [rad], not wrapped.
    """
    half = 0.5 * dt * omega
    reach, cos, sin = chord(theta, dt * v, half)
    return x + reach * cos, y + reach * sin, theta + 2.0 * half


def advance(pose: Pose2, v: float, omega: float, dt: float) -> Pose2:
    """:func:`carry` for a pose as a value, with its heading wrapped.

    Args:
        pose: the unicycle's pose [world].
        v: speed [m/s].
        omega: turning rate [rad/s].
        dt: duration [s]; below 0 for a pose in the past.
    """
    half = 0.5 * dt * omega
    reach, cos, sin = chord(pose.theta, dt * v, half)
    return Pose2(pose.x + reach * cos, pose.y + reach * sin, wrap_to_pi(pose.theta + 2.0 * half))
