"""Figures of cyclic pursuit: seed 000, figures 5 to 7, settling times of the laws, and importance."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from muro_zenoh.control.circle import circle_law
from muro_zenoh.control.importance import Importance
from muro_zenoh.control.pursuit import PursuitLaw, pursuit_law, pursuit_speed
from muro_zenoh.control.ring_arrays import array_gaps
from muro_zenoh.elementwise import Array
from muro_zenoh.figures.canvas import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PAGE,
    distribution,
    log_ticks,
    part_label,
    plan_view,
    sheet,
)
from muro_zenoh.figures.simulation import Effort, drive
from muro_zenoh.geometry import TWO_PI, Circle, State
from muro_zenoh.simulation.rollout.fleet import Fleet
from muro_zenoh.simulation.rollout.runs import pursue_ring, ring_angle, settling_time
from muro_zenoh.simulation.rollout.settings import CLEAN, NOISY
from muro_zenoh.simulation.rollout.yardstick import equal_spacing_bound

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CIRCLE: Final = Circle(0.0, 0.0, 1.1)
ROBOTS: Final = 10
BUNCH: Final = math.radians(60.0)
V_MIN: Final = 0.05
CRUISE: Final = 0.2
V_MAX: Final = 0.4
BAND: Final = 0.1

STEP_GAIN: Final = 0.5
"""k of the seed's discrete pursuit: the gain in (0, 1) that spreads a ring fastest."""

BINS: Final = 36

LAW_LOOKS: Final = {
    "two_gap": ("both gaps (default)", BLUE, "-"),
    "normalised": ("normalised", GREEN, (0, (3, 1, 1, 1))),
    "proportional": ("proportional (seed 000)", ORANGE, (0, (5, 1.5))),
}


def steps_0(effort: Effort) -> Figure:
    """Seed 000, figure 5: ten robots bunched together.

    Args:
        effort: not used: a few steps are quickly made.
    """
    return _ring_after(0)


def steps_10(effort: Effort) -> Figure:
    """Seed 000, figure 6: the same after ten steps of the seed's pursuit; the first robot has moved ahead.

    Args:
        effort: not used: a few steps are quickly made.
    """
    return _ring_after(10)


def steps_100(effort: Effort) -> Figure:
    """Seed 000, figure 7: after a hundred steps they are evenly spread.

    Args:
        effort: not used: a few steps are quickly made.
    """
    return _ring_after(100)


def _ring_after(steps: int) -> Figure:
    """``theta_i(t + 1) = theta_i(t) + k gap_i(t)``: the proportional law, one second per step."""
    law = pursuit_law("proportional", cruise=1.0, gain=STEP_GAIN, v_min=0.0, v_max=100.0)
    angle = np.linspace(0.0, BUNCH, ROBOTS)
    for _ in range(steps):
        angle = angle + _speed(law, angle) / CIRCLE.radius
    gap, _, _ = array_gaps(angle, CIRCLE.clockwise)
    figure, (plan, bars) = sheet(2.9, 4.0, 2, 1, height_ratios=(3.0, 1.0))
    plan.set_title(f"after {steps} steps" if steps else "at the start")
    plan_view(plan, CIRCLE)
    number = np.arange(1, ROBOTS + 1)
    for k in range(ROBOTS):
        outwards = np.array((math.cos(angle[k]), math.sin(angle[k])))
        plan.plot(
            *(CIRCLE.radius * outwards), "o", color=BLUE, markersize=7, markeredgecolor="white", markeredgewidth=0.6
        )
        plan.text(*(1.2 * CIRCLE.radius * outwards), f"{number[k]}", ha="center", va="center", fontsize=7, color=BLACK)
    plan.set_xlim(-1.55, 1.55)
    plan.set_ylim(-1.55, 1.55)
    bars.bar(number, gap, color=BLUE, width=0.7)
    bars.axhline(TWO_PI / ROBOTS, color=BLACK, linestyle=(0, (4, 3)), linewidth=0.9)
    bars.set_xticks(number)
    bars.set_ylim(0.0, 6.0)
    bars.set_xlabel("robot")
    bars.set_ylabel("gap ahead [rad]")
    bars.grid(visible=False, axis="x")
    return figure


