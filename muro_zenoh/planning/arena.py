"""Paths that stay inside the arena and clear of its walls; goals and paths that do not are refused with the reason."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from muro_zenoh.errors import ParameterError, PlanningError
from muro_zenoh.geometry import Bounds, Pose2, wrap_to_pi
from muro_zenoh.planning.clearance import clearance
from muro_zenoh.planning.destination import require_inside
from muro_zenoh.planning.dubins import WORDS, Word, all_words, path_of
from muro_zenoh.planning.path import Path
from muro_zenoh.walls import Wall

_ROUNDING: Final = 1e-9
"""A path may come nearer than it must by this [m]."""


def require_path_inside(path: Path, bounds: Bounds, margin: float = 0.0) -> None:
    """Refuse a path that leaves the arena anywhere; exact on arcs.

    Args:
        path: the path.
        bounds: the arena.
        margin: distance that the robot's centre keeps from the walls [m].

    Raises:
        PlanningError: the path leaves the arena; the message says by how much.
    """
    inside = bounds.shrunk(margin)
    out = _outside(path, inside)
    if out > _ROUNDING:
        raise PlanningError(
            f"{_from_to(path)} leaves the arena by {out:.3f} m: expected {inside}. Choose another heading at the goal, "
            "or a smaller turning radius"
        )


def require_path_clear(path: Path, walls: Sequence[Wall], margin: float) -> None:
    """Refuse a path that comes too near a wall inside the arena.

    Args:
        path: the path.
        walls: the walls.
        margin: distance that the robot's centre keeps from them [m]; at the start it may be nearer.

    Raises:
        PlanningError: the path comes too near; the message says which wall, and how near.
    """
    wall = _too_near(path, _kept(path.start, walls, margin))
    if wall is not None:
        away = clearance(path, wall)
        meets = f"comes within {away:.3f} m of" if away > 0.0 else "crosses"
        raise PlanningError(
            f"{_from_to(path)} {meets} {wall}: expected {margin:g} m from it. Set goals on the way round it, such as "
            "one in front of a doorway and one behind"
        )


def plan_inside(
    start: Pose2, goal: Pose2, radius: float, bounds: Bounds, margin: float = 0.0, walls: Sequence[Wall] = ()
) -> Path:
    """The shortest Dubins path, of the six words, that stays inside the arena and clear of the walls in it.

    Args:
        start: where the path begins [world].
        goal: where it ends [world].
        radius: the turning radius [m], above 0.
        bounds: the arena.
        margin: distance that the robot's centre keeps from the walls [m]; a path may start nearer to a wall than this.
        walls: the walls inside the arena.

    Raises:
        PlanningError: the goal is outside or at a wall, or every word leaves the arena or comes too near a wall; the
            message is that of the shortest.
    """
    return _plan([start], goal, radius, bounds, margin, walls)


def plan_after_turn(
    start: Pose2,
    goal: Pose2,
    radius: float,
    bounds: Bounds,
    margin: float = 0.0,
    walls: Sequence[Wall] = (),
    step: float = math.pi / 12,
) -> Path:
    """A path inside the arena after the smallest turn on the spot that makes one possible.

    A robot close to a wall and facing it has no Dubins path at all (:func:`plan_inside`), but a unicycle can turn
    first. The path starts with the heading to turn to, ``path.start.theta``.

    Args:
        start: the robot's pose [world].
        goal: where the path ends [world].
        radius: the turning radius [m], above 0.
        bounds: the arena.
        margin: distance that the robot's centre keeps from the walls [m].
        walls: the walls inside the arena.
        step: turns are tried in multiples of this, to the left and to the right [rad].

    Raises:
        PlanningError: the goal is outside, or no turn makes a path possible, as for a goal near a wall with a
            heading that needs a path through the wall; the message is that of the smallest turn.
    """
    turns = [side * k * step for k in range(1, math.floor(math.pi / step + 1e-9) + 1) for side in (1.0, -1.0)]
    starts = [Pose2(start.x, start.y, wrap_to_pi(start.theta + turn)) for turn in turns]
    return _plan(starts, goal, radius, bounds, margin, walls)


def _plan(
    starts: Sequence[Pose2], goal: Pose2, radius: float, bounds: Bounds, margin: float, walls: Sequence[Wall]
) -> Path:
    """The shortest path from the first of some poses at one place that has any."""
    try:
        require_inside("goal", goal.x, goal.y, bounds, margin, walls)
    except ParameterError as error:
        raise PlanningError(str(error)) from None
    inside, (x, y, _) = bounds.shrunk(margin), starts[0]
    # A robot that is nearer to a wall than the margin must be able to drive away from it.
    room = Bounds(min(inside.x_min, x), max(inside.x_max, x), min(inside.y_min, y), max(inside.y_max, y))
    kept = _kept(starts[0], walls, margin)
    refused: Path | None = None
    for path in _candidates(starts, goal, radius):
        if _outside(path, room) <= _ROUNDING and _too_near(path, kept) is None:
            return path
        refused = refused or path
    assert refused is not None  # LSL and RSR always exist
    require_path_inside(refused, room)
    require_path_clear(refused, walls, margin)
    raise AssertionError("one of the two has refused it")


def _candidates(starts: Sequence[Pose2], goal: Pose2, radius: float) -> Iterator[Path]:
    """The paths of all words from each start, the shortest first."""
    words = all_words(np.array(starts), np.array(goal), radius)
    rows = zip(starts, *(part.tolist() for part in words), strict=True)
    for start, sizes, first, middle, last in rows:
        for k in sorted(range(len(WORDS)), key=sizes.__getitem__):
            if math.isfinite(sizes[k]):
                yield path_of(start, Word(WORDS[k], first[k], middle[k], last[k]), radius)


def _outside(path: Path, inside: Bounds) -> float:
    """How far a path leaves a rectangle [m]; not above 0 when it does not."""
    x_min, x_max, y_min, y_max = path.extent()
    return max(inside.x_min - x_min, x_max - inside.x_max, inside.y_min - y_min, y_max - inside.y_max)


def _kept(start: Pose2, walls: Sequence[Wall], margin: float) -> list[tuple[Wall, float]]:
    """The walls, and how far a path keeps from each [m]: the margin, or what it has at its start if that is less."""
    return [(wall, min(margin, wall.distance(start.x, start.y))) for wall in walls]


def _too_near(path: Path, kept: Sequence[tuple[Wall, float]]) -> Wall | None:
    """The first wall that a path comes too near."""
    for wall, keep in kept:
        if clearance(path, wall, keep) < keep - _ROUNDING:
            return wall
    return None


def _from_to(path: Path) -> str:
    return f"path from ({path.start.x:.3f}, {path.start.y:.3f}) to ({path.end.x:.3f}, {path.end.y:.3f}) m"
