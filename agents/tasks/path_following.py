"""Circular path following: the estimate and a speed in, a twist out."""

from __future__ import annotations

from agents.robot import Robot
from muro_zenoh import channels
from muro_zenoh.config import Section
from muro_zenoh.control.circle import CircleLaw, circle_law
from muro_zenoh.messages import SpeedReference
from muro_zenoh.quantities import Positive, SpeedOrRest
from muro_zenoh.transport import Latest

_STALE = channels.VELOCITY.stale_after or 0.0


class CircleParameters(Section, frozen=True, kw_only=True):
    """Parameters of the behaviour ``circle``.

    Attributes:
        law: ``vector_field``, ``passivity`` or ``lqr``.
        speed: while nobody has said another on ``muro/velocity/<name>`` [m/s].
        k_o: gain of the vector field on the radius error [1/m].
        k_h: gain of the vector field on the heading error [1/s].
        psi: gain of the passivity law.
        radial_size: weight of ``lqr``: the radius error that counts as much as the other two sizes [m].
        heading_size: weight of ``lqr``: the heading error that counts as much [rad].
        turn_size: weight of ``lqr``: the turning rate that counts as much [rad/s].
    """

    law: str = "vector_field"
    speed: SpeedOrRest = 0.2
    k_o: Positive | None = None
    k_h: Positive | None = None
    psi: Positive | None = None
    radial_size: Positive | None = None
    heading_size: Positive | None = None
    turn_size: Positive | None = None

    def circle_law(self) -> CircleLaw:
        """The law with the gains that were given."""
        names = ("k_o", "k_h", "psi", "radial_size", "heading_size", "turn_size")
        gains = {name: getattr(self, name) for name in names}
        return circle_law(self.law, **{name: gain for name, gain in gains.items() if gain is not None})


async def circle(robot: Robot) -> None:
    """Follow the circle at the speed of ``muro/velocity/<name>``, or at a default one while nobody has said any."""
    parameters = robot.parameters_as(CircleParameters)
    await follow_circle(robot, parameters.circle_law(), parameters.speed)


async def follow_circle(robot: Robot, law: CircleLaw, default_speed: float | None) -> None:
    """Await the newest estimate, call the law, drive.

    Args:
        robot: the robot.
        law: the circle law.
        default_speed: while nobody has said a speed [m/s]; None: stand still until somebody does.
    """
    speeds = robot.speed_references()
    try:
        async for estimate in robot.estimates():
            goal = robot.circle
            if goal is None:
                robot.hold("no circle heard yet")
                continue
            speed = _speed(speeds, robot, default_speed)
            pose = robot.ahead()
            if speed is None or pose is None:
                robot.hold("the velocity is silent")
                continue
            robot.drive(speed, law(pose.x, pose.y, pose.theta, max(estimate.v, 0.0), goal))
    finally:
        speeds.close()


def _speed(speeds: Latest[SpeedReference], robot: Robot, default: float | None) -> float | None:
    """The speed to go, or None when who said one has fallen silent. Backwards the laws lead away from the circle, and
    out of the arena: who is told to go so stands."""
    said = speeds.get()
    if said is None:
        return default
    return max(said.message.speed, 0.0) if said.age(robot.now) <= _STALE else None
