"""Dubins: a goal in, a planned path out, and a car-like ride along it."""

from __future__ import annotations

from agents.robot import Robot
from agents.tasks.goals import GoalParameters, Goals
from muro_zenoh.config.sections import RobotSettings
from muro_zenoh.control.path_tracking import TrackingGains
from muro_zenoh.control.ride import Ride, RideSettings, is_at, ride_on, set_out
from muro_zenoh.control.speed_profile import SpeedProfile
from muro_zenoh.errors import PlanningError
from muro_zenoh.geometry import Bounds
from muro_zenoh.planning.destination import Destination
from muro_zenoh.quantities import Positive


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

    def ride(self, robot: RobotSettings, bounds: Bounds) -> RideSettings:
        """How a robot with these parameters rides.

        Args:
            robot: its section of the fleet file.
            bounds: the arena.
        """
        profile = SpeedProfile(
            v_min=self.v_min,
            v_max=self.v_max,
            acceleration=self.acceleration,
            deceleration=self.deceleration,
            tolerance=self.tolerance,
            omega_max=0.8 * robot.omega_max,  # some of the turning is left for coming back to the path
        )
        gains = TrackingGains(self.ka, self.zeta)
        return RideSettings(profile, gains, self.turning_radius, bounds, robot.radius, self.replan_beyond)


async def dubins(robot: Robot) -> None:
    """Drive to each goal along a Dubins curve; wait for the next."""
    await drive_to_goals(robot, robot.parameters_as(DubinsParameters))


async def drive_to_goals(robot: Robot, parameters: DubinsParameters, idle: str = "") -> None:
    """Await the newest estimate, plan when there is something new to plan, ride on.

    Args:
        robot: the robot.
        parameters: goals, limits and gains.
        idle: what to say while there is no goal.
    """
    settings = parameters.ride(robot.settings, robot.arena)
    goals = Goals(robot, parameters, idle)
    ride: Ride | None = None
    v = 0.0
    before = robot.now
    try:
        async for estimate in robot.estimates():
            now = robot.now
            dt, before = now - before, now
            if not robot.may_drive:
                v = 0.0  # the ride begins anew from standing
                ride = ride and ride._replace(progress=ride.progress._replace(v=0.0))
            if goals.look():
                ride = None
            goal = goals.current
            if goal is None:
                robot.hold(goals.waiting)
                continue
            if ride is None:
                destination = Destination(goal.x, goal.y, goal.theta)
                if is_at(estimate.pose, destination, parameters.tolerance):
                    goals.arrived()
                    robot.hold(goals.waiting)
                    continue
                try:
                    ride = set_out(estimate.pose, destination, v, settings)
                except PlanningError as error:
                    goals.give_up(str(error))
                    robot.hold(goals.waiting)
                    continue
                goals.set_out()
                robot.show_path(ride.path, goal.theta is not None)
            move = ride_on(ride, robot.ahead() or estimate.pose, dt, settings)
            ride, v = (move.ride if move.state == "on" else None), move.twist.v
            if move.state == "arrived":
                goals.arrived()
                robot.hold(goals.waiting)
            else:
                robot.drive(*move.twist)
    finally:
        goals.close()
