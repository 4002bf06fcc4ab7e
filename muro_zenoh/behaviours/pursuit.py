"""Cyclic pursuit: robots spread out on the circle; each computes its speed from the positions of all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import ClassVar

from muro_zenoh.behaviours.circle import require_room, require_spacing
from muro_zenoh.behaviours.entry_points import load_function
from muro_zenoh.behaviours.interface import (
    Behaviour,
    BehaviourKind,
    Expectation,
    Intent,
    Need,
    Seen,
    Snapshot,
    Vehicle,
    hold,
    is_visible,
)
from muro_zenoh.control.circle import CircleLaw, LqrGains, PassivityGains, VectorFieldGains, circle_twist
from muro_zenoh.control.pursuit import Normalised, Proportional, PursuitLaw, TwoGap, Weighted, pursue
from muro_zenoh.control.ring import RingRobot
from muro_zenoh.geometry import Circle

_STATIONARY_AFTER = 1.0
"""A robot that has not moved for this time does not take part [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ByImportance:
    """Settings of the law ``importance``: stay longer where the importance is greater.

    Args:
        even: the law without importance: cruising speed (where the importance is 1), limits and gain.
        angles: angles on the circle [rad].
        weights: the importance at each angle, above 0; interpolated in between.
        importance: instead of a table: ``module:function``, from an angle [rad] to a weight.
    """

    NAME: ClassVar[str] = Weighted.NAME

    even: TwoGap = TwoGap()
    angles: tuple[float, ...] = ()
    weights: tuple[float, ...] = ()
    importance: str = ""

    def law(self) -> Weighted:
        """The law with its importance.

        Raises:
            ParameterError: an invalid importance, or one whose contrast the speed range cannot serve.
            BehaviourError: an importance that cannot be loaded, or raises an exception.
        """
        from muro_zenoh.control.importance import Importance  # needs numpy, which most agents do not load

        if self.importance:
            importance = Importance.from_function(load_function(self.importance))
        else:
            importance = Importance.from_table(self.angles, self.weights)
        return Weighted(**asdict(self.even), importance=importance)


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """Parameters of cyclic pursuit.

    Args:
        law: the circle law: ``vector_field``, ``passivity`` or ``lqr``, with its gains.
        pursuit: the speed law: ``two_gap``, ``normalised``, ``proportional`` or ``importance``, with its gain and
            limits.
    """

    law: VectorFieldGains | PassivityGains | LqrGains = VectorFieldGains()
    pursuit: TwoGap | Normalised | Proportional | ByImportance = TwoGap()

    def pursuit_law(self) -> PursuitLaw:
        """The speed law.

        Raises:
            ParameterError: an invalid importance, or one whose contrast the speed range cannot serve.
            BehaviourError: an importance that cannot be loaded, or raises an exception.
        """
        return self.pursuit.law() if isinstance(self.pursuit, ByImportance) else self.pursuit


class Pursuit(Behaviour):
    """Follow the circle at the speed that spreads the robots out on it.

    Args:
        name: name of this robot.
        pursuit: the speed law.
        circle: the circle law.
    """

    def __init__(self, name: str, pursuit: PursuitLaw, circle: CircleLaw) -> None:
        self._name = name
        self._pursuit = pursuit
        self._circle = circle
        self._order: tuple[str, ...] = ()
        self._moved: dict[str, float] = {}  # when each other robot last moved, or was first seen [s]

    def step(self, seen: Seen) -> Intent:
        """Compute the speed, publish it, and follow the circle at it.

        Args:
            seen: the circle and all robots.
        """
        if seen.circle is None:
            return hold("no circle received yet")
        if seen.snapshot is None:
            never = seen.snapshot_age == math.inf
            return hold("no positions received yet" if never else f"no positions for {seen.snapshot_age:.1f} s")
        ring = self._ring(seen, seen.snapshot)
        step = pursue(self._name, ring, seen.circle, self._order, self._pursuit)
        self._order = step.order
        return Intent(circle_twist(seen.ahead, step.speed, seen.circle, self._circle), speed=step.speed)

    def _ring(self, seen: Seen, snapshot: Snapshot) -> dict[str, RingRobot]:
        """The robots that take part: this one from its own estimate, and all others that are visible, not stopped, and
        moving.

        A stationary one (its agent has died, or it runs another behaviour) would keep a gap open for ever.
        """
        stationary = 0.5 * self._pursuit.v_min
        ring = {}
        for other in snapshot.robots:
            if other.name == self._name:
                continue
            if not is_visible(other):
                self._moved.pop(other.name, None)
                continue
            if abs(other.v) > stationary or other.name not in self._moved:
                self._moved[other.name] = seen.now
            if seen.now - self._moved[other.name] <= _STATIONARY_AFTER and other.name not in seen.stopped:
                ring[other.name] = RingRobot(other.x, other.y, other.theta, other.v, other.age + snapshot.age)
        me = seen.state
        ring[self._name] = RingRobot(me.x, me.y, me.theta, me.v, 0.0)
        return ring


def make(parameters: Parameters, vehicle: Vehicle) -> Pursuit:
    """The behaviour of one robot.

    Args:
        parameters: both laws.
        vehicle: the robot; only its name is used.

    Raises:
        ParameterError: an invalid importance, or one whose contrast the speed range cannot serve.
    """
    return Pursuit(vehicle.name, parameters.pursuit_law(), CircleLaw(parameters.law))


def fits(parameters: Parameters, circle: Circle, fleet: Sequence[Vehicle]) -> None:
    """Refuse a circle that the robots cannot share, and an invalid table of the importance.

    Args:
        parameters: both laws; a function of the user's own is loaded only on the robots.
        circle: the circle.
        fleet: the robots.

    Raises:
        ParameterError: they would leave the arena, or be too close when evenly spread; or as for the speed law.
    """
    if not (isinstance(parameters.pursuit, ByImportance) and parameters.pursuit.importance):
        parameters.pursuit_law()
    require_room(circle, fleet)
    require_spacing(circle, fleet)


def expects(parameters: Parameters, vehicle: Vehicle) -> Expectation:
    """What its score sheet shows; with an importance the robots do not spread evenly.

    Args:
        parameters: the laws.
        vehicle: not used.
    """
    law = parameters.pursuit_law()
    importance = law.importance if isinstance(law, Weighted) else None
    return Expectation(follows_circle=True, spreads=importance is None, importance=importance)


BEHAVIOUR = BehaviourKind(
    Parameters,
    make,
    "cyclic pursuit: spread out on the circle and keep circling",
    needs=frozenset({Need.CIRCLE, Need.SNAPSHOT}),
    expects=expects,
    fits=fits,
)
