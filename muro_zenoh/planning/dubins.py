"""Dubins curves: the shortest path between two poses for a car that drives forwards and turns no tighter than a radius.

The shortest is one of six words (L left arc, S straight, R right arc): LSL RSR LSR RSL RLR LRL. Each follows from the
two turning circles that it joins: with ``d`` from the centre of the first to that of the last, in turning radii,

* outer tangent (LSL, RSR): straight ``|d|``;
* inner tangent (LSR, RSL): straight ``sqrt(|d|^2 - 4)``, where the circles do not overlap;
* a third circle between (RLR, LRL): middle arc ``2 pi - acos(1 - |d|^2 / 8)``, where ``|d| < 4``.

Arcs are taken modulo a whole turn; an arc within 1e-9 of a whole turn is 0, and circles that overlap by less than that
touch, or rounding would add a full circle.

Source: Dubins, American Journal of Mathematics 79, 1957; seed 004, section 4.
"""

from __future__ import annotations

import math
from math import acos, atan2, cos, pi, sin, sqrt
from typing import Final, NamedTuple

import numpy as np

from muro_zenoh.elementwise import Array
from muro_zenoh.geometry import TWO_PI, Pose2
from muro_zenoh.planning.path import Path, Segment

WORDS: Final = ("LSL", "RSR", "LSR", "RSL", "RLR", "LRL")
"""The six words; of words of equal length the first is taken."""

_NONE: Final = 1e-9
_FULL: Final = TWO_PI - _NONE
_TOUCHING: Final = 4.0 - _NONE
_TURN: Final = {"L": 1.0, "S": 0.0, "R": -1.0}


class Word(NamedTuple):
    """A word with the sizes of its three pieces, in turning radii: arcs in rad, the straight as a multiple.

    Args:
        word: one of :data:`WORDS`.
        first: size of the first piece [-].
        middle: size of the second [-].
        last: size of the third [-].
    """

    word: str
    first: float
    middle: float
    last: float

    @property
    def size(self) -> float:
        """Length of the path in turning radii [-]."""
        return self.first + self.middle + self.last


def shortest_word(start: Pose2, goal: Pose2, radius: float) -> Word:
    """The shortest of the six words between two poses.

    Args:
        start: where the path begins [world].
        goal: where it ends [world].
        radius: the turning radius [m], above 0.
    """
    x0, y0, a0 = start
    x1, y1, a1 = goal
    dx, dy = (x1 - x0) / radius, (y1 - y0) / radius
    s0, c0, s1, c1 = sin(a0), cos(a0), sin(a1), cos(a1)
    # The net turn, to the left and to the right: two arcs one way add up to it, or to a whole turn more.
    to_left = (a1 - a0) % TWO_PI
    if to_left > _FULL:
        to_left = 0.0
    to_right = TWO_PI - to_left if to_left > _NONE else 0.0

    # From left centre to left centre.
    x, y = dx + s0 - s1, dy - c0 + c1
    left = p = sqrt(x * x + y * y)
    left_way = atan2(y, x)
    if p > _NONE:
        t = (left_way - a0) % TWO_PI
        if t > _FULL:
            t = 0.0
        q = to_left - t
        if q < 0.0:
            q = q + TWO_PI if q < -_NONE else 0.0
    else:
        # Circles that coincide have no tangent: the path is one arc.
        t, q = to_left, 0.0
    best = t + p + q
    word = "LSL"
    first, middle, last = t, p, q

    # From right centre to right centre. Here and below, words that cannot be shorter are skipped.
    x, y = dx - s0 + s1, dy + c0 - c1
    right = p = sqrt(x * x + y * y)
    right_way = atan2(y, x) if p + to_right < best or p < 4.0 else 0.0
    if p + to_right < best:
        if p > _NONE:
            t = (a0 - right_way) % TWO_PI
            if t > _FULL:
                t = 0.0
            q = to_right - t
            if q < 0.0:
                q = q + TWO_PI if q < -_NONE else 0.0
        else:
            t, q = to_right, 0.0
        size = t + p + q
        if size < best:
            best = size
            word = "RSR"
            first, middle, last = t, p, q

    # From left centre to right centre and vice versa: the arcs differ by the net turn.
    spare = best - (to_left if to_left < to_right else to_right)
    spare = 4.0 + spare * spare if spare > 0.0 else 0.0
    x, y = dx + s0 + s1, dy - c0 - c1
    square = x * x + y * y
    if _TOUCHING <= square < spare:
        p = sqrt(square - 4.0) if square > 4.0 else 0.0
        t = (atan2(y, x) + atan2(2.0, p) - a0) % TWO_PI
        if t > _FULL:
            t = 0.0
        q = t - to_left
        if q < 0.0:
            q = q + TWO_PI if q < -_NONE else 0.0
        size = t + p + q
        if size < best:
            best = size
            word = "LSR"
            first, middle, last = t, p, q

    x, y = dx - s0 - s1, dy + c0 + c1
    square = x * x + y * y
    if _TOUCHING <= square < spare:
        p = sqrt(square - 4.0) if square > 4.0 else 0.0
        t = (a0 - atan2(y, x) + atan2(2.0, p)) % TWO_PI
        if t > _FULL:
            t = 0.0
        q = t + to_left
        if q > _FULL:
            q = q - TWO_PI if q > TWO_PI else 0.0
        size = t + p + q
        if size < best:
            best = size
            word = "RSL"
            first, middle, last = t, p, q

    # The middle arc of the last two is more than half a turn.
    if best > pi:
        if right < 4.0:
            p = TWO_PI - acos(1.0 - 0.125 * right * right)
            t = (a0 - right_way + 0.5 * p) % TWO_PI
            q = (a0 - a1 - t + p) % TWO_PI
            t, q = 0.0 if t > _FULL else t, 0.0 if q > _FULL else q
            size = t + p + q
            if size < best:
                best = size
                word = "RLR"
                first, middle, last = t, p, q

        if left < 4.0:
            p = TWO_PI - acos(1.0 - 0.125 * left * left)
            t = (left_way - a0 + 0.5 * p) % TWO_PI
            q = (a1 - a0 - t + p) % TWO_PI
            t, q = 0.0 if t > _FULL else t, 0.0 if q > _FULL else q
            if t + p + q < best:
                word = "LRL"
                first, middle, last = t, p, q

    # A named tuple's own constructor takes as long as one of the words.
    return tuple.__new__(Word, (word, first, middle, last))


