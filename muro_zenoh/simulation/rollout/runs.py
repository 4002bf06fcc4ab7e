"""Lock-step runs of the laws: circular path following from random starts, cyclic pursuit from a bunched start."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from muro_zenoh.arrays import ARRAYS
from muro_zenoh.behaviours.circle import CircleFollowing
from muro_zenoh.behaviours.interface import Seen
from muro_zenoh.control.circle import CircleLaw, circle_twist
from muro_zenoh.control.pursuit import PursuitLaw, pursuit_speed
from muro_zenoh.control.ring_arrays import array_gaps
from muro_zenoh.elementwise import Array
from muro_zenoh.geometry import TWO_PI, Circle, State
from muro_zenoh.simulation.rollout.fleet import Fleet
from muro_zenoh.simulation.rollout.settings import LoopSettings

_TURNING = 0.1
"""Above this rate a robot counts as turning [rad/s]; the small corrections on straights do not reveal the scale."""


class CircleRun(NamedTuple):
    """A run of circular path following, sampled after every step of the plant.

    ``time`` (T,) [s]; ``radius_error`` (T, N): true distance from the centre minus the radius [m];
    ``scale_error_v``, ``scale_error_omega`` (P, N): estimated over true drive scales, minus 1, after every period, and
    ``turned`` (P, N): time for which the wheels had turned by then [s]; empty in a loop without the filter.
    """

    time: Array
    radius_error: Array
    scale_error_v: Array
    scale_error_omega: Array
    turned: Array


def follow_circle(
    starts: Array,
    circle: Circle,
    law: CircleLaw,
    v: float,
    settings: LoopSettings,
    rng: np.random.Generator,
    seconds: float,
) -> CircleRun:
    """N independent robots follow a circle from standstill.

    Args:
        starts: poses (N, 3): x, y [m, world], theta [rad].
        circle: the circle and the direction of travel.
        law: the circle law.
        v: desired speed [m/s].
        settings: the loop.
        rng: for everything random.
        seconds: duration [s].
    """
    fleet = Fleet(starts, settings, rng)
    behaviour = CircleFollowing(law, v)
    times: list[float] = []
    errors: list[Array] = []

    def policy(t: float, ahead: State) -> tuple[Any, Any]:
        twist = behaviour.step(Seen(t, ahead, ahead, circle)).twist
        assert twist is not None  # there is a circle, and a speed
        return twist.v, twist.omega

    def watch(t: float, pose: Array) -> None:
        times.append(t)
        errors.append(np.hypot(pose[:, 0] - circle.x, pose[:, 1] - circle.y) - circle.radius)

    scales_v: list[Array] = []
    scales_omega: list[Array] = []
    turned: list[Array] = []
    turning = np.zeros(len(starts))
    for _ in range(round(seconds / settings.period)):
        fleet.step(policy, watch)
        if fleet.filter is not None:
            scales_v.append(fleet.filter.mean.s_v / fleet.plant.s_v - 1.0)
            scales_omega.append(fleet.filter.mean.s_omega / fleet.plant.s_omega - 1.0)
            rate = abs(fleet.plant.odometry_twist[:, 1])
            turning = turning + settings.period * (rate > _TURNING)
            turned.append(turning)
    return CircleRun(np.array(times), np.array(errors), np.array(scales_v), np.array(scales_omega), np.array(turned))


class PursuitRun(NamedTuple):
    """A run of cyclic pursuit, sampled after every step of the plant.

    ``time`` (T,) [s]; ``spacing_error`` (T, trials): maximum over the robots of \\|gap - 2 pi / N\\| [rad];
    ``radius_error`` (T, trials): maximum \\|distance from the centre - radius\\| [m]; ``angle`` (T, trials, N): each
    robot's angle, seen from the centre [rad]. All from the true positions.
    """

    time: Array
    spacing_error: Array
    radius_error: Array
    angle: Array


def pursue_ring(
    starts: Array,
    circle: Circle,
    law: PursuitLaw,
    circle_law: CircleLaw,
    settings: LoopSettings,
    rng: np.random.Generator,
    seconds: float,
) -> PursuitRun:
    """Rings of robots, one per trial, spread on a circle from standstill.

    A robot sees the others as in a snapshot: the position of the newest fix, advanced by the estimated speed times its
    age. In a loop without estimation it sees the truth.

    Args:
        starts: poses (trials, N, 3): x, y [m, world], theta [rad].
        circle: the circle and the direction of travel.
        law: the pursuit law.
        circle_law: the circle law.
        settings: the loop.
        rng: for everything random.
        seconds: duration [s].
    """
    trials, n, _ = starts.shape
    fleet = Fleet(starts.reshape(trials * n, 3), settings, rng)
    times: list[float] = []
    spacings: list[Array] = []
    radii: list[Array] = []
    angles: list[Array] = []

    def policy(t: float, ahead: State) -> tuple[Any, Any]:
        angle = ring_angle(fleet, ahead, circle).reshape(trials, n)
        gap, behind, count = array_gaps(angle, circle.clockwise)
        many = count.astype(np.float64)
        speed: Array = pursuit_speed(law, gap, behind, many, angle, circle.radius, circle.clockwise)
        return circle_twist(ahead, speed.ravel(), circle, circle_law)

    def watch(t: float, pose: Array) -> None:
        x, y = pose[:, 0] - circle.x, pose[:, 1] - circle.y
        angle = np.arctan2(y, x).reshape(trials, n)
        gap, _, _ = array_gaps(angle, circle.clockwise)
        times.append(t)
        angles.append(angle)
        spacings.append(abs(gap - TWO_PI / n).max(axis=1))
        radii.append(abs(np.hypot(x, y) - circle.radius).reshape(trials, n).max(axis=1))

    for _ in range(round(seconds / settings.period)):
        fleet.step(policy, watch)
    return PursuitRun(np.array(times), np.array(spacings), np.array(radii), np.array(angles))


def ring_angle(fleet: Fleet, ahead: State, circle: Circle) -> Array:
    """Each robot's angle on the circle now, from the snapshot (N,) [rad].

    The position of the newest fix, advanced by the tangential speed times its age, as in
    :func:`muro_zenoh.control.ring.ring_angles`.

    Args:
        fleet: the robots.
        ahead: the predicted states.
        circle: the circle.
    """
    fix = fleet.newest_fix
    if fix is None:
        return ARRAYS.atan2(ahead.y - circle.y, ahead.x - circle.x)  # type: ignore[no-any-return]
    x, y = fix.x - circle.x, fix.y - circle.y
    angle = np.arctan2(y, x)
    moved: Array = angle + ahead.v * np.sin(fix.theta - angle) / np.hypot(x, y) * fleet.fix_age
    return moved


def settling_time(time: Array, outside: NDArray[np.bool_]) -> Array:
    """The time after which all samples are inside (N,) [s]; infinite where the last sample is outside.

    Args:
        time: of the samples (T,) [s].
        outside: whether a robot or ring is outside its band (T, N).
    """
    samples = len(time)
    last = samples - 1 - np.argmax(outside[::-1], axis=0)
    settled = np.where(outside.any(axis=0), time[last], 0.0)
    result: Array = np.where(outside[-1], math.inf, settled)
    return result
