"""Follow the circle: circular path following at the speed of ``muro/velocity/<name>``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from muro_zenoh.behaviours.interface import (
    Behaviour,
    BehaviourKind,
    Expectation,
    Intent,
    Need,
    Seen,
    Vehicle,
    hold,
)
from muro_zenoh.control.circle import CircleLaw, LqrGains, PassivityGains, VectorFieldGains, circle_twist
from muro_zenoh.errors import ParameterError
from muro_zenoh.geometry import Circle
from muro_zenoh.quantities import SpeedOrRest, check_quantities


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """Parameters of circle following.

    Args:
        law: ``vector_field``, ``passivity`` or ``lqr``, with its gains.
        speed: default speed until the first one is received on ``muro/velocity/<name>`` [m/s].
    """

    law: VectorFieldGains | PassivityGains | LqrGains = VectorFieldGains()
    speed: SpeedOrRest = 0.2

    def __post_init__(self) -> None:
        check_quantities(self)


class CircleFollowing(Behaviour):
    """Follow the circle at the received speed, or at a default speed until the first one is received.

    Args:
        law: the circle law.
        speed: the default [m/s].
    """

    def __init__(self, law: CircleLaw, speed: float) -> None:
        self._law = law
        self._speed = speed

    def step(self, seen: Seen) -> Intent:
        """Follow the circle.

        Args:
            seen: the circle, the speed and the robot's state; floats or arrays.
        """
        if seen.circle is None:
            return hold("no circle received yet")
        speed: Any = seen.speed
        if speed is None:
            if seen.speed_age < math.inf:  # the publisher of the speed has timed out: the default must not replace it
                return hold(f"no velocity for {seen.speed_age:.1f} s")
            speed = self._speed + 0.0 * seen.ahead.x
        return Intent(circle_twist(seen.ahead, speed, seen.circle, self._law))


def make(parameters: Parameters, vehicle: Vehicle) -> CircleFollowing:
    """The behaviour of one robot.

    Args:
        parameters: the law and the default speed.
        vehicle: not used.
    """
    return CircleFollowing(CircleLaw(parameters.law), parameters.speed)


def require_room(circle: Circle, fleet: Sequence[Vehicle]) -> None:
    """Refuse a circle on which robots would leave the arena or touch a wall in it.

    Args:
        circle: the circle.
        fleet: the robots; all in one arena.

    Raises:
        ParameterError: the circle is too large for its centre, or comes too near a wall.
    """
    body = max(vehicle.wall_distance for vehicle in fleet)
    arena = fleet[0].arena
    edge = min(circle.x - arena.x_min, arena.x_max - circle.x, circle.y - arena.y_min, arena.y_max - circle.y)
    if circle.radius > edge - body:
        raise ParameterError(
            "circle.radius",
            got=f"{circle.radius:g} m around ({circle.x:g}, {circle.y:g})",
            expected=f"at most {max(edge - body, 0.0):.4g} m, so that robots stay inside the arena, "
            f"{body:g} m from its walls",
        )
    for wall in fleet[0].walls:
        nearest = wall.distance(circle.x, circle.y)
        farthest = max(math.dist(end, (circle.x, circle.y)) for end in (wall[:2], wall[2:]))
        away = max(nearest - circle.radius, circle.radius - farthest, 0.0)
        if away < body - 1e-9:
            raise ParameterError(
                "circle.radius",
                got=f"{circle.radius:g} m around ({circle.x:g}, {circle.y:g}), {away:.3f} m from {wall}",
                expected=f"a circle that is at least {body:g} m from every wall",
                hint="Choose another centre or radius.",
            )


def require_spacing(circle: Circle, fleet: Sequence[Vehicle]) -> None:
    """Refuse a circle on which robots do not fit beside each other at the distance that they keep.

    Args:
        circle: the circle.
        fleet: the robots on it.

    Raises:
        ParameterError: the circle is too small for so many robots.
    """
    count, apart = len(fleet), max(2.0 * vehicle.radius + vehicle.margin for vehicle in fleet)
    chord = 2.0 * circle.radius * math.sin(math.pi / count) if count > 1 else math.inf
    if chord < apart - 1e-9:
        most = int(math.pi / math.asin(min(1.0, 0.5 * apart / circle.radius)))
        raise ParameterError(
            "circle.radius",
            got=f"{count} robots on a circle of {circle.radius:g} m, {chord:.3f} m apart",
            expected=f"at least {apart:g} m between their centres",
            hint=f"At most {most} robots fit on it; {count} robots need a radius of "
            f"{math.ceil(50.0 * apart / math.sin(math.pi / count)) / 100.0:.2f} m.",
        )


def fits(parameters: Parameters, circle: Circle, fleet: Sequence[Vehicle]) -> None:
    """Refuse a circle that the fleet cannot follow.

    Args:
        parameters: not used.
        circle: the circle.
        fleet: the robots.

    Raises:
        ParameterError: they would leave the arena or touch a wall, or be too close on it.
    """
    require_room(circle, fleet)
    require_spacing(circle, fleet)


BEHAVIOUR = BehaviourKind(
    Parameters,
    make,
    "follow the circle at the speed received on velocity/<name>, or at a default speed",
    needs=frozenset({Need.CIRCLE, Need.SPEED}),
    expects=lambda parameters, vehicle: Expectation(follows_circle=True),
    fits=fits,
)
