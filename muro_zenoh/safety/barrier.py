"""The classical barrier certificate, for comparison: what simulators of robot crowds offer as their safety filter.

It is not the default (:mod:`muro_zenoh.safety.separation`): it knows neither braking distances nor the age of a
position, and it keeps the points ahead of the axles apart instead of the bodies.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from muro_zenoh.geometry import Bounds, State, Twist2
from muro_zenoh.quantities import Length, Quantity, check_quantities
from muro_zenoh.safety.separation import Body
from muro_zenoh.safety.separation.projection import Row, nearest_velocity

_TOUCHING = 1e-3  # stands for two points at one place [m]


@dataclass(frozen=True, slots=True)
class Barrier:
    """Barrier certificates on the points ahead of the axles: one quadratic programme per robot and step.

    With ``p`` the point ahead of the axle, which can move in any direction, ``u`` its velocity, and
    ``h = |p_i - p_j|^2 - (r_i + r_j + 2 ahead)^2``, each robot takes half of what a pair must satisfy::

        minimise |u - u_desired|^2,  subject to  -2 (p_i - p_j) . u <= gain h^3 / 2   for each neighbour j
                                                 n . u <= wall_gain c^3               for each wall
                                                 |u . sideways| <= ahead omega_max

    with ``n`` a wall's normal, outwards, and ``c`` the point's distance from the wall, less the radius.

    Args:
        ahead: how far ahead of the axle the point is [m].
        gain: of the pairs [1/(m^4 s)].
        wall_gain: of the walls [1/(m^2 s)].

    Source: Wang, Ames and Egerstedt, Safety barrier certificates for collisions-free multirobot systems, IEEE
    Transactions on Robotics 33, 2017, with the cubic barrier of the Robotarium; the point ahead as in seed 001.
    """

    ahead: Length = 0.05
    gain: Annotated[float, Quantity("1/(m^4 s)", above=0.0)] = 1000.0
    wall_gain: Annotated[float, Quantity("1/(m^2 s)", above=0.0)] = 100.0

    def __post_init__(self) -> None:
        check_quantities(self)

    def twist(
        self, state: State, desired: Twist2, body: Body, others: Sequence[tuple[State, float]], arena: Bounds
    ) -> Twist2:
        """The twist nearest to the desired one, in the velocity of the point ahead, that the barriers allow.

        Robots that are too close already may exclude each other's every velocity: then the worst violation is least.

        Args:
            state: of the robot.
            desired: the desired twist.
            body: the robot's size and limits.
            others: the other robots' states and radii [m].
            arena: the walls.
        """
        wanted = self.velocity(state, desired)
        allowed = nearest_velocity(self.rows(state, body, others, arena), *wanted, body.v_max)
        return self.twist_for(state, *allowed)

    def rows(self, state: State, body: Body, others: Sequence[tuple[State, float]], arena: Bounds) -> list[Row]:
        """The half-planes of the velocity of the point ahead [m/s, world]: neighbours, walls, turning rate.

        Args:
            state: of the robot.
            body: the robot's size and limits.
            others: the other robots' states and radii [m].
            arena: the walls.
        """
        x, y = self.point(state)
        rows = []
        for other, radius in others:
            other_x, other_y = self.point(other)
            dx, dy = other_x - x, other_y - y
            distance = max(math.hypot(dx, dy), _TOUCHING)
            h = distance * distance - (body.radius + radius + 2.0 * self.ahead) ** 2
            rows.append(Row(dx / distance, dy / distance, 0.25 * self.gain * h**3 / distance))
        for nx, ny, away in (
            (1.0, 0.0, arena.x_max - x),
            (-1.0, 0.0, x - arena.x_min),
            (0.0, 1.0, arena.y_max - y),
            (0.0, -1.0, y - arena.y_min),
        ):
            rows.append(self.wall(nx, ny, away, body))
        c, s = math.cos(state.theta), math.sin(state.theta)
        sideways = self.ahead * body.omega_max
        return [*rows, Row(-s, c, sideways), Row(s, -c, sideways)]

    def wall(self, nx: float, ny: float, away: float, body: Body) -> Row:
        """The half-plane of one wall.

        Args:
            nx: direction from the point ahead to the wall, of length 1.
            ny: the same.
            away: distance of the point from the wall [m].
            body: the robot's size and limits.
        """
        return Row(nx, ny, self.wall_gain * (away - body.radius) ** 3)

    def point(self, state: State) -> tuple[float, float]:
        """The point ahead of the axle [m, world].

        Args:
            state: of the robot.
        """
        return state.x + self.ahead * math.cos(state.theta), state.y + self.ahead * math.sin(state.theta)

    def velocity(self, state: State, twist: Twist2) -> tuple[float, float]:
        """The velocity of the point ahead [m/s, world].

        Args:
            state: of the robot.
            twist: of the robot.
        """
        c, s = math.cos(state.theta), math.sin(state.theta)
        across = self.ahead * twist.omega
        return c * twist.v - s * across, s * twist.v + c * across

    def twist_for(self, state: State, vx: float, vy: float) -> Twist2:
        """The twist that gives the point ahead a velocity.

        Args:
            state: of the robot.
            vx: the velocity [m/s, world].
            vy: the same.
        """
        c, s = math.cos(state.theta), math.sin(state.theta)
        return Twist2(c * vx + s * vy, (c * vy - s * vx) / self.ahead)
