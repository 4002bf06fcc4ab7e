"""Cyclic pursuit: speeds that spread robots evenly round a circle.

``ring -> order -> gaps -> speed``. The ring is found anew from the whole snapshot at each step: the robot ahead of me
is whoever is next in the direction of travel now, never a name remembered (seed 000 latches one, and stands still when
that robot leaves). Only the previous order is state; it goes in and comes out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from muro_zenoh.control.ring import (
    RingRobot,
    gaps,
    order_ring,
    ring_angles,
    unroll,
)
from muro_zenoh.elementwise import Scalar, of
from muro_zenoh.geometry import TWO_PI, Circle

if TYPE_CHECKING:
    from muro_zenoh.control.importance import Importance  # needs numpy, which most agents do without

DEFAULT_GAINS: Final[Mapping[str, float]] = {"two_gap": 2.5, "normalised": 1.0, "proportional": 0.3, "importance": 2.5}
"""The pursuit laws by name, each with its default gain."""


@dataclass(frozen=True, slots=True)
class PursuitLaw:
    """A pursuit law with its gain and limits.

    With ``gap`` to the successor, ``behind`` from the predecessor, N robots on the ring, K the gain, r the radius:

    * ``two_gap`` (the default): ``v = cruise + (r K / 2) (gap - behind)``, K in 1/s;
    * ``normalised``: ``v = cruise (1 + K (gap N / (2 pi) - 1))``, K a number;
    * ``proportional`` (seed 000): ``v = K r gap``, K in 1/s, so that the angle closes at K times the gap. The seed's
      discrete gain is K times its period; it converges for products in (0, 1). The steady speed is ``K r 2 pi / N``:
      where that is beyond ``v_max``, all drive at ``v_max`` before they are evenly spread, and stay so;
    * ``importance``: ``v = (s + (r K / 2) (mass ahead - mass behind)) / rho(angle)``, K in 1/s: two_gap in the
      coordinate whose increment is ``rho d angle``, where the density asked for is uniform. ``s`` is ``cruise``
      brought to where ``s / rho`` keeps within the limits all the way round. Without the division by rho the density
      does not follow rho.

    All are clipped to ``[v_min, v_max]``.

    Args:
        name: a key of :data:`DEFAULT_GAINS`.
        cruise: speed of an evenly spread ring, and of a robot on its way to it [m/s].
        gain: K; None takes the law's default.
        v_min: least speed on the ring [m/s].
        v_max: greatest speed [m/s].
        importance: the density to keep; for ``importance`` only.

    Raises:
        ValueError: an unknown name, a gain not above 0, speeds not in order, an importance missing or not asked for,
            or one whose contrast the speeds cannot serve.

    Source: seed 000, sections 3.2, 5.2 and 6.
    """

    name: str = "two_gap"
    cruise: float = 0.2
    gain: float | None = None
    v_min: float = 0.05
    v_max: float = 0.4
    importance: Importance | None = None

    def __post_init__(self) -> None:
        if self.name not in DEFAULT_GAINS:
            raise ValueError(f"pursuit law: got {self.name!r}, expected one of {', '.join(DEFAULT_GAINS)}")
        if self.gain is None:
            object.__setattr__(self, "gain", DEFAULT_GAINS[self.name])
        if not (math.isfinite(self.k) and self.k > 0.0):
            raise ValueError(f"gain of the pursuit law: got {self.gain!r}, expected a finite number above 0")
        if not 0.0 <= self.v_min <= self.cruise <= self.v_max < math.inf:
            raise ValueError(
                f"speeds of the pursuit law: got v_min {self.v_min!r}, cruise {self.cruise!r}, v_max {self.v_max!r} "
                "[m/s], expected 0 <= v_min <= cruise <= v_max"
            )
        if (self.importance is None) == (self.name == "importance"):
            raise ValueError(
                f"importance of the pursuit law {self.name}: got {'none' if self.importance is None else 'one'}, "
                f"expected {'one' if self.importance is None else 'none; the law importance takes it'}"
            )
        # A hair of slack: a contrast of exactly v_max / v_min is what the speeds can just serve.
        if self.importance and self.v_min * self.importance.contrast > self.v_max * (1.0 + 1e-9):
            raise ValueError(
                f"importance of the pursuit law: got a contrast of {self.importance.contrast:.2f}, expected "
                f"highest over lowest at most v_max / v_min = {self.v_max / self.v_min:.2f}. Flatten it or widen v"
            )

    @property
    def k(self) -> float:
        """The gain, default filled in."""
        return DEFAULT_GAINS[self.name] if self.gain is None else self.gain


def pursuit_speed(
    law: PursuitLaw, gap: Scalar, behind: Scalar, count: Scalar | int, angle: Scalar, radius: float, clockwise: bool
) -> Scalar:
    """Speed [m/s] of a robot on the ring; floats, or arrays such as ``[trials, robots]``.

    Args:
        law: the law.
        gap: angle to the next robot in the direction of travel [rad, 0 to 2 pi].
        behind: angle from the robot before [rad, 0 to 2 pi].
        count: robots on the ring, oneself included.
        angle: where the robot is, seen from the centre [rad].
        radius: the circle's radius [m].
        clockwise: the direction of travel.

    Returns:
        Speed within ``[v_min, v_max]``.
    """
    speed: Any
    if law.name == "two_gap":
        speed = law.cruise + 0.5 * radius * law.k * (gap - behind)
    elif law.name == "normalised":
        speed = law.cruise * (1.0 + law.k * (gap * count / TWO_PI - 1.0))
    elif law.name == "proportional":
        speed = law.k * radius * gap
    else:
        assert law.importance is not None
        rho = law.importance
        scale = min(max(law.cruise, law.v_min * rho.highest), law.v_max * rho.lowest)
        sigma = -1.0 if clockwise else 1.0
        here = rho.mass(angle)
        ahead = sigma * (rho.mass(angle + sigma * gap) - here)
        after = sigma * (here - rho.mass(angle - sigma * behind))
        speed = (scale + 0.5 * radius * law.k * (ahead - after)) / rho.density(angle)
    clipped: Scalar = of(gap).clip(speed, law.v_min, law.v_max)
    return clipped


@dataclass(frozen=True, slots=True)
class PursuitStep:
    """What :func:`pursue` found.

    Args:
        speed: my speed [m/s].
        gap: angle to my successor [rad]; a whole turn when I am alone or not on the ring.
        gap_behind: angle from my predecessor [rad]; likewise.
        order: the order to hand in next time.
        count: robots on the ring.
        eligible: whether I am on the ring myself.
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
    """One step of cyclic pursuit: my speed from where everybody is.

    A robot that is not on the ring drives at ``cruise`` and does not count.

    Args:
        me: my name.
        ring: the robots that count, me included; stale, lost and stopped ones have been left out.
        circle: the circle and the direction of travel.
        order: the order of the step before; empty at first.
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
