"""Drive as a hand at a stick wants: the twist of ``muro/drive/<name>``, and stand still without one."""

from __future__ import annotations

import math
from dataclasses import dataclass

from muro_zenoh.behaviours.interface import Behaviour, BehaviourKind, Intent, Need, Seen, Vehicle, hold
from muro_zenoh.geometry import Twist2
from muro_zenoh.quantities import Speed, TurningRate, check_quantities


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """Parameters of driving by hand.

    Args:
        speed: maximum speed, forwards and backwards [m/s].
        turning: maximum turning rate [rad/s].
    """

    speed: Speed = 0.3
    turning: TurningRate = 1.0

    def __post_init__(self) -> None:
        check_quantities(self)


class Manual(Behaviour):
    """Drive as a hand wants.

    A stick that is let go, and one that nothing is received from any more, leave the robot stationary: it is held, not
    driven at zero, so that nothing moves it out of the way of others either.

    Args:
        speed: maximum speed [m/s].
        turning: maximum turning rate [rad/s].
    """

    def __init__(self, speed: float, turning: float) -> None:
        self._speed = speed
        self._turning = turning

    def step(self, seen: Seen) -> Intent:
        """Drive as the hand wants, within the limits.

        Args:
            seen: the wish.
        """
        if seen.wish is None:
            silent = f"for {seen.wish_age:.1f} s" if seen.wish_age < math.inf else "yet"
            return hold(f"nobody has driven it {silent}")
        v, omega = seen.wish
        if not (math.isfinite(v) and math.isfinite(omega)):
            return hold("the stick says no number")
        if v == 0.0 and omega == 0.0:
            return hold("the stick is let go")
        return Intent(Twist2(max(-self._speed, min(self._speed, v)), max(-self._turning, min(self._turning, omega))))


def make(parameters: Parameters, vehicle: Vehicle) -> Manual:
    """The behaviour of one robot.

    Args:
        parameters: the limits.
        vehicle: its own limits.
    """
    return Manual(min(parameters.speed, vehicle.v_max), min(parameters.turning, vehicle.omega_max))


BEHAVIOUR = BehaviourKind(Parameters, make, "drive by hand, as muro/drive/<name> says", needs=frozenset({Need.HAND}))
