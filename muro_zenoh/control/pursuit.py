"""Cyclic pursuit: speeds that spread robots evenly on a circle.

``ring -> order -> gaps -> speed``. The ring is recomputed from the whole snapshot at each step: a robot's successor is
the next one in the direction of travel now, never a stored name (seed 000 stores one, and stops when that robot
leaves). The previous order is the only state; it is passed in and returned.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Final

from muro_zenoh.control.ring import RingRobot, gaps, order_ring, ring_angles, unroll
from muro_zenoh.elementwise import Scalar, of
from muro_zenoh.errors import ParameterError
from muro_zenoh.geometry import TWO_PI, Circle
from muro_zenoh.quantities import Positive, Quantity, Speed, SpeedOrRest, check_quantities


@dataclass(frozen=True, slots=True, kw_only=True)
class PursuitLaw(ABC):
    """A pursuit law with its gain and limits.

    In the formulas below ``gap`` is the angle to the successor, ``behind`` that from the predecessor, N the number of
    robots on the ring, K the gain, r the radius. Every law is clipped to ``[v_min, v_max]``.

    Args:
        cruise: speed of an evenly spread ring, and of a robot that is not yet on it [m/s].
        v_min: minimum speed on the ring [m/s].
        v_max: maximum speed [m/s].
        gain: K.

    Raises:
        ParameterError: a number outside its limits, or not ``v_min <= cruise <= v_max``.

    Source: seed 000, sections 3.2, 5.2 and 6.
    """

    NAME: ClassVar[str]

    cruise: SpeedOrRest = 0.2
    v_min: SpeedOrRest = 0.05
    v_max: Speed = 0.4
    gain: Positive = 1.0

    def __post_init__(self) -> None:
        check_quantities(self)
        if not self.v_min <= self.cruise <= self.v_max:
            raise ParameterError(
                "cruise",
                got=f"{self.cruise:g} with v_min {self.v_min:g} and v_max {self.v_max:g} [m/s]",
                expected="v_min <= cruise <= v_max",
            )

    @abstractmethod
    def _unclipped(self, gap: Any, behind: Any, count: Any, angle: Any, radius: float, clockwise: bool) -> Any:
        """The speed before it is clipped [m/s]; the arguments are those of :func:`pursuit_speed`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TwoGap(PursuitLaw):
    """The default, from both gaps: ``v = cruise + (r K / 2) (gap - behind)``, K in 1/s."""

    NAME: ClassVar[str] = "two_gap"

    gain: Annotated[float, Quantity("1/s", above=0.0)] = 2.5

    def _unclipped(self, gap: Any, behind: Any, count: Any, angle: Any, radius: float, clockwise: bool) -> Any:
        """By the formula of the class."""
        return self.cruise + 0.5 * radius * self.gain * (gap - behind)


