"""Point-forward steering: a goal in, a twist out; nothing is planned."""

from __future__ import annotations

import math
from typing import Annotated

from msgspec import Meta

from agents.robot import Robot
from agents.tasks.goals import GoalParameters, Goals
from muro_zenoh.control.point_forward import GoToGoal
from muro_zenoh.geometry import STILL
from muro_zenoh.quantities import Positive


class SteerParameters(GoalParameters, frozen=True, kw_only=True):
    """Parameters of the behaviour ``steer``. A goal's heading is not looked at.

    Attributes:
        speed: greatest speed [m/s].
        ahead: how far ahead of the axle the steered point is [m].
        slope: speed per distance to go near the goal [1/s].
        tolerance: arrived within this distance [m].
        reverse_from: reversing is forbidden beyond this angle from the goal [rad]: pi/2 forbids it, pi allows it.
    """

    speed: Positive = 0.2
    ahead: Positive = 0.15
    slope: Positive = 1.0
    tolerance: Positive = 0.02
    reverse_from: Annotated[float, Meta(ge=1.57, le=3.1416)] = math.pi / 2


async def steer(robot: Robot) -> None:
    """Await the newest estimate, steer the point ahead of the axle to the goal."""
    p = robot.parameters_as(SteerParameters)
    law = GoToGoal(p.speed, p.ahead, p.slope, p.tolerance, p.reverse_from)
    goals = Goals(robot, p)
    try:
        async for estimate in robot.estimates():
            if goals.look():
                goals.set_out()  # it can go to any place inside: nothing is planned
            if goals.current is None:
                robot.hold(goals.waiting)
                continue
            pose = robot.ahead() or estimate.pose
            twist = law.twist(pose, goals.current.x, goals.current.y)
            if twist == STILL:
                goals.arrived()
                robot.hold(goals.waiting)
            else:
                robot.drive(*twist)
    finally:
        goals.close()
