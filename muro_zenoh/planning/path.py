"""A planned path: a start and a chain of arcs and straights, parametrised by the distance along it.

Plain data, a start pose and ``(length, curvature)`` rows, so that it can be sent as a message and rebuilt from one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from muro_zenoh.arcs import advance
from muro_zenoh.geometry import TWO_PI, Pose2

STRAIGHT = 1e-9
"""Curvatures below this [1/m] count as straight."""


class Segment(NamedTuple):
    """A piece of a path.

    Args:
        length: its length [m], not below 0.
        curvature: its curvature [1/m], to the left positive, 0 straight on.
    """

    length: float
    curvature: float


class Arc(NamedTuple):
    """A piece of a path that is not straight, as a part of its circle.

    Args:
        x: the circle's centre [m].
        y: the circle's centre [m].
        radius: the circle's [m].
        side: 1 to the left, -1 to the right.
        begin: direction from the centre to where the arc begins [rad].
        turn: from its begin to its end [rad], not below 0.
    """

    x: float
    y: float
    radius: float
    side: float
    begin: float
    turn: float

    @classmethod
    def of(cls, knot: Pose2, length: float, curvature: float) -> Arc:
        """The arc of a segment.

        Args:
            knot: where it begins.
            length: its length [m].
            curvature: its curvature [1/m], not that of a straight.
        """
        side = math.copysign(1.0, curvature)
        x, y = knot.x - math.sin(knot.theta) / curvature, knot.y + math.cos(knot.theta) / curvature
        return cls(x, y, side / curvature, side, knot.theta - side * 0.5 * math.pi, length * abs(curvature))

    def holds(self, direction: float) -> bool:
        """Whether the arc has a point in a direction from its centre.

        Args:
            direction: the direction [rad].
        """
        return self.side * (direction - self.begin) % TWO_PI <= self.turn


@dataclass(frozen=True, slots=True)
class Path:
    """A chain of arcs and straights, each beginning at the end of the previous one, with its heading.

    Args:
        start: where it begins [world].
        segments: its pieces in order.

    Attributes:
        knots: the pose at the start of each segment, and the end; one more than there are segments.
        distances: the distance along the path to each knot [m].
    """

    start: Pose2
    segments: tuple[Segment, ...]
    knots: tuple[Pose2, ...] = field(init=False, repr=False, compare=False)
    distances: tuple[float, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        (x, y, theta), distance = self.start, 0.0
        knots, distances = [self.start], [distance]
        for length, curvature in self.segments:
            if not (length >= 0.0 and math.isfinite(length + curvature)):
                raise ValueError(
                    f"path segment: got length {length!r} m and curvature {curvature!r} 1/m, expected finite numbers, "
                    "the length not below 0"
                )
            if length > 0.0:
                x, y, theta = advance(knots[-1], length, length * curvature, 1.0)
                distance += length
            knots.append(Pose2(x, y, theta))
            distances.append(distance)
        object.__setattr__(self, "knots", tuple(knots))
        object.__setattr__(self, "distances", tuple(distances))

    @property
    def length(self) -> float:
        """The whole length [m]."""
        return self.distances[-1]

    @property
    def end(self) -> Pose2:
        """Where it ends [world]."""
        return self.knots[-1]

    def _segment_at(self, s: float) -> int:
        """Index of the segment that contains ``s``; at a knot, that of the next segment of non-zero length."""
        for k in range(len(self.segments)):
            if s < self.distances[k + 1]:
                return k
        return len(self.segments) - 1

    def pose_at(self, s: float) -> Pose2:
        """The pose on the path [world].

        Args:
            s: the distance along it [m]; clamped to the start and the end.
        """
        if not self.segments or s <= 0.0:
            return self.start
        if s >= self.length:
            return self.end
        k = self._segment_at(s)
        part = s - self.distances[k]
        return advance(self.knots[k], part, part * self.segments[k].curvature, 1.0)

    def curvature_at(self, s: float) -> float:
        """The signed curvature [1/m], to the left positive; at a knot that of the segment after it.

        Args:
            s: the distance along the path [m]; clamped to the start and the end.
        """
        return self.segments[self._segment_at(s)].curvature if self.segments else 0.0

    def reach(self, s: float, distance: float, turn: float) -> float:
        """The distance along the path from a point until the path has turned by an angle [m].

        Args:
            s: the point, as the distance along the path [m].
            distance: maximum distance [m]; below 0 backwards.
            turn: the angle, the sum of left and right turns [rad].
        """
        low, high = min(s, s + distance), max(s, s + distance)
        pieces = [
            (min(high, self.distances[k + 1]) - max(low, self.distances[k]), abs(segment.curvature))
            for k, segment in enumerate(self.segments)
        ]
        reached = 0.0
        for length, curvature in pieces if distance >= 0.0 else reversed(pieces):
            if length <= 0.0:
                continue
            if length * curvature > turn:
                return reached + turn / curvature
            turn -= length * curvature
            reached += length
        return abs(distance)

    def sample(self, step: float) -> Iterator[Pose2]:
        """Poses along the path [world], evenly spaced, both ends included.

        Args:
            step: maximum distance between two poses [m], above 0.
        """
        count = max(math.ceil(self.length / step - 1e-9), 1)
        for k in range(count + 1):
            yield self.pose_at(self.length * k / count)

    def project(self, x: float, y: float, low: float = 0.0, high: float = math.inf) -> float:
        """The distance along the path [m] to its point nearest to a position, exact on arcs and straights.

        Args:
            x: the position [m, world].
            y: the position [m, world].
            low: search from here [m]: a path may cross itself, and the robot does not go back.
            high: search up to here [m].
        """
        low = min(max(low, 0.0), self.length)
        high = max(min(high, self.length), low)
        best, nearest = low, math.inf
        for k, (length, curvature) in enumerate(self.segments):
            first, last = max(low - self.distances[k], 0.0), min(high - self.distances[k], length)
            if first > last:
                continue
            knot = self.knots[k]
            for part in _nearest(knot, curvature, x, y, first, last):
                there = advance(knot, part, part * curvature, 1.0)
                distance = (there.x - x) ** 2 + (there.y - y) ** 2
                if distance < nearest:
                    best, nearest = self.distances[k] + part, distance
        return best

    def extent(self) -> tuple[float, float, float, float]:
        """The bounding box of the path: minimum x, maximum x, minimum y, maximum y [m, world]."""
        xs, ys = [pose.x for pose in self.knots], [pose.y for pose in self.knots]
        for knot, (length, curvature) in zip(self.knots, self.segments, strict=False):
            if abs(curvature) < STRAIGHT:
                continue
            arc = Arc.of(knot, length, curvature)
            xs += [arc.x + way * arc.radius for way, where in ((1.0, 0.0), (-1.0, math.pi)) if arc.holds(where)]
            ys += [arc.y + way * arc.radius for way in (1.0, -1.0) if arc.holds(way * 0.5 * math.pi)]
        return min(xs), max(xs), min(ys), max(ys)


def _nearest(knot: Pose2, curvature: float, x: float, y: float, first: float, last: float) -> Sequence[float]:
    """Candidates on a segment, from its start [m], for the point nearest to a place, between first and last."""
    c, s = math.cos(knot.theta), math.sin(knot.theta)
    along, left = c * (x - knot.x) + s * (y - knot.y), c * (y - knot.y) - s * (x - knot.x)
    if abs(curvature) < STRAIGHT:
        return (min(max(along, first), last),)
    # In the knot's frame the arc is (sin(k s), 1 - cos(k s)) / k; just behind its start is a whole turn ahead.
    turned = math.atan2(along * curvature, 1.0 - left * curvature)
    turn = TWO_PI / abs(curvature)
    part = math.copysign(1.0, curvature) * turned % TWO_PI / abs(curvature)
    part += turn * max(math.ceil((first - part) / turn), 0)  # an arc may go round more than once
    return (part,) if first <= part <= last else (first, last)
