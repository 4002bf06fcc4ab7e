"""Figure of point-forward steering: seed 001, the wheel speeds over the angle to turn."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from muro_zenoh.control.point_forward import REVERSE_LIMIT, steer_to_angle, turning_gain, wheel_speeds
from muro_zenoh.figures.canvas import BLACK, BLUE, GREY, ORANGE, PAGE, PALE, part_label, sheet
from muro_zenoh.figures.simulation import Effort

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WHEEL_BASE: Final = 0.23
AHEAD: Final = 0.115
WHEEL_RADIUS: Final = 0.035
SPEED: Final = WHEEL_RADIUS  # V / R = 1, and K = L / (2 l) = 1, as on the page


def wheel_speeds_over_alpha(effort: Effort) -> Figure:
    """Seed 001: wheel speeds over the angle to turn, with unlimited reversing and with the page's limit.

    Args:
        effort: not used: nothing is simulated.
    """
    assert math.isclose(turning_gain(WHEEL_BASE, AHEAD), 1.0)
    alpha = np.linspace(-math.pi, math.pi, 1441)[1:]
    figure, parts = sheet(PAGE, 2.4, 1, 2, sharey=True)
    limits = (("reversing allowed", math.pi), ("reversing allowed up to 3π/4", REVERSE_LIMIT))
    for axes, letter, (title, limit) in zip(parts, "ab", limits, strict=True):
        v, omega = steer_to_angle(np.zeros_like(alpha), alpha, np.full_like(alpha, SPEED), AHEAD, limit)
        wheels = wheel_speeds(v, omega, WHEEL_BASE, WHEEL_RADIUS)
        broken = np.append(abs(np.diff(v)) > 1e-3, False)  # draw a jump of the law as a gap

        def line(values: np.ndarray, broken: np.ndarray = broken) -> np.ndarray:
            return np.where(broken, np.nan, values)

        for low, high in ((-limit, -math.pi / 2.0), (math.pi / 2.0, limit)):
            axes.axvspan(low, high, color=PALE, linewidth=0)
        axes.plot(alpha, line(wheels.right), color=BLUE, label="right wheel")
        axes.plot(alpha, line(wheels.left), color=ORANGE, linestyle=(0, (5, 1.5)), label="left wheel")
        axes.plot(alpha, line(v) / WHEEL_RADIUS, color=GREY, linestyle=(0, (1, 1)), label="robot, v / R")
        axes.axhline(0.0, color=BLACK, linewidth=0.6)
        axes.set_xlim(-math.pi, math.pi)
        axes.set_xticks(
            np.linspace(-math.pi, math.pi, 9), ("−π", "−3π/4", "−π/2", "−π/4", "0", "π/4", "π/2", "3π/4", "π")
        )
        axes.set_xlabel("angle to turn α = φ − θ [rad]")
        part_label(axes, letter, title)
    parts[0].set_ylabel("wheel speed [rad/s]")
    figure.legend(*parts[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure
