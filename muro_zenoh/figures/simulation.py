"""Simulations for figures: their extent, and lock-step rollouts with the whole track recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from muro_zenoh.elementwise import Array
from muro_zenoh.geometry import Circle
from muro_zenoh.quantities import Quantity, check_quantities
from muro_zenoh.simulation.rollout.fleet import Fleet, Policy


@dataclass(frozen=True, slots=True)
class Effort:
    """How much is simulated for a figure; the defaults are those of the published figures.

    Args:
        starts: number of starts per circle law, for distributions.
        trials: number of rings of ten robots per pursuit law.
        share: fraction of the length of every run, 0 to 1; less than 1 for a quick look.

    Raises:
        ParameterError: a number outside its limits.
    """

    starts: Annotated[int, Quantity(at_least=1, whole=True)] = 250
    trials: Annotated[int, Quantity(at_least=1, whole=True)] = 25
    share: Annotated[float, Quantity(above=0.0, at_most=1.0)] = 1.0

    def __post_init__(self) -> None:
        check_quantities(self)

    def seconds(self, full: float) -> float:
        """Length of a run that takes ``full`` seconds in the published figure [s]; at least 1 s.

        Args:
            full: that length [s].
        """
        return max(1.0, full * self.share)


PUBLISHED = Effort()
"""The effort of the figures in the documentation."""


class Track(NamedTuple):
    """The robots' true poses, at the start and after every step of the plant.

    ``time`` (T,) [s]; ``pose`` (T, N, 3): the true x, y [m, world], theta [rad].
    """

    time: Array
    pose: Array

    def radius_error(self, circle: Circle) -> Array:
        """Distance from the centre minus the radius (T, N) [m].

        Args:
            circle: the circle.
        """
        error: Array = np.hypot(self.pose[..., 0] - circle.x, self.pose[..., 1] - circle.y) - circle.radius
        return error


def drive(fleet: Fleet, policy: Policy, seconds: float) -> Track:
    """Drive a fleet and record its track.

    Args:
        fleet: the robots.
        policy: the law.
        seconds: duration [s].
    """
    times, poses = [fleet.time], [fleet.plant.pose.copy()]

    def watch(t: float, pose: Array) -> None:
        times.append(t)
        poses.append(pose.copy())

    for _ in range(round(seconds / fleet.settings.period)):
        fleet.step(policy, watch)
    return Track(np.array(times), np.array(poses))
