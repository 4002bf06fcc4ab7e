"""Figure of coverage: cells before and after Lloyd's algorithm, and the cost at each step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from muro_zenoh.figures.canvas import BLACK, BLUE, ORANGE, PAGE, SKY, log_ticks, part_label, plan_view, sheet
from muro_zenoh.figures.simulation import Effort
from muro_zenoh.geometry import Bounds
from muro_zenoh.planning.coverage import Peaks, Point, cells, centroid, coverage_cost, lloyd_step

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ARENA: Final = Bounds(0.0, 4.2, 0.0, 3.0)
DENSITY: Final = Peaks(((3.0, 2.0, 0.6, 1.0), (1.2, 0.9, 0.35, 0.6)), floor=0.08)
ROBOTS: Final = 10
STEPS: Final = 60


def coverage_cells(effort: Effort) -> Figure:
    """Ten robots that start bunched in a corner: their first and last cells, and the cost at each step.

    Args:
        effort: how many steps are simulated.
    """
    places = np.random.default_rng(5).uniform((0.2, 1.9), (1.5, 2.8), (ROBOTS, 2))
    sites: list[Point] = [(float(x), float(y)) for x, y in places]
    places_by_step = [sites]
    for _ in range(max(2, round(STEPS * effort.share))):
        places_by_step.append(list(lloyd_step(places_by_step[-1], ARENA, DENSITY)))
    figure, (before, after, cost) = sheet(PAGE, 2.5, 1, 3, width_ratios=(1.0, 1.0, 0.75))
    _draw_cells(before, places_by_step[0])
    _draw_cells(after, places_by_step[-1])
    steps = np.array(places_by_step)
    for k in range(ROBOTS):
        after.plot(
            steps[:, k, 0], steps[:, k, 1], color=ORANGE, linewidth=0.7, zorder=3, label="path" if k == 0 else None
        )
    cost.plot([coverage_cost(places, ARENA, DENSITY) for places in places_by_step], color=BLUE)
    cost.set_xlim(0, len(places_by_step) - 1)
    cost.set_yscale("log")
    cost.set_ylim(0.5, 12.0)
    log_ticks(cost.yaxis, (0.5, 1.0, 2.0, 5.0, 10.0))
    cost.set_xlabel("Lloyd step")
    cost.set_ylabel("cost [m⁴]")
    figure.legend(*after.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    part_label(before, "a", "at the start")
    part_label(after, "b", f"after {len(places_by_step) - 1} steps")
    part_label(cost, "c")
    return figure


def _draw_cells(axes: Axes, sites: list[Point]) -> None:
    plan_view(axes)
    axes.grid(visible=False)
    x, y = np.meshgrid(
        np.linspace(ARENA.x_min, ARENA.x_max, 106), np.linspace(ARENA.y_min, ARENA.y_max, 76), indexing="xy"
    )
    shade: dict[str, Any] = {"cmap": "Greys", "vmin": 0.0, "vmax": 2.2, "interpolation": "bilinear"}
    axes.imshow(
        DENSITY(x, y), origin="lower", extent=(ARENA.x_min, ARENA.x_max, ARENA.y_min, ARENA.y_max), zorder=0.5, **shade
    )
    polygons = cells(sites, ARENA)
    for polygon in polygons:
        corners = np.array([*polygon, polygon[0]])
        axes.plot(corners[:, 0], corners[:, 1], color=BLUE, linewidth=0.8)
    centroids = [centroid(polygon, DENSITY) for polygon in polygons]
    axes.plot(*zip(*sites, strict=True), "o", color=BLACK, markersize=3.5, zorder=4, label="robot")
    axes.plot(*zip(*centroids, strict=True), "+", color=SKY, markersize=5, zorder=5, label="centroid of its cell")
    axes.set_xlim(ARENA.x_min, ARENA.x_max)
    axes.set_ylim(ARENA.y_min, ARENA.y_max)