def settling(effort: Effort) -> Figure:
    """Settling times of the pursuit laws for ten robots that start bunched, relative to the lower bound.

    Args:
        effort: how much is simulated.
    """
    angles = np.random.default_rng(1).uniform(0.0, BUNCH, (effort.trials, ROBOTS))
    x, y = CIRCLE.radius * np.cos(angles), CIRCLE.radius * np.sin(angles)
    starts = np.stack((x, y, angles + math.pi / 2.0), axis=-1)
    bound = equal_spacing_bound(angles, CIRCLE.clockwise, CIRCLE.radius, V_MIN, V_MAX, BAND)
    figure, (course, ratios) = sheet(PAGE, 2.6, 1, 2)
    for name, (label, color, dashes) in LAW_LOOKS.items():
        law = pursuit_law(name, cruise=CRUISE, v_min=V_MIN, v_max=V_MAX)
        for loop in (CLEAN, NOISY):
            # With hidden drive errors the wheels may have to turn 20 % faster than the robot drives.
            settings = replace(loop, v_max=1.5 * V_MAX)
            rng, seconds = np.random.default_rng(2), effort.seconds(60.0)
            run = pursue_ring(starts, CIRCLE, law, circle_law(), settings, rng, seconds)
            settled = settling_time(run.time, run.spacing_error > BAND)
            if loop is NOISY:
                thin = slice(None, None, 8)
                low, middle, high = np.quantile(run.spacing_error, (0.1, 0.5, 0.9), axis=1)
                course.fill_between(run.time[thin], low[thin], high[thin], color=color, alpha=0.2, linewidth=0)
                course.plot(run.time[thin], middle[thin], color=color, linestyle=dashes, label=label)
                distribution(ratios, settled / bound, label, color, dashes)
            else:
                distribution(ratios, settled / bound, "", color, dashes, alpha=0.45)
    least = float(np.median(bound))
    course.axvline(least, color=GREY, linewidth=0.9)
    course.text(least + 1.0, 4.2, "lower bound (median)", color=BLACK, fontsize=7)
    course.axhline(BAND, color=BLACK, linestyle=(0, (4, 3)), linewidth=0.9)
    course.set_xlim(0.0, 60.0)
    course.set_yscale("log")
    course.set_ylim(0.01, 7.0)
    log_ticks(course.yaxis, (0.01, 0.03, 0.1, 0.3, 1.0, 3.0))
    course.set_xlabel("time [s]")
    course.set_ylabel("spacing error [rad]")
    ratios.axvline(1.0, color=GREY, linewidth=0.9)
    ratios.set_xscale("log")
    ratios.set_xlim(0.8, 8.0)
    log_ticks(ratios.xaxis, (1.0, 2.0, 3.0, 5.0, 8.0))
    ratios.set_ylim(0.0, 1.0)
    ratios.set_xlabel("time to 0.1 rad / lower bound [-]")
    ratios.set_ylabel("share of the trials [-]")
    figure.legend(*course.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    part_label(course, "a", "noisy loop")
    part_label(ratios, "b", "noisy loop; faint: clean loop")
    return figure


def desired_density() -> Importance:
    """The desired importance of the figure: three times as much on one side as on the other."""
    return Importance.from_function(lambda angle: 2.0 + math.cos(angle - 1.0))


def importance(effort: Effort) -> Figure:
    """Where robots were, averaged over three minutes, beside the desired density.

    Args:
        effort: how much is simulated.
    """
    desired = desired_density()
    edges = np.linspace(0.0, TWO_PI, BINS + 1)
    share = np.diff(np.asarray(desired.mass(edges))) / (TWO_PI / BINS)
    figure, parts = sheet(PAGE, 2.2, 1, 3, sharey=True)
    sizes = (1, 3, 5)
    for axes, letter, robots, found in zip(parts, "abc", sizes, _densities(desired, sizes, effort), strict=True):
        off = 0.5 * float(abs(found - share).sum()) / BINS
        axes.bar(
            0.5 * (edges[1:] + edges[:-1]), found, width=0.9 * TWO_PI / BINS, color=BLUE, alpha=0.45, label="found"
        )
        axes.plot(edges, np.asarray(desired.density(edges)), color=ORANGE, label="desired")
        part_label(axes, letter, f"N = {robots}, total variation {100.0 * off:.1f} %")
        axes.set_xlim(0.0, TWO_PI)
        axes.set_xticks(np.linspace(0.0, TWO_PI, 5), ("0", "π/2", "π", "3π/2", "2π"))
        axes.set_xlabel("angle on the circle [rad]")
    parts[0].set_ylabel("density, mean 1 [-]")
    parts[0].set_ylim(0.0, 1.75)
    parts[0].legend(loc="upper right")
    return figure


def _densities(desired: Importance, sizes: tuple[int, ...], effort: Effort) -> list[Array]:
    """Density of rings of robots under importance-weighted pursuit over the bins of angles, mean 1, (BINS,) each."""
    law = pursuit_law("importance", cruise=CRUISE, v_min=V_MIN, v_max=V_MAX, importance=desired)
    follow = circle_law()
    angles = np.concatenate([np.linspace(0.0, BUNCH, robots) for robots in sizes])
    ends = np.cumsum(sizes)
    rings = [slice(end - robots, end) for end, robots in zip(ends, sizes, strict=True)]
    starts = np.column_stack((CIRCLE.radius * np.cos(angles), CIRCLE.radius * np.sin(angles), angles + math.pi / 2.0))
    fleet = Fleet(starts, replace(NOISY, v_max=1.5 * V_MAX), np.random.default_rng(3))

    def policy(t: float, ahead: State) -> tuple[Array, Array]:
        angle = ring_angle(fleet, ahead, CIRCLE)
        speed = np.concatenate([_speed(law, angle[ring]) for ring in rings])
        return speed, follow(ahead.x, ahead.y, ahead.theta, ahead.v, CIRCLE)

    settle = effort.seconds(60.0)
    track = drive(fleet, policy, settle + effort.seconds(180.0))
    x, y = track.pose[track.time > settle, :, 0], track.pose[track.time > settle, :, 1]
    seen_at = np.mod(np.arctan2(y - CIRCLE.y, x - CIRCLE.x), TWO_PI)
    counts = [np.histogram(seen_at[:, ring], bins=BINS, range=(0.0, TWO_PI))[0].astype(np.float64) for ring in rings]
    return [count / count.mean() for count in counts]


def _speed(law: PursuitLaw, angle: Array) -> Array:
    """The speeds of one ring (N,) [m/s]."""
    gap, behind, count = array_gaps(angle, CIRCLE.clockwise)
    speed: Array = pursuit_speed(law, gap, behind, count.astype(np.float64), angle, CIRCLE.radius, CIRCLE.clockwise)
    return speed
