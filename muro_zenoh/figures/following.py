"""Figures of circular path following: seed 000, figures 1 to 4, and settling times of the laws."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from muro_zenoh.control.circle import CIRCLE_LAWS, CircleLaw, circle_law
from muro_zenoh.elementwise import Array
from muro_zenoh.figures.canvas import (
    AMBER,
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PAGE,
    PURPLE,
    SKY,
    arrow,
    distribution,
    log_ticks,
    part_label,
    plan_view,
    sheet,
)
from muro_zenoh.figures.simulation import Effort, Track, drive
from muro_zenoh.geometry import Circle, Pose2, State
from muro_zenoh.simulation.rollout.fleet import Fleet, Policy
from muro_zenoh.simulation.rollout.runs import follow_circle, settling_time
from muro_zenoh.simulation.rollout.settings import CLEAN, NOISY, LoopSettings
from muro_zenoh.simulation.rollout.yardstick import shortest_tangent_path

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

V: Final = 0.15
OMEGA_MAX: Final = 1.0
BAND: Final = 0.03
CIRCLE: Final = Circle(0.0, 0.0, 0.6)
START: Final = np.array([[1.25, -0.55, 0.6]])

GAIN_LOW, GAIN_GOOD, GAIN_HIGH = 0.1, 0.8, 5.0

LAW_LOOKS: Final = {
    "vector_field": ("vector field (default)", BLUE, "-"),
    "passivity": ("passivity (seed 000)", ORANGE, (0, (5, 1.5))),
    "lqr": ("optimal gain (LQR)", GREEN, (0, (3, 1, 1, 1))),
}


def gain_too_low(effort: Effort) -> Figure:
    """Seed 000, figure 1: the passivity law overshoots forever.

    Args:
        effort: how much is simulated.
    """
    return _gain(GAIN_LOW, "too low", ORANGE, effort)


def gain_good(effort: Effort) -> Figure:
    """Seed 000, figure 2: the passivity law at its best gain.

    Args:
        effort: how much is simulated.
    """
    return _gain(GAIN_GOOD, "good", BLUE, effort)


def gain_too_high(effort: Effort) -> Figure:
    """Seed 000, figure 3: the passivity law creeps.

    Args:
        effort: how much is simulated.
    """
    return _gain(GAIN_HIGH, "too high", PURPLE, effort)


def _gain(psi: float, verdict: str, color: str, effort: Effort) -> Figure:
    track = drive(_fleet(CLEAN), _policy(circle_law("passivity", psi=psi)), effort.seconds(90.0))
    figure, (plan, error) = sheet(2.9, 4.1, 2, 1, height_ratios=(3.0, 1.0))
    plan.set_title(f"gain {verdict}: ψ = {psi:g} /(m² s)")
    plan_view(plan, CIRCLE)
    plan.plot(track.pose[:, 0, 0], track.pose[:, 0, 1], color=color)
    _draw_start(plan)
    plan.set_xlim(-1.4, 1.7)
    plan.set_ylim(-1.3, 1.45)
    error.axhspan(-BAND, BAND, color=SKY, alpha=0.35, linewidth=0)
    error.plot(track.time, track.radius_error(CIRCLE)[:, 0], color=color)
    error.set_xlim(0.0, 90.0)
    error.set_ylim(-0.65, 1.0)
    error.set_xlabel("time [s]")
    error.set_ylabel("ρ − r [m]")
    return figure


def noisy_trajectory(effort: Effort) -> Figure:
    """Seed 000, figure 4: with noisy delayed fixes, lagging wheels and drive errors, as in the lab.

    Args:
        effort: how much is simulated.
    """
    figure, (plan, error, scales) = sheet(PAGE, 2.7, 1, 3, width_ratios=(1.1, 1.0, 1.0))
    plan_view(plan, CIRCLE)
    zoom = error.inset_axes((0.55, 0.5, 0.44, 0.45))
    for name in ("passivity", "vector_field"):
        label, color, dashes = LAW_LOOKS[name]
        noted = _note(name, effort.seconds(60.0))
        x, y = noted.track.pose[:, 0, :2].T
        plan.plot(x, y, color=color, linestyle=dashes, label=label)
        radius_error = 1e3 * noted.track.radius_error(CIRCLE)[:, 0]
        error.plot(noted.track.time, radius_error, color=color, linestyle=dashes)
    zoom.plot(noted.track.time, radius_error, color=color, linestyle=dashes)
    zoom.plot(noted.fix_time, 1e3 * noted.fix_error, ".", color=BLACK, markersize=1.5, zorder=1.8)
    plan.plot([], [], ".", color=BLACK, markersize=3, label="camera's fixes, in the inset")
    scales.plot(noted.time, noted.scale_error[:, 0], color=BLUE, label="forward, $s_v$")
    scales.plot(noted.time, noted.scale_error[:, 1], color=AMBER, linestyle=(0, (5, 1.5)), label="turning, $s_ω$")
    _draw_start(plan)
    figure.legend(*plan.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    error.axhspan(-1e3 * BAND, 1e3 * BAND, color=SKY, alpha=0.35, linewidth=0)
    error.set_xlim(0.0, 60.0)
    error.set_ylim(-150.0, 900.0)
    zoom.set_xlim(40.0, 45.0)
    zoom.set_ylim(-8.0, 8.0)
    zoom.tick_params(labelsize=6)
    error.set_xlabel("time [s]")
    error.set_ylabel("radius error ρ − r [mm]")
    scales.axhspan(-5.0, 5.0, color=SKY, alpha=0.35, linewidth=0)
    scales.set_xlim(0.0, 10.0)
    scales.set_xlabel("time [s]")
    scales.set_ylabel("error of the drive scale found [%]")
    scales.legend(loc="lower right")
    for letter, axes in zip("abc", (plan, error, scales), strict=True):
        part_label(axes, letter)
    return figure


class _Noted(NamedTuple):
    """A robot in the noisy loop: its path, what the camera measured and what the filter estimated."""

    track: Track
    fix_time: Array
    fix_error: Array
    time: Array
    scale_error: Array


def _note(law: str, seconds: float) -> _Noted:
    """``fix_error`` is the radius error [m] of the fixes; ``scale_error`` (T, 2) that of the drive scales [%]."""
    fleet, policy = _fleet(NOISY), _policy(circle_law(law))
    rows: list[tuple[float, float, float, float, float]] = []

    def noting(t: float, ahead: State) -> tuple[Array, Array]:
        fix, found, plant = fleet.newest_fix, fleet.filter, fleet.plant
        assert fix is not None  # the loop has cameras
        assert found is not None
        error = float(np.hypot(fix.x[0] - CIRCLE.x, fix.y[0] - CIRCLE.y)) - CIRCLE.radius
        s_v, s_omega = found.mean.s_v[0] / plant.s_v[0], found.mean.s_omega[0] / plant.s_omega[0]
        rows.append((t, t - fleet.fix_age, error, 100.0 * (s_v - 1.0), 100.0 * (s_omega - 1.0)))
        return policy(t, ahead)

    track = drive(fleet, noting, seconds)
    time, fix_time, error, s_v, s_omega = np.array(rows).T
    return _Noted(track, fix_time, error, time, np.column_stack((s_v, s_omega)))


def settling(effort: Effort) -> Figure:
    """Settling times of the circle laws relative to the shortest Dubins path: distributions over random starts.

    Args:
        effort: how much is simulated.
    """
    rng = np.random.default_rng(1)
    starts = rng.uniform((-2.1, -1.5, -math.pi), (2.1, 1.5, math.pi), (effort.starts, 3))
    reference = shortest_tangent_path(starts, CIRCLE, V, OMEGA_MAX, BAND, tangents=360)
    counted = reference.enters >= 1.0
    figure, parts = sheet(PAGE, 2.6, 1, 3, sharey=True, width_ratios=(1.3, 1.0, 1.0))
    everything, clean, noisy = parts
    for axes in parts:
        axes.axvline(1.0, color=GREY, linewidth=0.9)
    for name in CIRCLE_LAWS:
        label, color, dashes = LAW_LOOKS[name]
        quick = name != "passivity"  # which does not come near 1 in either loop
        loops = ((NOISY, (everything, noisy)), (CLEAN, (clean,))) if quick else ((NOISY, (everything,)),)
        for settings, shown in loops:
            seconds = effort.seconds(45.0 if quick else 120.0)
            run = follow_circle(starts, CIRCLE, circle_law(name), V, settings, np.random.default_rng(2), seconds)
            settled = settling_time(run.time, abs(run.radius_error) > BAND)
            for axes in shown:
                distribution(axes, settled[counted] / reference.enters[counted], label, color, dashes)
    everything.set_xscale("log")
    everything.set_xlim(0.7, 20.0)
    log_ticks(everything.xaxis, (1.0, 2.0, 5.0, 10.0, 20.0))
    everything.set_ylim(0.0, 1.0)
    everything.set_ylabel("share of the starts settled [-]")
    for axes in (clean, noisy):
        axes.set_xlim(0.98, 1.3)
    for axes, letter, title in zip(
        parts, "abc", ("noisy loop", "clean loop, near 1", "noisy loop, near 1"), strict=True
    ):
        part_label(axes, letter, title)
    figure.supxlabel("time to the 3 cm band for good / the same of the shortest Dubins path [-]", fontsize=8.0)
    figure.legend(*everything.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def _draw_start(plan: Axes) -> None:
    plan.plot(*START[0, :2], "o", color=BLACK, markersize=4, zorder=5)
    arrow(plan, Pose2(*map(float, START[0])), 0.25, BLACK)


def _fleet(settings: LoopSettings) -> Fleet:
    return Fleet(START, settings, np.random.default_rng(4))


def _policy(law: CircleLaw) -> Policy:
    speed = np.full(1, V)
    return lambda t, ahead: (speed, law(ahead.x, ahead.y, ahead.theta, ahead.v, CIRCLE))
