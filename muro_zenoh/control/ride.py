"""A ride to one goal: plan a Dubins path inside the arena, clear of its walls, and follow it; first turn on the spot if
necessary.

The behaviours ``dubins`` and ``coverage`` call it at each estimate, in agent and rollout.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

from muro_zenoh.control.path_tracking import Progress, TrackingGains, follow_path
from muro_zenoh.control.speed_profile import SpeedProfile
from muro_zenoh.errors import PlanningError
from muro_zenoh.geometry import STILL, Bounds, Pose2, Twist2, wrap_to_pi
from muro_zenoh.planning.arena import plan_after_turn, plan_inside
from muro_zenoh.planning.destination import Destination, goal_pose
from muro_zenoh.planning.path import Path
from muro_zenoh.walls import Wall

TIGHTER: Final = (1.0, 0.7, 0.5)
"""Turning radii to try, as fractions of the configured one, until the path is inside the arena."""

FACING: Final = 0.05
"""A robot faces a heading within this tolerance [rad]."""

_TURN_GAIN: Final = 2.0
_SLOWEST_TURN: Final = 0.15
_FASTEST_TURN: Final = 1.0
"""Turning on the spot: rate per remaining angle [1/s], and minimum and maximum rate [rad/s]."""


@dataclass(frozen=True, slots=True)
class RideSettings:
    """How to ride.

    Args:
        profile: the speed along paths.
        gains: gains of the path tracking.
        radius: the turning radius [m]; reduced by up to half where the arena requires it.
        bounds: the arena.
        margin: distance that the robot's centre keeps from the walls [m].
        replan_beyond: a new path is planned when the robot is further than this from the path [m].
        arrive_within: a new path is planned when the robot ends a path further than this from the goal [m].
        arrive_facing: the same for the goal's heading, if it has one [rad].
        walls: the walls inside the arena.
    """

    profile: SpeedProfile
    gains: TrackingGains
    radius: float
    bounds: Bounds
    margin: float = 0.0
    replan_beyond: float = 0.15
    arrive_within: float = 0.03
    arrive_facing: float = 0.12
    walls: tuple[Wall, ...] = ()


class Ride(NamedTuple):
    """The state of a ride; passed in and returned.

    Args:
        path: the planned path; its first heading is the one to turn to.
        goal: its goal.
        turning: whether the robot is still turning on the spot.
        progress: progress along the path.
    """

    path: Path
    goal: Destination
    turning: bool
    progress: Progress


class Move(NamedTuple):
    """One step of a ride.

    Args:
        twist: the desired twist.
        ride: the state for the next step.
        state: ``on`` the path; ``arrived``; ``off`` the path, or at its end but not at the goal: plan again.
    """

    twist: Twist2
    ride: Ride
    state: Literal["on", "arrived", "off"]


def is_at(pose: Pose2, goal: Destination, tolerance: float, facing: float = FACING) -> bool:
    """Whether a robot is at a goal already, with the goal's heading if it has one.

    Args:
        pose: the robot's pose [world].
        goal: the goal.
        tolerance: maximum distance [m].
        facing: maximum error of the heading [rad].
    """
    if math.hypot(pose.x - goal.x, pose.y - goal.y) > tolerance:
        return False
    return goal.theta is None or abs(wrap_to_pi(pose.theta - goal.theta)) <= facing


def set_out(pose: Pose2, goal: Destination, v: float, settings: RideSettings) -> Ride:
    """Plan the shortest path that stays inside the arena.

    It uses the turning radius or, where that is impossible, a tighter one; where no radius works, it first turns on the
    spot by the smallest sufficient angle. A goal without a heading gets that of
    :func:`muro_zenoh.planning.destination.goal_heading`.

    Args:
        pose: the robot's pose [world].
        goal: the goal.
        v: the previous speed command [m/s]; the ride continues from it unless the robot must turn on the spot.
        settings: how to ride.

    Raises:
        PlanningError: no path with any radius or turn; the message is that of the configured radius without a turn.
    """
    target = goal_pose(pose, goal.x, goal.y, goal.theta)
    refused: PlanningError | None = None
    for plan in (plan_inside, plan_after_turn):
        for fraction in TIGHTER:
            try:
                radius = fraction * settings.radius
                path = plan(pose, target, radius, settings.bounds, settings.margin, settings.walls)
            except PlanningError as error:
                refused = refused or error
                continue
            turning = turn_on_the_spot(path, pose) != 0.0
            return Ride(path, goal, turning, Progress(0.0, 0.0 if turning else v))
    assert refused is not None
    raise refused


def turn_on_the_spot(path: Path, pose: Pose2) -> float:
    """The turning rate towards the first heading of a path [rad/s]; 0 once the robot faces it.

    Args:
        path: the path.
        pose: the robot's pose [world].
    """
    error = wrap_to_pi(path.start.theta - pose.theta)
    if abs(error) <= FACING:
        return 0.0
    return math.copysign(min(max(_TURN_GAIN * abs(error), _SLOWEST_TURN), _FASTEST_TURN), error)


def ride_on(ride: Ride, pose: Pose2, dt: float, settings: RideSettings) -> Move:
    """One step: turn on the spot until the first heading is reached, then follow the path.

    Args:
        ride: from :func:`set_out` or the previous step.
        pose: the robot's predicted pose when the twist takes effect [world].
        dt: time since the previous step [s].
        settings: how to ride.
    """
    if ride.turning:
        rate = turn_on_the_spot(ride.path, pose)
        return Move(Twist2(0.0, rate), ride._replace(turning=rate != 0.0), "on")
    step = follow_path(ride.path, pose, ride.progress, dt, settings.gains, settings.profile)
    on = ride._replace(progress=step.progress)
    if step.arrived:
        # A robot that had to keep clear of another may have come there from another side.
        there = is_at(pose, ride.goal, settings.arrive_within, settings.arrive_facing)
        return Move(STILL, on, "arrived" if there else "off")
    if abs(step.error.lateral) > settings.replan_beyond:
        return Move(step.twist, on, "off")
    return Move(step.twist, on, "on")
