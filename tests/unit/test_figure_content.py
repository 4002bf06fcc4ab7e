"""What figures show: their axes, the curves within view, and numbers that can be worked out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pytest

from muro_zenoh.figures.canvas import style
from muro_zenoh.figures.catalogue import FIGURES
from muro_zenoh.figures.simulation import Effort

pytest.importorskip("matplotlib", reason="matplotlib is not installed")

from matplotlib.axes import Axes
from matplotlib.figure import Figure

# As long as the published ones where curves hang on it, with few starts.
EFFORT = Effort(starts=4, trials=2, share=1.0)


class Part(NamedTuple):
    """One pair of axes: what is written along them, how far they reach, and what is drawn there.

    ``curves``: lines of more than two points, of which at least two can be seen. ``bars``: of a histogram.
    """

    x_label: str
    y_label: str
    x: tuple[float, float] | None = None
    y: tuple[float, float] | None = None
    curves: int = 0
    bars: int = 0


PLAN = Part("x [m]", "y [m]")
SHARE = "share of the starts settled [-]"

PARTS: dict[str, list[Part]] = {
    **{
        f"seed000_fig{k}": [
            PLAN._replace(curves=2),  # the circle, and the way of the robot
            Part("time [s]", "ρ − r [m]", (0.0, 90.0), (-0.65, 1.0), curves=1),
        ]
        for k in (1, 2, 3)
    },
    "seed000_fig4": [
        PLAN._replace(curves=3),
        Part("time [s]", "radius error ρ − r [mm]", (0.0, 60.0), curves=2),
        Part("time [s]", "error of the drive scale found [%]", (0.0, 10.0), curves=2),
        Part("", "", (40.0, 45.0), (-8.0, 8.0), curves=2),
    ],
    **{
        f"seed000_fig{k}": [PLAN._replace(curves=1), Part("robot", "gap ahead [rad]", None, (0.0, 6.0), bars=10)]
        for k in (5, 6, 7)
    },
    "seed000_fig8": [Part("", "")],
    "seed001_wheel_speeds": [
        Part("angle to turn α = φ − θ [rad]", "wheel speed [rad/s]", (-math.pi, math.pi), None, curves=3),
        Part("angle to turn α = φ − θ [rad]", "", (-math.pi, math.pi), None, curves=3),
    ],
    "seed004_dubins": [
        Part("", "speed [m/s]", None, (0.0, 0.36), curves=2),
        Part("distance along the path [m]", "offset [mm]", curves=1),
        PLAN._replace(x=(0.0, 4.2), y=(0.0, 3.0), curves=2),
    ],
    "circle_settling": [
        Part("", SHARE, (0.7, 20.0), (0.0, 1.0), curves=3),
        Part("", "", (0.98, 1.3), (0.0, 1.0), curves=2),
        Part("", "", (0.98, 1.3), (0.0, 1.0), curves=2),
    ],
    "pursuit_settling": [
        Part("time [s]", "spacing error [rad]", (0.0, 60.0), (0.01, 7.0), curves=3),
        Part("time to 0.1 rad / lower bound [-]", "share of the trials [-]", (0.8, 8.0), (0.0, 1.0), curves=6),
    ],
    "importance_density": [
        Part("angle on the circle [rad]", label, (0.0, 2 * math.pi), (0.0, 1.75), curves=1, bars=36)
        for label in ("density, mean 1 [-]", "", "")
    ],
    "coverage_cells": [
        PLAN._replace(x=(0.0, 4.2), y=(0.0, 3.0), curves=10),  # the cells
        PLAN._replace(x=(0.0, 4.2), y=(0.0, 3.0), curves=20),  # and the ways to their centroids
        Part("Lloyd step", "cost [m⁴]", (0.0, 60.0), (0.5, 12.0), curves=1),
    ],
}

_DRAWN: dict[str, Figure] = {}


def figure_of(name: str) -> Figure:
    """A figure, drawn once for all tests of it."""
    if name not in _DRAWN:
        with style():
            _DRAWN[name] = FIGURES[name].draw(EFFORT)
    return _DRAWN[name]


def axes_of(figure: Figure) -> list[Axes]:
    return [*figure.axes, *(inset for axes in figure.axes for inset in axes.child_axes)]


def curves(axes: Axes) -> Iterator[np.ndarray]:
    """The lines that can be seen as such (n, 2): two points within view, at two places."""
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    for line in axes.lines:
        if len(line.get_xdata()) <= 2 or (line.get_linestyle() == "None" and line.get_marker() != "."):
            continue
        x, y = np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)
        seen = (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)
        if len(set(zip(x[seen].tolist(), y[seen].tolist(), strict=True))) >= 2:
            yield np.column_stack((x, y))


def bars(axes: Axes) -> np.ndarray:
    return np.array([bar.get_height() for container in axes.containers for bar in container])


def test_every_figure_has_its_content_specified_here() -> None:
    assert PARTS.keys() == FIGURES.keys()


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_has_its_axes_and_its_curves(name: str) -> None:
    found = axes_of(figure_of(name))
    assert len(found) == len(PARTS[name])
    for axes, part in zip(found, PARTS[name], strict=True):
        assert (axes.get_xlabel(), axes.get_ylabel()) == part[:2]
        assert part.x is None or axes.get_xlim() == pytest.approx(part.x)
        assert part.y is None or axes.get_ylim() == pytest.approx(part.y)
        assert len(list(curves(axes))) == part.curves
        assert len(bars(axes)) == part.bars


@pytest.mark.parametrize(("name", "late"), [("seed000_fig1", (0.1, 1.0)), ("seed000_fig2", (0.0, 0.005))])
def test_the_passivity_law_overshoots_with_a_low_gain_and_comes_to_the_circle_with_a_good_one(
    name: str, late: tuple[float, float]
) -> None:
    plan, error = axes_of(figure_of(name))
    _, track = curves(plan)
    assert track[0] == pytest.approx((1.25, -0.55))
    (course,) = curves(error)
    assert course[:, 1] == pytest.approx(np.hypot(*track.T) - 0.6)
    assert late[0] <= abs(course[course[:, 0] > 60.0, 1]).max() <= late[1]


def test_with_a_gain_too_high_it_is_late_and_never_inside() -> None:
    (good,), (high,) = (curves(axes_of(figure_of(f"seed000_fig{k}"))[1]) for k in (2, 3))
    assert abs(good[good[:, 0] > 50.0, 1]).max() < 0.01
    assert high[high[:, 0] < 50.0, 1].min() > 0.05


def test_ten_robots_spread() -> None:
    gaps = [bars(axes_of(figure_of(f"seed000_fig{k}"))[1]) for k in (5, 6, 7)]
    for each in gaps:
        assert each.sum() == pytest.approx(2 * math.pi)
    worst = [abs(each - math.pi / 5).max() for each in gaps]
    assert worst[0] > 4.0 > worst[1] > 0.5 > 0.05 > worst[2]


def test_the_wheels_turn_as_the_formula_says() -> None:
    both, _ = axes_of(figure_of("seed001_wheel_speeds"))
    right, left, robot = curves(both)
    alpha = right[:, 0]
    assert right[:, 1] == pytest.approx(np.cos(alpha) + np.sin(alpha), nan_ok=True)
    assert left[:, 1] == pytest.approx(np.cos(alpha) - np.sin(alpha), nan_ok=True)
    assert robot[:, 1] == pytest.approx(np.cos(alpha), nan_ok=True)


def test_the_dubins_path_is_driven_from_end_to_end() -> None:
    speed, offset, plan = axes_of(figure_of("seed004_dubins"))
    path, driven = curves(plan)
    assert driven[0] == pytest.approx(path[0])
    assert driven[-1] == pytest.approx(path[-1], abs=0.03)
    asked, found = curves(speed)
    assert 0.2 < asked[:, 1].max() <= 0.3
    assert abs(asked[:, 1] - found[:, 1]).max() < 0.2
    (offsets,) = curves(offset)
    assert abs(offsets[:, 1]).max() < 30.0  # mm


@pytest.mark.parametrize("name", ["circle_settling", "pursuit_settling"])
def test_distributions_rise_to_one(name: str) -> None:
    for axes in axes_of(figure_of(name)):
        if "share" in axes.get_ylabel():
            for each in curves(axes):
                assert (np.diff(each, axis=0) >= 0.0).all()
                assert each[-1, 1] == 1.0


def test_the_default_pursuit_law_is_the_quickest_in_the_figure_and_none_beats_the_bound() -> None:
    _, ratios = axes_of(figure_of("pursuit_settling"))
    # of each law the noisy loop and the clean one; from where half of the trials have settled
    medians = [each[np.searchsorted(each[:, 1], 0.5), 0] for each in curves(ratios)]
    assert max(medians[:2]) < min(medians[2:])
    assert min(medians) >= 1.0


def test_the_density_of_robots_follows_the_importance() -> None:
    for axes in axes_of(figure_of("importance_density")):
        found = bars(axes)
        assert found.mean() == pytest.approx(1.0)
        (asked,) = curves(axes)
        assert asked[:, 1].max() / asked[:, 1].min() == pytest.approx(3.0, rel=0.02)
        assert 0.5 * abs(found - 0.5 * (asked[1:, 1] + asked[:-1, 1])).mean() < 0.15


def test_the_cost_of_coverage_decreases() -> None:
    *_, cost = axes_of(figure_of("coverage_cells"))
    (course,) = curves(cost)
    assert len(course) == 61
    assert (np.diff(course[:, 1]) <= 1e-9).all()
    assert course[-1, 1] < 0.3 * course[0, 1]


def test_the_flow_of_topics_names_every_end() -> None:
    (axes,) = axes_of(figure_of("seed000_fig8"))
    words = {text.get_text() for text in axes.texts}
    assert {"writers", "channels", "readers", "cmd_vel/<robot>", "all_positions", "agent/control", "base"} <= words
    arrows = [patch for patch in axes.patches if type(patch).__name__ == "FancyArrowPatch"]
    assert len(arrows) > 40
