"""Driving along a path as a car does: slow on arcs, faster on straights, braking in time.

Seed 004, section 4.3, with its mistakes corrected: the curvature is read from the path, for both directions (the seed
tests ``omega > 0`` and so treats right turns as straights); accelerations are per second, not per loop; distances are
along the path; and the robot brakes before an arc, not on it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from muro_zenoh.errors import ParameterError
from muro_zenoh.planning.path import STRAIGHT, Path
from muro_zenoh.quantities import Acceleration, Duration, Length, Quantity, Speed, check_quantities


@dataclass(frozen=True, slots=True)
class SpeedProfile:
    """Limits of the speed along a path.

    Args:
        v_min: speed on arcs [m/s].
        v_max: maximum speed on straights [m/s], at least ``v_min``.
        acceleration: acceleration on straights [m/s^2].
        deceleration: deceleration before arcs and the goal [m/s^2].
        approach: speed per remaining distance near the goal [1/s]; the p of seed 004.
        tolerance: arrived within this distance along the path [m].
        creep: minimum speed until arrival [m/s]: a proportional speed alone would never arrive.
        reaction: time until a slower command takes effect at the wheels [s]; braking begins earlier by this time.
        omega_max: maximum turning rate [rad/s]; on tight arcs it keeps the speed below ``v_min``.

    Raises:
        ParameterError: a number outside its limits.
    """

    v_min: Speed = 0.1
    v_max: Speed = 0.3
    acceleration: Acceleration = 0.2
    deceleration: Acceleration = 0.3
    approach: Annotated[float, Quantity("1/s", above=0.0)] = 1.5
    tolerance: Length = 0.01
    creep: Speed = 0.02
    reaction: Duration = 0.1
    omega_max: Annotated[float, Quantity("rad/s", above=0.0, finite=False)] = math.inf

    def __post_init__(self) -> None:
        check_quantities(self)
        if self.v_min > self.v_max:
            raise ParameterError("v_min", got=f"{self.v_min:g}", expected=f"at most v_max, {self.v_max:g} [m/s]")

    def speed_on(self, curvature: float) -> float:
        """The maximum speed on a segment of the path [m/s].

        Args:
            curvature: its curvature [1/m], either sign.
        """
        if abs(curvature) < STRAIGHT:
            return self.v_max
        return min(self.v_min, self.omega_max / abs(curvature))

    def speed_before(self, distance: float, speed: float) -> float:
        """The maximum speed now from which ``speed`` can be reached within ``distance`` [m/s].

        ``v tau + (v^2 - speed^2) / (2 d) = distance``, with the reaction time tau and the deceleration d.

        Args:
            distance: the distance [m].
            speed: the speed to reach [m/s].
        """
        lost = self.deceleration * self.reaction
        square = lost * lost + speed * speed + 2.0 * self.deceleration * max(distance, 0.0)
        return max(math.sqrt(square) - lost, speed)


def path_speed(path: Path, s: float, v: float, dt: float, profile: SpeedProfile) -> float:
    """The speed to drive now [m/s]; 0 once arrived.

    ::

        arcs        v_min
        straights   min(v + a dt, v_max, p to_go, braking limits for each arc ahead and for the goal)

    Per call it rises by at most ``a dt`` and falls by at most ``d dt``, except for the stop within the tolerance.

    Args:
        path: the path.
        s: the distance along it so far [m].
        v: the result of the previous call; 0 at first [m/s].
        dt: time since the previous call [s].
        profile: the limits.

    Source: seed 004, section 4.3, eq. 5.
    """
    to_go = path.length - s
    if to_go <= profile.tolerance:
        return 0.0
    limit = min(profile.approach * to_go, profile.speed_before(to_go, 0.0))
    for k, (length, curvature) in enumerate(path.segments):
        if length <= 0.0 or path.distances[k + 1] <= s:
            continue
        limit = min(limit, profile.speed_before(path.distances[k] - s, profile.speed_on(curvature)))
    limit = max(limit, profile.creep)
    return min(max(limit, v - profile.deceleration * dt), v + profile.acceleration * dt, profile.v_max)
