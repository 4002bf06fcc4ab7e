"""Lock-step runs to goals: along Dubins paths, by point-forward steering, and from round to round of a deployment."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from muro_zenoh.control.point_forward import GoToGoal
from muro_zenoh.control.ride import Ride, RideSettings, is_at, ride_on, set_out
from muro_zenoh.elementwise import Array
from muro_zenoh.geometry import STILL, Bounds, Pose2, Twist2
from muro_zenoh.planning.coverage import Density, Round, lloyd_goal, next_round
from muro_zenoh.planning.destination import Destination
from muro_zenoh.planning.path import Path
from muro_zenoh.simulation.rollout.fleet import Fleet, Seen
from muro_zenoh.simulation.rollout.settings import LoopSettings

_REST = 0.01
_REST_TURNING = 0.1
"""A robot slower than this stands [m/s], [rad/s]."""


class DriveRun(NamedTuple):
    """A run to goals, sampled at every move of the plant; all of it is the truth.

    ``time`` (T,) [s]; ``pose`` (T, N, 3): x, y [m, world], theta [rad]; ``twist`` (T, N, 2): v [m/s], omega [rad/s];
    ``paths``: of each robot, when it planned which path [s].
    """

    time: Array
    pose: Array
    twist: Array
    paths: tuple[tuple[tuple[float, Path], ...], ...]


Step = Callable[[float, Seen], Sequence[Twist2]]
"""``step(t, seen)``: the twist wanted of each robot."""


class _Rider:
    """One robot on its way to one goal at a time, as the behaviour ``dubins`` drives."""

    def __init__(self, settings: RideSettings, dt: float) -> None:
        self.goal: Destination | None = None
        self.paths: list[tuple[float, Path]] = []
        self._ride: Ride | None = None
        self._settings = settings
        self._v = 0.0
        self._dt = dt

    def go(self, goal: Destination) -> None:
        self.goal, self._ride = goal, None

    def step(self, t: float, pose: Pose2) -> Twist2:
        if self.goal is None:
            return STILL
        if self._ride is None:
            if is_at(pose, self.goal, self._settings.profile.tolerance):
                self.goal = None
                return STILL
            self._ride = set_out(pose, self.goal, self._v, self._settings)
            self.paths.append((t, self._ride.path))
        move = ride_on(self._ride, pose, self._dt, self._settings)
        self._ride, self._v = (move.ride if move.state == "on" else None), move.twist.v
        if move.state == "arrived":
            self.goal = None
        return move.twist


def ride_to_goals(
    starts: Array,
    goals: Sequence[Sequence[Destination]],
    ride: RideSettings,
    pause: float,
    settings: LoopSettings,
    rng: np.random.Generator,
    seconds: float,
) -> DriveRun:
    """N robots, each alone, drive to lists of goals along Dubins paths, from standstill.

    Args:
        starts: poses (N, 3): x, y [m, world], theta [rad].
        goals: of each robot, one after the other.
        ride: how to ride.
        pause: time to stand at a goal before the next [s].
        settings: the loop.
        rng: draws all that is random.
        seconds: how long [s].

    Raises:
        PlanningError: a goal that no path inside the arena leads to.
    """
    riders = [_Rider(ride, settings.period) for _ in starts]
    left = [list(reversed(row)) for row in goals]
    next_at = [0.0] * len(starts)

    def step(t: float, seen: Seen) -> list[Twist2]:
        twists = []
        for k, (rider, pose) in enumerate(zip(riders, _poses(seen), strict=True)):
            if rider.goal is None and left[k] and t >= next_at[k]:
                rider.go(left[k].pop())
            twists.append(rider.step(t, pose))
            if rider.goal is not None:
                next_at[k] = t + pause
        return twists

    return _run(starts, step, riders, settings, rng, seconds)


def steer_to_goals(
    starts: Array,
    goals: Sequence[Sequence[Destination]],
    law: GoToGoal,
    pause: float,
    settings: LoopSettings,
    rng: np.random.Generator,
    seconds: float,
) -> DriveRun:
    """N robots, each alone, go to lists of goals by point-forward steering, from standstill.

    Args:
        starts: poses (N, 3): x, y [m, world], theta [rad].
        goals: of each robot, one after the other; headings are not looked at.
        law: the steering law.
        pause: time to stand at a goal before the next [s].
        settings: the loop.
        rng: draws all that is random.
        seconds: how long [s].
    """
    left = [list(row) for row in goals]
    next_at = [0.0] * len(starts)

    def step(t: float, seen: Seen) -> list[Twist2]:
        twists = []
        for k, pose in enumerate(_poses(seen)):
            twist = STILL
            if left[k] and t >= next_at[k]:
                twist = law.twist(pose, left[k][0].x, left[k][0].y)
                if twist == STILL:
                    left[k].pop(0)
                    next_at[k] = t + pause
            twists.append(twist)
        return twists

    return _run(starts, step, (), settings, rng, seconds)


def deploy(
    starts: Array,
    bounds: Bounds,
    density: Density | None,
    ride: RideSettings,
    hold_time: float,
    stay_within: float,
    settings: LoopSettings,
    rng: np.random.Generator,
    seconds: float,
) -> DriveRun:
    """One fleet deploys over a floor: each robot to the centroid of its Voronoi cell, round after round (Lloyd).

    Args:
        starts: poses (N, 3): x, y [m, world], theta [rad].
        bounds: the floor to cover.
        density: how much each place matters; None for all alike.
        ride: how to ride.
        hold_time: all robots have stood for so long when the next round begins [s].
        stay_within: a robot so near its cell's centroid stays where it is [m].
        settings: the loop.
        rng: draws all that is random.
        seconds: how long [s].

    Raises:
        PlanningError: a centroid that no path inside the arena leads to.
    """
    riders = [_Rider(ride, settings.period) for _ in starts]
    inside = ride.bounds.shrunk(ride.margin)
    turn = Round()

    def step(t: float, seen: Seen) -> list[Twist2]:
        nonlocal turn
        rest = bool((abs(seen.v) < _REST).all() and (abs(seen.omega) < _REST_TURNING).all())
        turn = next_round(t, rest, turn, hold_time)
        poses = _poses(seen)
        if turn.due:
            sites = [(pose.x, pose.y) for pose in poses]
            for k, (rider, (x, y)) in enumerate(zip(riders, sites, strict=True)):
                goal_x, goal_y = lloyd_goal(k, sites, bounds, density)
                if (goal_x - x) ** 2 + (goal_y - y) ** 2 > stay_within**2:
                    rider.go(Destination(*inside.nearest(goal_x, goal_y)))
        return [rider.step(t, pose) for rider, pose in zip(riders, poses, strict=True)]

    return _run(starts, step, riders, settings, rng, seconds)


def _poses(seen: Seen) -> list[Pose2]:
    return [Pose2(*row) for row in zip(seen.x.tolist(), seen.y.tolist(), seen.theta.tolist(), strict=True)]


def _run(
    starts: Array,
    step: Step,
    riders: Sequence[_Rider],
    settings: LoopSettings,
    rng: np.random.Generator,
    seconds: float,
) -> DriveRun:
    fleet = Fleet(starts, settings, rng)
    times: list[float] = []
    poses: list[Array] = []
    twists: list[Array] = []

    def policy(t: float, seen: Seen) -> tuple[Array, Array]:
        v, omega = np.array(step(t, seen)).T
        return v, omega

    def watch(t: float, pose: Array) -> None:
        times.append(t)
        poses.append(pose.copy())
        twists.append(fleet.plant.twist.copy())

    for _ in range(round(seconds / settings.period)):
        fleet.step(policy, watch)
    return DriveRun(np.array(times), np.array(poses), np.array(twists), tuple(tuple(r.paths) for r in riders))
