"""Dubins: a goal in, a planned path out, and a car-like ride along it."""

from __future__ import annotations

import math

from agents.robot import Robot
from agents.tasks.goals import GoalParameters, Goals
from muro_zenoh.config.sections import Positive
from muro_zenoh.control.path_tracking import Progress, TrackingGains, follow_path
from muro_zenoh.control.speed_profile import SpeedProfile
from muro_zenoh.errors import PlanningError
from muro_zenoh.geometry import Pose2, wrap_to_pi
from muro_zenoh.messages import Goal
from muro_zenoh.planning.arena import plan_after_turn, plan_inside
from muro_zenoh.planning.bounds import Bounds
from muro_zenoh.planning.goal_heading import goal_pose
from muro_zenoh.planning.path import Path

_WHEEL_LAG = 0.1
"""The law is evaluated where the robot will be when its wheels obey [s]."""

_TIGHTER = (1.0, 0.7, 0.5)
"""Turning radii tried, as fractions of the one set, until the path keeps inside the arena."""

_ARRIVED = 0.03
"""Who comes to the end of a path further than this from the goal plans anew [m]."""

_FACING = 0.05
"""A robot faces a heading when it is so near it [rad]."""

_TURN_GAIN = 2.0
_SLOWEST_TURN, _FASTEST_TURN = 0.15, 1.0
"""Turning on the spot: rate per angle to go [1/s], and the least and the greatest rate [rad/s]."""


class DubinsParameters(GoalParameters, frozen=True, kw_only=True):
    """Parameters of the behaviour ``dubins``.

    Attributes:
        turning_radius: of the arcs [m]; a tighter one, down to half, is taken where the arena asks for it.
        v_min: speed on arcs [m/s].
        v_max: greatest speed on straights [m/s].
        acceleration: on straights [m/s^2].
        deceleration: before arcs and the goal [m/s^2].
        tolerance: arrived with this way to go [m].
        replan_beyond: so far off the path, a new one is planned [m].
        ka: lateral gain of the Frenet law [1/m^2].
        zeta: damping of the Frenet law [-].
    """

    turning_radius: Positive = 0.3
    v_min: Positive = 0.1
    v_max: Positive = 0.3
    acceleration: Positive = 0.2
    deceleration: Positive = 0.3
    tolerance: Positive = 0.01
    replan_beyond: Positive = 0.15
    ka: Positive = 30.0
    zeta: Positive = 0.9

    def profile(self, omega_max: float) -> SpeedProfile:
        """The speed profile for a robot that turns at ``omega_max`` [rad/s] at most."""
        return SpeedProfile(
            v_min=self.v_min,
            v_max=self.v_max,
            acceleration=self.acceleration,
            deceleration=self.deceleration,
            tolerance=self.tolerance,
            omega_max=omega_max,
        )


async def dubins(robot: Robot) -> None:
    """Drive to each goal along a Dubins curve; wait for the next."""
    await drive_to_goals(robot, robot.parameters_as(DubinsParameters))


async def drive_to_goals(robot: Robot, parameters: DubinsParameters, idle: str = "") -> None:
    """Await the newest estimate, plan when there is something new to plan, follow the path.

    Args:
        robot: the robot.
        parameters: goals, limits and gains.
        idle: what to say while there is no goal.
    """
    # Some of the turning is left for coming back to the path.
    profile = parameters.profile(0.8 * robot.settings.omega_max)
    gains = TrackingGains(parameters.ka, parameters.zeta)
    margin = robot.settings.radius
    goals = Goals(robot, parameters, idle)
    path: Path | None = None
    turn = False
    progress = Progress()
    before = robot.now
    try:
        async for estimate in robot.estimates():
            now = robot.now
            dt, before = now - before, now
            if not robot.may_drive:
                progress = Progress(progress.s, 0.0)  # the ride begins anew from standing
            if goals.look():
                path = None
            if goals.current is None:
                robot.hold(goals.waiting)
                continue
            if path is None:
                goal = goals.current
                if is_at(estimate.pose, goal, parameters.tolerance):
                    goals.arrived()
                    robot.hold(goals.waiting)
                    continue
                try:
                    path = plan_to(estimate.pose, goal, parameters.turning_radius, robot.arena, margin)
                except PlanningError as error:
                    goals.give_up(str(error))
                    continue
                goals.set_out()
                turn = turn_left(path, estimate.pose) != 0.0
                progress = Progress(0.0, 0.0 if turn else progress.v)
                robot.show_path(path, goal.theta is not None)
            pose = robot.ahead(_WHEEL_LAG) or estimate.pose
            if turn:
                rate = turn_left(path, pose)
                turn = rate != 0.0
                robot.drive(0.0, rate)
                continue
            step = follow_path(path, pose, progress, dt, gains, profile)
            progress = step.progress
            if step.arrived:
                path, progress = None, Progress()
                if math.hypot(pose.x - goals.current.x, pose.y - goals.current.y) <= _ARRIVED:
                    goals.arrived()
                robot.hold(goals.waiting)
            elif abs(step.error.lateral) > parameters.replan_beyond:
                path = None
            else:
                robot.drive(*step.twist)
    finally:
        goals.close()


def is_at(pose: Pose2, goal: Goal, tolerance: float) -> bool:
    """Whether a robot need not drive to a goal: it is there, in the heading asked for if one is.

    Args:
        pose: where the robot is.
        goal: where it shall go.
        tolerance: how near is there [m].
    """
    if math.hypot(pose.x - goal.x, pose.y - goal.y) > tolerance:
        return False
    return goal.theta is None or abs(wrap_to_pi(pose.theta - goal.theta)) <= _FACING


def turn_left(path: Path, pose: Pose2) -> float:
    """How fast to turn on the spot to face along a path's start [rad/s]; 0 when the robot faces there.

    Args:
        path: the path.
        pose: where the robot is.
    """
    error = wrap_to_pi(path.start.theta - pose.theta)
    if abs(error) <= _FACING:
        return 0.0
    return math.copysign(min(max(_TURN_GAIN * abs(error), _SLOWEST_TURN), _FASTEST_TURN), error)


def plan_to(pose: Pose2, goal: Goal, radius: float, bounds: Bounds, margin: float) -> Path:
    """The shortest path that keeps inside the arena.

    At the turning radius or, where that cannot be, a tighter one; where no radius will do, after the least turn on the
    spot, and then the path starts in the heading to turn to.

    Args:
        pose: where the robot is.
        goal: where it shall go.
        radius: the turning radius [m].
        bounds: the arena.
        margin: distance to keep from the walls [m].

    Raises:
        PlanningError: no radius and no turn will do; the message is that of the radius set, without a turn.
    """
    target = goal_pose(pose, goal.x, goal.y, goal.theta)
    refused: PlanningError | None = None
    for plan in (plan_inside, plan_after_turn):
        for fraction in _TIGHTER:
            try:
                return plan(pose, target, fraction * radius, bounds, margin)
            except PlanningError as error:
                refused = refused or error
    assert refused is not None
    raise refused
