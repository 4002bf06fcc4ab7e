"""A ride to one goal: plan a Dubins path inside the arena, turn on the spot if there is no other way, follow the path.

What the behaviours ``dubins`` and ``coverage`` do at each estimate, without robot or bus: agent and rollout call it.
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

TIGHTER: Final = (1.0, 0.7, 0.5)
"""Turning radii tried, as fractions of the one set, until the path keeps inside the arena."""

FACING: Final = 0.05
"""A robot faces a heading when it is so near it [rad]."""

_TURN_GAIN: Final = 2.0
_SLOWEST_TURN: Final = 0.15
_FASTEST_TURN: Final = 1.0
"""Turning on the spot: rate per angle to go [1/s], and the least and the greatest rate [rad/s]."""


@dataclass(frozen=True, slots=True)
class RideSettings:
    """How to ride.

    Args:
        profile: the speed along paths.
        gains: of the path tracking.
        radius: the turning radius [m]; a tighter one, down to half, is taken where the arena asks for it.
        bounds: the arena.
        margin: distance that the robot's middle keeps from the walls [m].
        replan_beyond: so far off the path, a new one is planned [m].
        arrive_within: who comes to the end of a path further than this from the goal plans anew [m].
    """

    profile: SpeedProfile
    gains: TrackingGains
    radius: float
    bounds: Bounds
    margin: float = 0.0
    replan_beyond: float = 0.15
    arrive_within: float = 0.03


class Ride(NamedTuple):
    """The memory of a ride: value in, value out.

    Args:
        path: the path planned; it starts in the heading to turn to first.
        goal: where it leads.
        turning: whether the robot still turns on the spot.
        progress: along the path.
    """

    path: Path
    goal: Destination
    turning: bool
    progress: Progress


class Move(NamedTuple):
    """One step of a ride.

    Args:
        twist: what to drive.
        ride: to hand in next time.
        state: ``on`` the way; ``arrived``; ``off`` the path, or at its end and not at the goal: plan anew.
    """

    twist: Twist2
    ride: Ride
    state: Literal["on", "arrived", "off"]


def is_at(pose: Pose2, goal: Destination, tolerance: float) -> bool:
    """Whether a robot need not ride: it is there, in the heading asked for if one is.

    Args:
        pose: where the robot is [world].
        goal: where it shall go.
        tolerance: how near is there [m].
    """
    if math.hypot(pose.x - goal.x, pose.y - goal.y) > tolerance:
        return False
    return goal.theta is None or abs(wrap_to_pi(pose.theta - goal.theta)) <= FACING


def set_out(pose: Pose2, goal: Destination, v: float, settings: RideSettings) -> Ride:
    """Plan the shortest path that keeps inside the arena.

    At the turning radius or, where that cannot be, a tighter one; where no radius will do, after the least turn on the
    spot. A goal without a heading gets that of :func:`muro_zenoh.planning.destination.goal_heading`.

    Args:
        pose: where the robot is [world].
        goal: where it shall go.
        v: the speed asked for last [m/s]; it goes on from there, unless it must turn on the spot.
        settings: how to ride.

    Raises:
        PlanningError: no radius and no turn will do; the message is that of the radius set, without a turn.
    """
    target = goal_pose(pose, goal.x, goal.y, goal.theta)
    refused: PlanningError | None = None
    for plan in (plan_inside, plan_after_turn):
        for fraction in TIGHTER:
            try:
                path = plan(pose, target, fraction * settings.radius, settings.bounds, settings.margin)
            except PlanningError as error:
                refused = refused or error
                continue
            turning = turn_on_the_spot(path, pose) != 0.0
            return Ride(path, goal, turning, Progress(0.0, 0.0 if turning else v))
    assert refused is not None
    raise refused


def turn_on_the_spot(path: Path, pose: Pose2) -> float:
    """How fast to turn to face along a path's start [rad/s]; 0 when the robot faces there.

    Args:
        path: the path.
        pose: where the robot is [world].
    """
    error = wrap_to_pi(path.start.theta - pose.theta)
    if abs(error) <= FACING:
        return 0.0
    return math.copysign(min(max(_TURN_GAIN * abs(error), _SLOWEST_TURN), _FASTEST_TURN), error)


def ride_on(ride: Ride, pose: Pose2, dt: float, settings: RideSettings) -> Move:
    """One step: turn on the spot while that is to be done, then follow the path.

    Args:
        ride: what :func:`set_out` or the last step returned.
        pose: where the robot will be when the twist is felt at the wheels [world].
        dt: time since the last step [s].
        settings: how to ride.
    """
    if ride.turning:
        rate = turn_on_the_spot(ride.path, pose)
        return Move(Twist2(0.0, rate), ride._replace(turning=rate != 0.0), "on")
    step = follow_path(ride.path, pose, ride.progress, dt, settings.gains, settings.profile)
    on = ride._replace(progress=step.progress)
    if step.arrived:
        near = math.hypot(pose.x - ride.goal.x, pose.y - ride.goal.y) <= settings.arrive_within
        return Move(STILL, on, "arrived" if near else "off")
    if abs(step.error.lateral) > settings.replan_beyond:
        return Move(step.twist, on, "off")
    return Move(step.twist, on, "on")
