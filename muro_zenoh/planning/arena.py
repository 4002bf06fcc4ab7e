"""Paths that stay inside the arena and clear of its walls; goals and paths that do not are refused with the reason."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from muro_zenoh.errors import ParameterError, PlanningError
from muro_zenoh.geometry import Bounds, Pose2, wrap_to_pi
from muro_zenoh.planning.clearance import clearance
from muro_zenoh.planning.destination import require_inside
from muro_zenoh.planning.dubins import WORDS, Word, all_words, path_of
from muro_zenoh.planning.path import Path
from muro_zenoh.walls import Wall


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
    x_min, x_max, y_min, y_max = path.extent()
    out = max(inside.x_min - x_min, x_max - inside.x_max, inside.y_min - y_min, y_max - inside.y_max)
    if out > 1e-9:
        raise PlanningError(
            f"path from ({path.start.x:.3f}, {path.start.y:.3f}) to ({path.end.x:.3f}, {path.end.y:.3f}) m leaves the "
            f"arena by {out:.3f} m: expected {inside}. Choose another heading at the goal, or a smaller turning radius"
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
    for wall in walls:
        keep = min(margin, wall.distance(path.start.x, path.start.y))
        away = clearance(path, wall)
        if away < keep - 1e-9:
            meets = f"comes within {away:.3f} m of" if away > 0.0 else "crosses"
            raise PlanningError(
                f"path from ({path.start.x:.3f}, {path.start.y:.3f}) to ({path.end.x:.3f}, {path.end.y:.3f}) m {meets} "
                f"{wall}: expected {margin:g} m from it. Set goals on the way round it, such as one in front of a "
                "doorway and one behind"
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
    try:
        require_inside("goal", goal.x, goal.y, bounds, margin, walls)
    except ParameterError as error:
        raise PlanningError(str(error)) from None
    inside = bounds.shrunk(margin)
    # A robot that is nearer to a wall than the margin must be able to drive away from it.
    room = Bounds(
        min(inside.x_min, start.x), max(inside.x_max, start.x), min(inside.y_min, start.y), max(inside.y_max, start.y)
    )
    words = all_words(np.array(start), np.array(goal), radius)
    refused: PlanningError | None = None
    for k in np.argsort(words.size, kind="stable").tolist():
        if not np.isfinite(words.size[k]):
            break
        sizes = (float(words.first[k]), float(words.middle[k]), float(words.last[k]))
        path = path_of(start, Word(WORDS[k], *sizes), radius)
        try:
            require_path_inside(path, room)
            require_path_clear(path, walls, margin)
        except PlanningError as error:
            refused = refused or error
        else:
            return path
    assert refused is not None  # LSL and RSR always exist
    raise refused


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

    A robot close to a wall and facing it has no Dubins path at all, but a unicycle can turn first. The path starts with
    the heading to turn to, ``path.start.theta``, which is the robot's own when no turn is needed.

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
            heading that needs a path through the wall; the message is that without a turn.
    """
    refused: PlanningError | None = None
    for k in range(math.floor(math.pi / step + 1e-9) + 1):
        for side in (1.0, -1.0) if k else (0.0,):
            turned = start if k == 0 else Pose2(start.x, start.y, wrap_to_pi(start.theta + side * k * step))
            try:
                return plan_inside(turned, goal, radius, bounds, margin, walls)
            except PlanningError as error:
                refused = refused or error
    assert refused is not None
    raise refused
