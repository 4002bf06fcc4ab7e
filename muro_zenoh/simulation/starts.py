"""Random start poses."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from muro_zenoh.elementwise import Array
from muro_zenoh.errors import PlanningError
from muro_zenoh.geometry import Bounds
from muro_zenoh.safety.separation import SeparationSettings
from muro_zenoh.walls import Wall
from muro_zenoh.wording import counted

_TRIES = 400
_LAYOUTS = 50


def starts_of(
    given: Mapping[str, Sequence[float]],
    names: Sequence[str],
    rng: np.random.Generator,
    bounds: Bounds,
    radii: Array,
    margin: float,
    walls: Sequence[Wall] = (),
) -> Array:
    """The poses at which robots start: the given ones, or random ones.

    Args:
        given: x, y [m, world], theta [rad] by name, of all robots or of none.
        names: the robots.
        rng: the generator.
        bounds: the arena.
        radii: of the bodies (n,) [m].
        margin: of random poses: minimum gap between two bodies, and between a body and a wall [m].
        walls: the walls inside the arena.

    Returns:
        (n, 3): x, y [m, world], theta [rad, (-pi, pi]].

    Raises:
        PlanningError: the robots do not fit.
    """
    if given:
        return np.array([given[name] for name in names], dtype=np.float64)
    return random_starts(rng, len(names), bounds, radii, margin, walls)


def random_starts(
    rng: np.random.Generator,
    n: int,
    bounds: Bounds,
    radius: float | Array,
    margin: float = SeparationSettings().margin,
    walls: Sequence[Wall] = (),
) -> Array:
    """Random poses that touch neither each other nor the walls.

    Args:
        rng: the generator; the same seed gives the same starts.
        n: number of robots.
        bounds: the arena.
        radius: of the bodies [m], of all robots or (n,).
        margin: minimum gap between two bodies, and between a body and a wall [m]; by default what the separation filter
            keeps, for closer robots are held where they are until one of them leaves.
        walls: the walls inside the arena.

    Returns:
        (n, 3): x, y [m, world], theta [rad, (-pi, pi]].

    Raises:
        PlanningError: the robots do not fit.
    """
    radii = np.broadcast_to(np.asarray(radius, dtype=np.float64), (n,))
    width, height = bounds.width, bounds.height
    widest = 2.0 * float(radii.max(initial=0.0)) + 2.0 * margin
    if widest > min(width, height):
        raise PlanningError(
            f"an arena of {width:g} x {height:g} m holds no robot that needs {widest:g} m: enlarge the arena"
        )
    bodies = float(np.sum(math.pi * (radii + 0.5 * margin) ** 2))
    most = 0
    if bodies <= 0.9069 * width * height:  # the densest packing of equal discs
        for _ in range(_LAYOUTS):
            poses = _lay_out(rng, bounds, radii, margin, walls)
            if len(poses) == n:
                return poses
            most = max(most, len(poses))
    between = f" with {counted(len(walls), 'wall')} in it" if walls else ""
    raise PlanningError(
        f"{n} robots (bodies of {bodies:.2f} m^2) do not fit in an arena of {width:g} x {height:g} m "
        f"({width * height:.2f} m^2) without touching{between}; {most} were placed: use fewer robots or a larger arena"
    )


def _lay_out(rng: np.random.Generator, bounds: Bounds, radii: Array, margin: float, walls: Sequence[Wall]) -> Array:
    """Poses placed one after the other, until one finds no free position."""
    poses = np.empty((len(radii), 3))
    for i, own in enumerate(radii):
        inside = bounds.shrunk(own + margin)
        tries = np.column_stack(
            (
                rng.uniform(inside.x_min, inside.x_max, _TRIES),
                rng.uniform(inside.y_min, inside.y_max, _TRIES),
                rng.uniform(-math.pi, math.pi, _TRIES),
            )
        )
        away = np.hypot(tries[:, None, 0] - poses[None, :i, 0], tries[:, None, 1] - poses[None, :i, 1])
        clear = (away > own + radii[:i] + margin).all(axis=1)
        for wall in walls:
            clear &= wall.distance(tries[:, 0], tries[:, 1]) > own + margin
        free = np.flatnonzero(clear)
        if not len(free):
            return poses[:i]
        poses[i] = tries[free[0]]
    return poses
