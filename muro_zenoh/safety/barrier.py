"""The classical barrier certificate, for comparison: what most simulators of robot crowds offer as their safety filter.

It is not the default (:mod:`muro_zenoh.safety.separation`): it knows neither braking distances nor the age of a
position, and it keeps the points ``ahead`` of the axles apart instead of the bodies.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated

from muro_zenoh.geometry import STILL, Bounds, State, Twist2
from muro_zenoh.quantities import Length, Quantity, check_quantities
from muro_zenoh.safety.half_planes import HalfPlane, nearest

Solver = Callable[[float, float, Sequence[HalfPlane]], tuple[float, float] | None]
"""``solve(x, y, rows)``: the point nearest to (x, y) in all half-planes, or None when there is none."""

_TOUCHING = 1e-3  # stands for points at one place [m]


@dataclass(frozen=True, slots=True)
class Barrier:
    """Barrier certificates on the points ahead of the axles, one quadratic programme per robot and step.

    With ``p`` the point ``ahead`` of the axle, which can move in any direction, ``u`` its velocity, and
    ``h = |p_i - p_j|^2 - (r_i + r_j + 2 ahead)^2``, each robot takes half of the common condition::

        minimise |u - u_desired|^2,   subject to   -2 (p_i - p_j) . u_i <= gain h^3 / 2   for each neighbour j
                                                    n . u_i <= wall_gain c^3              for each wall

    where ``c`` is the distance of the point from a wall with outward normal ``n``, less the radius, and to what the
    wheels can do, ``|u . forwards| <= v_max`` and ``|u . sideways| <= ahead omega_max``.

    Args:
        ahead: how far ahead of the axle the point is [m].
        gain: of the pairs [1/(m^4 s)].
        wall_gain: of the walls [1/(m^2 s)].

    Source: Wang, Ames and Egerstedt, Safety barrier certificates for collisions-free multirobot systems, IEEE
    Transactions on Robotics 33, 2017, with the cubic barrier of the Robotarium; points ahead as in seed 001.
    """

    ahead: Length = 0.05
    gain: Annotated[float, Quantity("1/(m^4 s)", above=0.0)] = 500.0
    wall_gain: Annotated[float, Quantity("1/(m^2 s)", above=0.0)] = 100.0

    def __post_init__(self) -> None:
        check_quantities(self)

    def point(self, state: State) -> tuple[float, float]:
        """The point ahead of a robot's axle [m, world].

        Args:
            state: the robot's.
        """
        return state.x + self.ahead * math.cos(state.theta), state.y + self.ahead * math.sin(state.theta)

    def rows(
        self,
        state: State,
        radius: float,
        others: Sequence[tuple[State, float]],
        arena: Bounds,
        v_max: float,
        omega_max: float,
    ) -> list[HalfPlane]:
        """The half-planes in which the velocity of the point ahead must be [m/s, world]: neighbours, walls, limits.

        Args:
            state: of the robot.
            radius: of its body [m].
            others: the other robots' states and radii [m].
            arena: the walls.
            v_max: the robot's maximum speed [m/s].
            omega_max: its maximum turning rate [rad/s].
        """
        x, y = self.point(state)
        rows = []
        for other, size in others:
            other_x, other_y = self.point(other)
            dx, dy = x - other_x, y - other_y
            distance = max(math.hypot(dx, dy), _TOUCHING)
            h = distance * distance - (radius + size + 2.0 * self.ahead) ** 2
            rows.append(HalfPlane(-dx / distance, -dy / distance, 0.25 * self.gain * h**3 / distance))
        rows += (
            HalfPlane(1.0, 0.0, self.wall_gain * (arena.x_max - radius - x) ** 3),
            HalfPlane(-1.0, 0.0, self.wall_gain * (x - arena.x_min - radius) ** 3),
            HalfPlane(0.0, 1.0, self.wall_gain * (arena.y_max - radius - y) ** 3),
            HalfPlane(0.0, -1.0, self.wall_gain * (y - arena.y_min - radius) ** 3),
        )
        c, s = math.cos(state.theta), math.sin(state.theta)
        sideways = self.ahead * omega_max
        rows += (
            HalfPlane(c, s, v_max),
            HalfPlane(-c, -s, v_max),
            HalfPlane(-s, c, sideways),
            HalfPlane(s, -c, sideways),
        )
        return rows


def filter_twist(
    desired: Twist2, state: State, ahead: float, rows: Sequence[HalfPlane], solve: Solver = nearest
) -> Twist2:
    """The twist nearest to the desired one, in the velocity of the point ahead, that all half-planes allow.

    Robots that are too close already may ask for more than the wheels can do: then it is enough that they approach
    no further, which standing still always satisfies.

    Args:
        desired: the desired twist.
        state: of the robot.
        ahead: how far ahead of the axle the point is [m].
        rows: the half-planes, from :meth:`Barrier.rows`.
        solve: the quadratic programme.
    """
    c, s = math.cos(state.theta), math.sin(state.theta)
    sideways = ahead * desired.omega
    wanted = c * desired.v - s * sideways, s * desired.v + c * sideways
    velocity = solve(*wanted, rows) or solve(*wanted, [row._replace(limit=max(0.0, row.limit)) for row in rows])
    if velocity is None:
        return STILL
    ux, uy = velocity
    return Twist2(c * ux + s * uy, (c * uy - s * ux) / ahead)