def path_of(start: Pose2, word: Word, radius: float) -> Path:
    """The path of a word from a start; always three segments, some of which may have length 0.

    Args:
        start: where the path begins [world].
        word: the word and its sizes.
        radius: the turning radius [m], above 0.
    """
    sizes = (word.first, word.middle, word.last)
    return Path(
        start, tuple(Segment(size * radius, _TURN[c] / radius) for c, size in zip(word.word, sizes, strict=True))
    )


def plan(start: Pose2, goal: Pose2, radius: float) -> Path:
    """The shortest path between two poses. From a pose to itself it has length 0.

    Args:
        start: where the path begins [world].
        goal: where it ends [world]; it may be inside the turning circles.
        radius: the turning radius [m], above 0.

    Raises:
        ValueError: a radius not above 0, or numbers that are not finite.
    """
    if not (radius > 0.0 and math.isfinite(radius + sum(start) + sum(goal))):
        raise ValueError(
            f"Dubins plan: got {start}, {goal} and radius {radius!r} m, expected finite numbers, radius above 0"
        )
    return path_of(start, shortest_word(start, goal, radius), radius)


class WordArrays(NamedTuple):
    """All six words of many pairs, each of shape ``[..., 6]`` in the order of :data:`WORDS`, in turning radii.

    Args:
        size: total length; infinite where a pair has no such word.
        first: size of the first piece.
        middle: size of the second; NaN where a pair has no such word.
        last: size of the third.
    """

    size: Array
    first: Array
    middle: Array
    last: Array


def all_words(start: Array, goal: Array, radius: float) -> WordArrays:
    """All six words for arrays of pairs.

    Args:
        start: poses ``x, y, theta`` [m, m, rad; world], shape ``[..., 3]``.
        goal: poses of a shape that broadcasts with it.
        radius: the turning radius [m], above 0.
    """
    start, goal = np.broadcast_arrays(np.asarray(start, dtype=float), np.asarray(goal, dtype=float))
    dx, dy = (goal[..., 0] - start[..., 0]) / radius, (goal[..., 1] - start[..., 1]) / radius
    a0, a1 = start[..., 2], goal[..., 2]
    s0, c0, s1, c1 = np.sin(a0), np.cos(a0), np.sin(a1), np.cos(a1)
    lx, ly, rx, ry = dx + s0 - s1, dy - c0 + c1, dx - s0 + s1, dy + c0 - c1
    left, right = np.hypot(lx, ly), np.hypot(rx, ry)
    left_way, right_way = np.arctan2(ly, lx), np.arctan2(ry, rx)
    one_left, one_right = left <= _NONE, right <= _NONE

    lsl = (np.where(one_left, a1, left_way) - a0, left, np.where(one_left, 0.0, a1 - left_way))
    rsr = (a0 - np.where(one_right, a1, right_way), right, np.where(one_right, 0.0, right_way - a1))

    def inner(x: Array, y: Array, sign: float) -> tuple[Array, Array, Array]:
        square = x * x + y * y
        p = np.sqrt(np.where(square >= _TOUCHING, np.maximum(square - 4.0, 0.0), np.nan))
        way = np.arctan2(y, x) + sign * np.arctan2(2.0, p)
        return sign * (way - a0), p, sign * (way - a1)

    def middle(distance: Array, way: Array, sign: float) -> tuple[Array, Array, Array]:
        p = TWO_PI - np.arccos(np.where(distance < 4.0, 1.0 - 0.125 * distance * distance, np.nan))
        t = sign * (way - a0) + 0.5 * p
        return t, p, sign * (a1 - a0) - t + p

    words = (
        lsl,
        rsr,
        inner(dx + s0 + s1, dy - c0 - c1, 1.0),
        inner(dx - s0 - s1, dy + c0 + c1, -1.0),
        middle(right, right_way, -1.0),
        middle(left, left_way, 1.0),
    )
    first, straight, last = (np.stack([word[k] for word in words], axis=-1) for k in range(3))
    first, last = np.mod(first, TWO_PI), np.mod(last, TWO_PI)
    first, last = np.where(first > _FULL, 0.0, first), np.where(last > _FULL, 0.0, last)
    size = first + straight + last
    return WordArrays(np.where(np.isnan(size), np.inf, size), first, straight, last)
