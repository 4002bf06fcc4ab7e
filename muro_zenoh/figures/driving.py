"""Figure of Dubins paths: seed 004, a path with its speeds and tracking error."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from muro_zenoh.control.path_tracking import Progress, TrackingGains, follow_path
from muro_zenoh.control.speed_profile import SpeedProfile
from muro_zenoh.elementwise import Array
from muro_zenoh.figures.canvas import BLACK, BLUE, GREY, ORANGE, PAGE, PALE, arrow, part_label, plan_view, sheet
from muro_zenoh.figures.simulation import Effort, drive
from muro_zenoh.geometry import Pose2, State
from muro_zenoh.planning.dubins import plan
from muro_zenoh.planning.path import STRAIGHT
from muro_zenoh.simulation.rollout.fleet import Fleet
from muro_zenoh.simulation.rollout.settings import NOISY

if TYPE_CHECKING:
    from matplotlib.figure import Figure

START: Final = Pose2(0.6, 0.5, 1.9)
GOAL: Final = Pose2(3.4, 2.3, -2.2)
TURNING_RADIUS: Final = 0.3
PROFILE: Final = SpeedProfile()
GAINS: Final = TrackingGains()


def dubins(effort: Effort) -> Figure:
    """Seed 004: a Dubins path driven in the noisy loop, its speeds and the robot's offset from it.

    Args:
        effort: how much is simulated.
    """
    path = plan(START, GOAL, TURNING_RADIUS)
    fleet = Fleet(np.array([START]), NOISY, np.random.default_rng(1))
    progress, along, desired, driven, offsets = Progress(), [], [], [], []

    def policy(t: float, ahead: State) -> tuple[Array, Array]:
        nonlocal progress
        pose = Pose2(*(float(value[0]) for value in (ahead.x, ahead.y, ahead.theta)))
        step = follow_path(path, pose, progress, NOISY.period, GAINS, PROFILE)
        progress = step.progress
        x, y = map(float, fleet.plant.pose[0, :2])
        along.append(path.project(x, y, step.error.s - 0.1, step.error.s + 0.1))
        desired.append(step.twist.v)
        driven.append(float(fleet.plant.twist[0, 0]))
        there = path.pose_at(along[-1])
        side = np.cos(there.theta) * (y - there.y) - np.sin(there.theta) * (x - there.x)
        offsets.append(float(side))
        return np.array([step.twist.v]), np.array([step.twist.omega])

    track = drive(fleet, policy, effort.seconds(30.0))
    figure, parts = sheet(PAGE, 2.9, 2, 2, width_ratios=(1.25, 1.0))
    (plan_axes, speed), (_, offset) = parts
    grid = plan_axes.get_gridspec()
    for axes in parts[:, 0]:
        axes.remove()
    plan_axes = figure.add_subplot(grid[:, 0])
    plan_view(plan_axes)
    poses = np.array([path.pose_at(s) for s in np.linspace(0.0, path.length, 400)])
    plan_axes.plot(poses[:, 0], poses[:, 1], color=GREY, linewidth=3.5, alpha=0.45, label="Dubins path")
    plan_axes.plot(track.pose[:, 0, 0], track.pose[:, 0, 1], color=BLUE, label="driven")
    for pose, name, color in ((START, "start", BLACK), (GOAL, "goal", ORANGE)):
        plan_axes.plot(pose.x, pose.y, "o", color=color, markersize=4, zorder=5, label=name)
        arrow(plan_axes, pose, 0.28, color)
    plan_axes.set_xlim(0.0, 4.2)
    plan_axes.set_ylim(0.0, 3.0)
    plan_axes.legend(loc="lower right")
    for axes in (speed, offset):
        for k, (_, curvature) in enumerate(path.segments):
            if abs(curvature) >= STRAIGHT:
                axes.axvspan(path.distances[k], path.distances[k + 1], color=PALE, linewidth=0)
        axes.set_xlim(0.0, path.length)
        axes.grid(visible=False)
    speed.plot(along, desired, color=ORANGE, linestyle=(0, (5, 1.5)), label="commanded")
    speed.plot(along, driven, color=BLUE, label="driven")
    for v in (PROFILE.v_min, PROFILE.v_max):
        speed.axhline(v, color=GREY, linestyle=(0, (1, 1)), linewidth=0.9)
    speed.set_ylim(0.0, 0.36)
    speed.set_ylabel("speed [m/s]")
    speed.tick_params(labelbottom=False)
    speed.legend(loc="center")
    offset.plot(along, 1e3 * np.array(offsets), color=BLUE)
    offset.axhline(0.0, color=BLACK, linewidth=0.6)
    offset.set_xlabel("distance along the path [m]")
    offset.set_ylabel("offset [mm]")
    for letter, axes in zip("abc", (plan_axes, speed, offset), strict=True):
        part_label(axes, letter)
    return figure