@dataclass(frozen=True, slots=True, kw_only=True)
class Normalised(PursuitLaw):
    """``v = cruise (1 + K (gap N / (2 pi) - 1))``, K a number: the steady speed does not depend on N."""

    NAME: ClassVar[str] = "normalised"

    def _unclipped(self, gap: Any, behind: Any, count: Any, angle: Any, radius: float, clockwise: bool) -> Any:
        """By the formula of the class."""
        return self.cruise * (1.0 + self.gain * (gap * count / TWO_PI - 1.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Proportional(PursuitLaw):
    """The law of seed 000: ``v = K r gap``, K in 1/s, so that the angle closes at K times the gap.

    The seed's discrete gain is K times its period; it converges for products in (0, 1). The steady speed is
    ``K r 2 pi / N``: where that is above ``v_max``, all saturate at ``v_max`` before they are evenly spread.
    """

    NAME: ClassVar[str] = "proportional"

    gain: Annotated[float, Quantity("1/s", above=0.0)] = 0.3

    def _unclipped(self, gap: Any, behind: Any, count: Any, angle: Any, radius: float, clockwise: bool) -> Any:
        """By the formula of the class."""
        return self.gain * radius * gap


@dataclass(frozen=True, slots=True, kw_only=True)
class Weighted(PursuitLaw):
    """:class:`TwoGap` in the coordinate whose increment is ``rho d angle``, in which the desired density is uniform.

    ``v = (s + (r K / 2) (mass ahead - mass behind)) / rho(angle)``, K in 1/s; ``s`` is ``cruise`` clamped such that
    ``s / rho`` is within the limits on the whole circle. Without the division by rho the density does not follow rho.

    Args:
        importance: rho, an :class:`~muro_zenoh.control.importance.Importance`.

    Raises:
        ParameterError: an importance whose contrast exceeds ``v_max / v_min``.
    """

    NAME: ClassVar[str] = "importance"

    gain: Annotated[float, Quantity("1/s", above=0.0)] = 2.5
    importance: Any  # an Importance needs numpy, which most agents do not load

    def __post_init__(self) -> None:
        PursuitLaw.__post_init__(self)
        # Tolerance for rounding: a contrast of exactly v_max / v_min is allowed.
        if self.v_min * self.importance.contrast > self.v_max * (1.0 + 1e-9):
            raise ParameterError(
                "importance",
                got=f"a contrast of {self.importance.contrast:.2f}",
                expected=f"highest over lowest at most v_max / v_min = {self.v_max / self.v_min:.2f}",
                hint="Flatten it, or widen the speed range.",
            )

    def _unclipped(self, gap: Any, behind: Any, count: Any, angle: Any, radius: float, clockwise: bool) -> Any:
        """By the formula of the class."""
        rho = self.importance
        scale = min(max(self.cruise, self.v_min * rho.highest), self.v_max * rho.lowest)
        sigma = -1.0 if clockwise else 1.0
        here = rho.mass(angle)
        ahead = sigma * (rho.mass(angle + sigma * gap) - here)
        after = sigma * (here - rho.mass(angle - sigma * behind))
        return (scale + 0.5 * radius * self.gain * (ahead - after)) / rho.density(angle)


PURSUIT_LAWS: Final[Mapping[str, type[PursuitLaw]]] = MappingProxyType(
    {law.NAME: law for law in (TwoGap, Normalised, Proportional, Weighted)}
)
"""The pursuit laws by the name that settings use; the first is the default."""


def pursuit_law(name: str = TwoGap.NAME, **settings: Any) -> PursuitLaw:
    """A pursuit law by name, with some of its settings changed.

    Args:
        name: a key of :data:`PURSUIT_LAWS`.
        settings: fields of the law that differ from their defaults.

    Raises:
        ParameterError: no such law, or inconsistent numbers.
    """
    kind = PURSUIT_LAWS.get(name)
    if kind is None:
        raise ParameterError("pursuit law", got=repr(name), expected=f"one of {', '.join(PURSUIT_LAWS)}")
    return kind(**settings)


def pursuit_speed(
    law: PursuitLaw, gap: Scalar, behind: Scalar, count: Scalar | int, angle: Scalar, radius: float, clockwise: bool
) -> Scalar:
    """Speed [m/s] of a robot on the ring; floats, or arrays such as ``[trials, robots]``.

    Args:
        law: the law.
        gap: angle to the next robot in the direction of travel [rad, 0 to 2 pi].
        behind: angle from the previous robot [rad, 0 to 2 pi].
        count: robots on the ring, including this one.
        angle: the robot's angle, seen from the centre [rad].
        radius: the circle's radius [m].
        clockwise: the direction of travel.

    Returns:
        Speed within ``[v_min, v_max]``.
    """
    speed = law._unclipped(gap, behind, count, angle, radius, clockwise)
    clipped: Scalar = of(gap).clip(speed, law.v_min, law.v_max)
    return clipped


@dataclass(frozen=True, slots=True)
class PursuitStep:
    """The result of :func:`pursue`.

    Args:
        speed: the robot's speed [m/s].
        gap: angle to its successor [rad]; 2 pi when it is alone or not on the ring.
        gap_behind: angle from its predecessor [rad]; likewise.
        order: the order to pass in at the next step.
        count: robots on the ring.
        eligible: whether the robot itself is on the ring.
    """

    speed: float
    gap: float
    gap_behind: float
    order: tuple[str, ...]
    count: int
    eligible: bool


def pursue(
    me: str, ring: Mapping[str, RingRobot], circle: Circle, order: tuple[str, ...], law: PursuitLaw
) -> PursuitStep:
    """One step of cyclic pursuit: one robot's speed from the positions of all.

    A robot that is not on the ring drives at ``cruise`` and is not counted.

    Args:
        me: the robot's name.
        ring: the robots that take part, including this one; without stale, lost and stopped ones.
        circle: the circle and the direction of travel.
        order: the order of the previous step; empty at first.
        law: the law.
    """
    angles = ring_angles(ring, circle)
    travelled = unroll(angles, circle.clockwise)
    order = order_ring(travelled, order)
    if me not in angles:
        return PursuitStep(law.cruise, TWO_PI, TWO_PI, order, len(angles), False)
    to_next = gaps(travelled, order)
    gap, behind = to_next[me], to_next[order[order.index(me) - 1]]
    speed = pursuit_speed(law, gap, behind, len(order), angles[me], circle.radius, circle.clockwise)
    return PursuitStep(speed, gap, behind, order, len(order), True)
