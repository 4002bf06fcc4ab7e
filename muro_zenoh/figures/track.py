"""Runs of the lock-step rollout of which the whole way is kept."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from muro_zenoh.elementwise import Array
from muro_zenoh.geometry import Circle
from muro_zenoh.simulation.rollout.fleet import Fleet, Policy


class Track(NamedTuple):
    """Where robots were, at first and after every move of the plant.

    ``time`` (T,) [s]; ``pose`` (T, N, 3): the true x, y [m, world], theta [rad].
    """

    time: Array
    pose: Array

    def radius_error(self, circle: Circle) -> Array:
        """Distance from the centre less the radius (T, N) [m].

        Args:
            circle: the circle.
        """
        error: Array = np.hypot(self.pose[..., 0] - circle.x, self.pose[..., 1] - circle.y) - circle.radius
        return error


def drive(fleet: Fleet, policy: Policy, seconds: float) -> Track:
    """Drive a fleet for so long, and say where it was.

    Args:
        fleet: the robots.
        policy: the law.
        seconds: how long [s].
    """
    times, poses = [fleet.time], [fleet.plant.pose.copy()]

    def watch(t: float, pose: Array) -> None:
        times.append(t)
        poses.append(pose.copy())

    for _ in range(round(seconds / fleet.settings.period)):
        fleet.step(policy, watch)
    return Track(np.array(times), np.array(poses))
