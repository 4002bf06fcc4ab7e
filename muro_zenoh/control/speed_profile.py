"""Driving along a path as a car does: slow in curves, faster on straights, slowing down in time.

Seed 004, section 4.3, with its traps taken out: whether the path turns is read from the path, left and right alike (the
seed tests ``omega > 0`` and so takes right turns for straights); accelerations are per second, not per loop; distances
are along the path; and the speed falls before an arc, not at it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from muro_zenoh.planning.path import STRAIGHT, Path


@dataclass(frozen=True, slots=True)
class SpeedProfile:
    """What limits the speed along a path.

    Args:
        v_min: speed on arcs [m/s], above 0.
        v_max: greatest speed on straights [m/s], at least ``v_min``.
        acceleration: speeding up on straights [m/s^2], above 0.
        deceleration: slowing down before arcs and the goal [m/s^2], above 0.
        approach: speed per distance to go near the goal [1/s], above 0; the p of seed 004.
        tolerance: arrived with this way to go [m], above 0.
        creep: least speed until arrived [m/s], above 0: proportional alone would take for ever.
        reaction: time until a slower command is felt at the wheels [s], not below 0; braking begins so much earlier.
        omega_max: greatest turning rate [rad/s], above 0: on tight arcs the speed is below ``v_min``.

    Raises:
        ValueError: a number outside those ranges.
    """

    v_min: float = 0.1
    v_max: float = 0.3
    acceleration: float = 0.2
    deceleration: float = 0.3
    approach: float = 1.5
    tolerance: float = 0.01
    creep: float = 0.02
    reaction: float = 0.1
    omega_max: float = math.inf

    def __post_init__(self) -> None:
        for name in ("v_min", "acceleration", "deceleration", "approach", "tolerance", "creep", "omega_max"):
            value = getattr(self, name)
            if not value > 0.0:
                raise ValueError(f"SpeedProfile.{name}: got {value!r}, expected a number above 0")
        if not self.reaction >= 0.0:
            raise ValueError(f"SpeedProfile.reaction: got {self.reaction!r} s, expected a number not below 0")
        if not self.v_min <= self.v_max < math.inf:
            raise ValueError(
                f"SpeedProfile: got v_min {self.v_min!r} and v_max {self.v_max!r}, expected v_min <= v_max"
            )

    def speed_on(self, curvature: float) -> float:
        """The greatest speed on a piece of the path [m/s].

        Args:
            curvature: its curvature [1/m], either sign.
        """
        if abs(curvature) < STRAIGHT:
            return self.v_max
        return min(self.v_min, self.omega_max / abs(curvature))

    def speed_before(self, distance: float, speed: float) -> float:
        """The greatest speed from which ``speed`` can be had ``distance`` ahead [m/s].

        ``v tau + (v^2 - speed^2) / (2 d) = distance``, with the reaction time tau and the deceleration d.

        Args:
            distance: way until then [m].
            speed: the speed to have there [m/s].
        """
        lost = self.deceleration * self.reaction
        square = lost * lost + speed * speed + 2.0 * self.deceleration * max(distance, 0.0)
        return max(math.sqrt(square) - lost, speed)


def path_speed(path: Path, s: float, v: float, dt: float, profile: SpeedProfile) -> float:
    """The speed to drive now [m/s]; 0 once arrived.

    ::

        arcs        v_min
        straights   min(v + a dt, v_max, p to_go, what still allows to brake for each arc ahead and for the goal)

    It rises by at most ``a dt`` and falls by at most ``d dt`` a call, but for the stop within the tolerance.

    Args:
        path: the path.
        s: the way along it so far [m].
        v: what this function returned the last time; 0 at first [m/s].
        dt: time since then [s].
        profile: the limits.

    Source: seed 004, section 4.3, eq. 5.
    """
    to_go = path.length - s
    if to_go <= profile.tolerance:
        return 0.0
    limit = min(profile.approach * to_go, profile.speed_before(to_go, 0.0))
    for k, (length, curvature) in enumerate(path.segments):
        if length <= 0.0 or path.ways[k + 1] <= s:
            continue
        limit = min(limit, profile.speed_before(path.ways[k] - s, profile.speed_on(curvature)))
    limit = max(limit, profile.creep)
    return min(max(limit, v - profile.deceleration * dt), v + profile.acceleration * dt, profile.v_max)
