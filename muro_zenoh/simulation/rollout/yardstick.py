"""Lower bounds on the settling times: the references for the laws."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from muro_zenoh.elementwise import Array
from muro_zenoh.geometry import TWO_PI, Circle, Pose2
from muro_zenoh.planning.dubins import WORDS, Word, all_words, path_of
from muro_zenoh.planning.path import Path

_SAMPLE = 0.005


class TangentPath(NamedTuple):
    """The shortest Dubins path from each start to any tangent of a circle, driven at nominal speed.

    ``full``: time to the end of the path, where it touches the circle (N,) [s]. ``enters``: time from which it stays
    within the band (N,) [s]; less than ``full``, because a path enters the band before it ends.
    """

    full: Array
    enters: Array


def shortest_tangent_path(
    starts: Array, circle: Circle, v: float, omega_max: float, band: float = 0.03, tangents: int = 1440
) -> TangentPath:
    """The Dubins reference for circular path following.

    Args:
        starts: poses (N, 3): x, y [m, world], theta [rad].
        circle: the circle and the direction of travel.
        v: speed [m/s].
        omega_max: maximum turning rate [rad/s]; the turning radius is ``v / omega_max``.
        band: a robot within this distance counts as on the circle [m].
        tangents: number of points of the circle to try.

    Returns:
        Times at speed ``v``, exact except for the discrete tangent points: with the default at most 0.2 % too long.

    Source: Dubins, On curves of minimal length, Amer. J. Math. 79, 1957; the words as in seed 004.
    """
    turning = v / omega_max
    angles = np.linspace(0.0, TWO_PI, tangents, endpoint=False)
    goals = np.column_stack(
        (
            circle.x + circle.radius * np.cos(angles),
            circle.y + circle.radius * np.sin(angles),
            angles + circle.sigma * math.pi / 2.0,
        )
    )
    full, enters = np.empty(len(starts)), np.empty(len(starts))
    for i, start in enumerate(starts):
        words = all_words(start, goals, turning)
        tangent, word = divmod(int(np.argmin(words.size)), len(WORDS))
        sizes = (float(column[tangent, word]) for column in words[1:])
        path = path_of(Pose2(*map(float, start)), Word(WORDS[word], *sizes), turning)
        full[i], enters[i] = path.length / v, _enters(path, circle, band) / v
    return TangentPath(full, enters)


def _enters(path: Path, circle: Circle, band: float) -> float:
    """Distance along the path from which it stays within the band [m]."""
    poses = np.array(list(path.sample(_SAMPLE)))
    outside = np.flatnonzero(abs(np.hypot(poses[:, 0] - circle.x, poses[:, 1] - circle.y) - circle.radius) > band)
    return path.length * float(outside[-1]) / (len(poses) - 1) if len(outside) else 0.0


def equal_spacing_bound(
    angles: Array, clockwise: bool, radius: float, v_min: float, v_max: float, tolerance: float = 0.0
) -> Array:
    """The minimum time in which robots on a circle can space themselves evenly, in their present order.

    With ``o_k`` the angle of robot k minus its angle in an even ring, robot k ends at an offset from
    ``o_k + v_min T/r`` to ``o_k + v_max T/r``. The offsets of neighbours on the ring may differ by the tolerance, and
    so those of any two robots by the tolerance times the steps between them. This must be possible for each pair::

        T = r / (v_max - v_min) * max over i, k of (o_i - o_k - tolerance * steps from i to k)

    Args:
        angles: the robots' angles (..., N) [rad].
        clockwise: the direction of travel.
        radius: of the circle [m].
        v_min: minimum speed on the circle [m/s].
        v_max: maximum speed [m/s].
        tolerance: maximum difference of each gap from 2 pi / N [rad].

    Returns:
        T (...) [s].
    """
    n = angles.shape[-1]
    way = np.sort(np.mod(-angles if clockwise else angles, TWO_PI), axis=-1)
    offset = way - np.arange(n) * (TWO_PI / n)
    steps = abs(np.subtract.outer(np.arange(n), np.arange(n)))
    allowed = tolerance * np.minimum(steps, n - steps)
    apart = offset[..., :, None] - offset[..., None, :] - allowed
    spread: Array = apart.max(axis=(-2, -1))
    return spread * radius / (v_max - v_min)
