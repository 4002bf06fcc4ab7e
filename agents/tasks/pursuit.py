"""Cyclic pursuit: all positions in, a speed out; path following does the rest."""

from __future__ import annotations

import asyncio

from agents.robot import Robot
from agents.tasks.path_following import CircleParameters, follow_circle
from muro_zenoh import channels
from muro_zenoh.behaviours.entry_points import load_function
from muro_zenoh.control.pursuit import PursuitLaw, pursue
from muro_zenoh.control.ring import RingRobot
from muro_zenoh.messages import Estimate
from muro_zenoh.quantities import NotNegative, Positive

_STALE = channels.ALL_POSITIONS.stale_after or 0.0

_STANDS_AFTER = 1.0
"""A robot that has not moved for so long is not taking part [s]."""


class PursuitParameters(CircleParameters, frozen=True, kw_only=True):
    """Parameters of the behaviour ``pursuit``, besides those of ``circle``.

    Attributes:
        pursuit: ``two_gap``, ``normalised``, ``proportional`` or ``importance``.
        cruise: speed of an evenly spread ring [m/s].
        gain: of the pursuit law; its own default when it is not given.
        v_min: least speed on the ring [m/s].
        v_max: greatest speed on the ring [m/s].
        angles: for ``importance``: angles on the circle [rad] ...
        weights: ... and how much each matters, above 0; in between it is interpolated.
        importance: for ``importance``, instead of a table: ``module:function``, from an angle [rad] to a weight.
    """

    pursuit: str = "two_gap"
    cruise: NotNegative = 0.2
    gain: Positive | None = None
    v_min: NotNegative = 0.05
    v_max: Positive = 0.4
    angles: tuple[float, ...] = ()
    weights: tuple[float, ...] = ()
    importance: str = ""

    def pursuit_law(self) -> PursuitLaw:
        """The law with its gain and limits.

        Raises:
            ValueError: an unknown law, or numbers that do not fit together.
            BehaviourError: an importance function that cannot be loaded.
        """
        if not (self.importance or self.angles or self.weights):
            return PursuitLaw(self.pursuit, self.cruise, self.gain, self.v_min, self.v_max)
        from muro_zenoh.control.importance import Importance  # needs numpy, which most agents do without

        if self.importance:
            importance = Importance.from_function(load_function(self.importance))
        else:
            importance = Importance.from_table(self.angles, self.weights)
        return PursuitLaw(self.pursuit, self.cruise, self.gain, self.v_min, self.v_max, importance)


async def pursuit(robot: Robot) -> None:
    """Spread evenly round the circle: a speed for path following, from everybody's places."""
    parameters = robot.parameters_as(PursuitParameters)
    law = parameters.pursuit_law()
    async with asyncio.TaskGroup() as tasks:
        # First, so that each estimate has its speed when path following takes it.
        tasks.create_task(_pursue(robot, law), name="pursuit")
        tasks.create_task(follow_circle(robot, parameters.circle_law(), None), name="path following")


async def _pursue(robot: Robot, law: PursuitLaw) -> None:
    order: tuple[str, ...] = ()
    moved: dict[str, float] = {}
    async for estimate in robot.estimates():
        circle = robot.circle
        # Without fresh positions no speed is said, and path following stands still.
        if circle is None or robot.snapshot_age > _STALE:
            continue
        step = pursue(robot.name, _ring(robot, estimate, moved, 0.5 * law.v_min), circle, order, law)
        order = step.order
        robot.velocity(step.speed)


def _ring(robot: Robot, estimate: Estimate, moved: dict[str, float], still: float) -> dict[str, RingRobot]:
    """Who counts: oneself as one knows oneself, and the others that are seen now, not told to stop, and move.

    One that only stands there (its agent has died, or it does something else) would keep a gap to itself for ever.

    Args:
        robot: the robot.
        estimate: its own.
        moved: when each of the others was last seen to move, or first seen [s]; brought up to date here.
        still: who is not faster than this stands [m/s].
    """
    now, stopped = robot.now, robot.stopped
    ring = {}
    for other in robot.neighbours:
        if other.state not in ("tracking", "disagrees"):
            moved.pop(other.name, None)
            continue
        if abs(other.v) > still or other.name not in moved:
            moved[other.name] = now
        if now - moved[other.name] <= _STANDS_AFTER and other.name not in stopped:
            ring[other.name] = RingRobot(other.x, other.y, other.theta, other.v, other.age)
    age = now - estimate.stamp
    ring[robot.name] = RingRobot(estimate.x, estimate.y, estimate.theta, estimate.v, age)
    return ring
