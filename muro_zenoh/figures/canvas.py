"""Drawing with matplotlib: no display, one style, reproducible files.

Colours are those of Okabe and Ito, which colour-blind readers can distinguish; curves on shared axes also differ in
their dashes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from muro_zenoh.elementwise import Array
from muro_zenoh.errors import MissingExtra, MuroError
from muro_zenoh.geometry import TWO_PI, Circle, Pose2

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

BLUE: Final = "#0072B2"
ORANGE: Final = "#D55E00"
GREEN: Final = "#009E73"
PURPLE: Final = "#CC79A7"
SKY: Final = "#56B4E9"
AMBER: Final = "#E69F00"
BLACK: Final = "#1a1a1a"
GREY: Final = "#8c8c8c"
PALE: Final = "#e6e6e6"

PAGE: Final = 7.16
"""Width of a journal's page [inch]."""

FORMATS: Final = ("svg", "png")

_STYLE: Final[Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib, so that text has the same size everywhere
    "font.size": 8.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 8.0,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": PALE,
    "grid.linewidth": 0.5,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "legend.handlelength": 2.2,
    "lines.linewidth": 1.2,
    "figure.constrained_layout.use": True,
    "figure.facecolor": "white",  # a page may be dark
    "savefig.facecolor": "white",
    "savefig.dpi": 200,
    "svg.fonttype": "path",  # looks the same where the font is missing
    "svg.hashsalt": "muro",  # ids in the file, otherwise random
    "path.simplify_threshold": 0.3,
}


@contextmanager
def style() -> Iterator[None]:
    """A context with our matplotlib style and no display.

    Raises:
        MissingExtra: matplotlib is not installed.
    """
    try:
        import matplotlib
    except ImportError as error:
        raise MissingExtra("figures", "drawing figures needs matplotlib", "matplotlib") from error
    with matplotlib.rc_context(_STYLE):
        yield


def sheet(width: float, height: float, rows: int = 1, columns: int = 1, **layout: Any) -> tuple[Figure, Any]:
    """A figure and its axes, without a window and without matplotlib's global state.

    Args:
        width: of the figure [inch].
        height: of the figure [inch].
        rows: of axes.
        columns: of axes.
        layout: as for ``Figure.subplots``.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, **layout)


def save(figure: Figure, path: Path) -> None:
    """Write a figure; the same figure gives the same bytes.

    Args:
        figure: the figure.
        path: the file; its suffix selects the format.

    Raises:
        MuroError: the file cannot be written.
    """
    _lay_out(figure)
    metadata: dict[str, Any] = {"Date": None} if path.suffix == ".svg" else {"Software": None}
    try:
        figure.savefig(path, metadata=metadata)
    except OSError as error:
        raise MuroError(
            f"{path}: cannot be written ({error.strerror or error}). Choose another folder with --out"
        ) from error


def _lay_out(figure: Figure) -> None:
    """Round the axes' positions: the solver's last digits differ between runs, and ids in the file depend on them."""
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes in figure.axes:
        x, y, width, height = axes.get_position(original=True).bounds
        axes.set_position((round(x, 6), round(y, 6), round(width, 6), round(height, 6)))


def plan_view(axes: Axes, circle: Circle | None = None) -> None:
    """Axes of the floor: metres, equal scales, and the circle to follow.

    Args:
        axes: the axes.
        circle: drawn as a dashed line; None for no circle.
    """
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    if circle is not None:
        axes.plot(*ring(circle), color=GREY, linestyle=(0, (4, 3)), linewidth=0.9, zorder=1.5)


def ring(circle: Circle) -> tuple[Array, Array]:
    """The circle as a line ``x, y`` [m].

    Args:
        circle: the circle.
    """
    turn = np.linspace(0.0, TWO_PI, 181)
    return circle.x + circle.radius * np.cos(turn), circle.y + circle.radius * np.sin(turn)


def arrow(axes: Axes, pose: Pose2, length: float, color: str) -> None:
    """An arrow for a pose.

    Args:
        axes: the axes.
        pose: its tail and direction [world].
        length: its length [m].
        color: its colour.
    """
    axes.annotate(
        "",
        (pose.x + length * math.cos(pose.theta), pose.y + length * math.sin(pose.theta)),
        (pose.x, pose.y),
        arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 1.1, "shrinkA": 0, "shrinkB": 0},
        zorder=4,
    )


def part_label(axes: Axes, letter: str, title: str = "") -> None:
    """The letter of a part of a figure, above its left edge, with a title after it.

    Args:
        axes: the axes.
        letter: such as ``a``.
        title: what the part shows; empty for no title.
    """
    axes.set_title(rf"$\bf{{({letter})}}$ {title}".rstrip(), loc="left", fontsize=8.0)


def distribution(axes: Axes, values: Array, label: str, color: str, dashes: Any, alpha: float = 1.0) -> None:
    """The cumulative distribution of values, as steps; infinite values count in the total.

    Args:
        axes: the axes.
        values: the values.
        label: for the legend.
        color: of the line.
        dashes: of the line.
        alpha: opacity of the line, 0 to 1.
    """
    reached = np.sort(values[np.isfinite(values)])
    share = np.arange(len(reached) + 1) / max(len(values), 1)
    x = np.concatenate(([1e-3], reached, [1e3]))  # from edge to edge of any axes of ratios
    y = np.concatenate((share, share[-1:]))
    axes.step(x, y, where="post", label=label, color=color, linestyle=dashes, alpha=alpha)


def log_ticks(axis: Axis, ticks: Sequence[float]) -> None:
    """Plain numbers on a logarithmic axis.

    Args:
        axis: the axis.
        ticks: positions of the ticks.
    """
    from matplotlib.ticker import NullLocator

    axis.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    axis.set_minor_locator(NullLocator())
