"""Cyclic pursuit: speeds that spread robots evenly round a circle.

``ring -> order -> gaps -> speed``. The ring is found anew from the whole snapshot at each step: the robot ahead of me
is whoever is next in the direction of travel now, never a name remembered (seed 000 latches one, and stands still when
that robot leaves). Only the previous order is state; it goes in and comes out.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from muro_zenoh.control.importance import Importance
from muro_zenoh.elementwise import Array, Scalar, of
from muro_zenoh.geometry import TWO_PI, Circle, ccw_gap

HYSTERESIS: Final = 0.05
"""Two neighbours swap in the order only when the one ahead has fallen this far behind the other [rad]."""

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


def _unroll(angles: Mapping[str, float], clockwise: bool) -> tuple[tuple[str, ...], dict[str, float]]:
    """Names in the direction of travel from the far end of the widest gap on, and the way travelled to each.

    Cut at the widest gap, two robots that are close are never on either side of the cut: "just behind" then means a
    small way less, instead of a whole turn more.
    """
    sigma = -1.0 if clockwise else 1.0
    rows = sorted((ccw_gap(0.0, sigma * angle), name) for name, angle in angles.items())
    ways, names = [way for way, _ in rows], [name for _, name in rows]
    widest, first = -1.0, 0
    for k in range(len(names)):
        gap = ways[k] - ways[k - 1] + (TWO_PI if k == 0 else 0.0)
        if gap > widest:
            widest, first = gap, k
    ordered = (*names[first:], *names[:first])
    start = ways[first] if names else 0.0
    unrolled = {name: ways[k] - start + (TWO_PI if k < first else 0.0) for k, name in enumerate(names)}
    return ordered, unrolled


def order_ring(angles: Mapping[str, float], previous: Sequence[str], clockwise: bool) -> tuple[str, ...]:
    """Who follows whom: the names in the direction of travel, beginning behind the widest gap.

    Neighbours keep the order that they had until one is :data:`HYSTERESIS` ahead of the other: else noise on two robots
    side by side would flip a gap between nothing and a whole turn. Newcomers are put where they are; equal angles go
    by name.

    Args:
        angles: the robots on the ring: name to angle seen from the centre [rad], any turn.
        previous: what this function returned at the step before; empty at first. Names that left are ignored.
        clockwise: the direction of travel.

    Returns:
        Each name once.
    """
    return _order(*_unroll(angles, clockwise), previous)


def _order(ordered: tuple[str, ...], way: Mapping[str, float], previous: Sequence[str]) -> tuple[str, ...]:
    if not previous or tuple(previous) == ordered:
        return ordered
    result = [name for name in previous if name in way]
    known = set(result)
    # Insertion sort that leaves inversions within the hysteresis: each exchange undoes a real one, so it ends.
    for k in range(1, len(result)):
        while k > 0 and way[result[k - 1]] > way[result[k]] + HYSTERESIS:
            result[k - 1], result[k] = result[k], result[k - 1]
            k -= 1
    for name in ordered:
        if name not in known:
            place = len(result)
            while place > 0 and (way[result[place - 1]], result[place - 1]) > (way[name], name):
                place -= 1
            result.insert(place, name)
    return tuple(result)


def gaps(angles: Mapping[str, float], order: Sequence[str], clockwise: bool) -> dict[str, float]:
    """The angle from each robot to its successor [rad]: each in [0, 2 pi], 2 pi in all; alone, a whole turn.

    Args:
        angles: the robots on the ring: name to angle seen from the centre [rad], any turn.
        order: from :func:`order_ring` for the same angles.
        clockwise: the direction of travel.
    """
    return _gaps(_unroll(angles, clockwise)[1], order)


def _gaps(way: Mapping[str, float], order: Sequence[str]) -> dict[str, float]:
    result: dict[str, float] = {}
    reached = way[order[0]] if order else 0.0
    start = reached
    for name, successor in itertools.pairwise(order):
        # Two whose order the hysteresis keeps up against their angles count as side by side.
        ahead = max(reached, way[successor])
        result[name] = ahead - reached
        reached = ahead
    if order:
        result[order[-1]] = TWO_PI - (reached - start)
    return result


class RingRobot(NamedTuple):
    """What pursuit knows of a robot.

    Args:
        x: place [m, world].
        y: place [m, world].
        theta: heading [rad].
        v: speed [m/s].
        age: how old these are [s].
    """

    x: float
    y: float
    theta: float
    v: float
    age: float


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


def ring_angles(ring: Mapping[str, RingRobot], circle: Circle) -> dict[str, float]:
    """The angles now [rad] of the robots on the ring: those with ``|rho - r| <= r / 2``.

    Each is moved on by its own tangential speed times its age: without that, old positions bias the common speed.

    Args:
        ring: the robots that count; stale, lost and stopped ones have been left out.
        circle: the circle.
    """
    angles: dict[str, float] = {}
    for name, robot in ring.items():
        px, py = robot.x - circle.x, robot.y - circle.y
        rho = math.hypot(px, py)
        if abs(rho - circle.radius) <= 0.5 * circle.radius:
            phi = math.atan2(py, px)
            angles[name] = phi + robot.v * math.sin(robot.theta - phi) / rho * robot.age
    return angles


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
    ordered, way = _unroll(angles, circle.clockwise)
    order = _order(ordered, way, order)
    if me not in angles:
        return PursuitStep(law.cruise, TWO_PI, TWO_PI, order, len(angles), False)
    to_next = _gaps(way, order)
    gap, behind = to_next[me], to_next[order[order.index(me) - 1]]
    speed = pursuit_speed(law, gap, behind, len(order), angles[me], circle.radius, circle.clockwise)
    return PursuitStep(speed, gap, behind, order, len(order), True)


def array_gaps(
    angles: Array, clockwise: bool, eligible: NDArray[np.bool_] | None = None
) -> tuple[Array, Array, NDArray[np.intp]]:
    """Gap ahead, gap behind and count for whole arrays of rings, without the hysteresis; ties go by index.

    Args:
        angles: angles seen from the centre [rad], shape ``[..., robots]``; each ring is one row.
        clockwise: the direction of travel.
        eligible: which robots are on the ring, same shape; all when None.

    Returns:
        Gap to the successor and from the predecessor [rad], shape ``[..., robots]``, a whole turn each for robots not
        on the ring; robots on the ring, shape ``[..., 1]``.
    """
    way = np.mod(-angles if clockwise else angles, TWO_PI)
    if eligible is not None:
        way = np.where(eligible, way, np.inf)
        count = eligible.sum(axis=-1, keepdims=True)
    else:
        count = np.full((*angles.shape[:-1], 1), angles.shape[-1])
    index = np.argsort(way, axis=-1, kind="stable")
    ways = np.take_along_axis(way, index, axis=-1)
    place = np.broadcast_to(np.arange(angles.shape[-1]), angles.shape)
    last = place == count - 1
    successor = np.where(last, 0, np.minimum(place + 1, angles.shape[-1] - 1))
    on_ring = place < count
    with np.errstate(invalid="ignore"):  # inf - inf, off the ring, overwritten below
        ahead = np.take_along_axis(ways, successor, axis=-1) - ways + np.where(last, TWO_PI, 0.0)
    ahead = np.where(on_ring, ahead, TWO_PI)
    predecessor = np.where(place == 0, np.maximum(count - 1, 0), place - 1)
    behind = np.where(on_ring, np.take_along_axis(ahead, predecessor, axis=-1), TWO_PI)
    gap, gap_behind = np.empty_like(way), np.empty_like(way)
    np.put_along_axis(gap, index, ahead, axis=-1)
    np.put_along_axis(gap_behind, index, behind, axis=-1)
    return gap, gap_behind, count
