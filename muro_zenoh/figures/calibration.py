"""What calibration draws: the heat map of the error on the floor, and sheets to print at their true size."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from basestation.calibration.board import Board
from basestation.calibration.floor_error import FloorError
from muro_zenoh.errors import MuroError
from muro_zenoh.figures.canvas import plan_view, save, sheet, style
from muro_zenoh.simulation.tag_print import QUIET, TEXELS, TagPrints

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Picture = NDArray[np.uint8]

PAPERS: Final = {"a4": (0.297, 0.210), "a3": (0.420, 0.297), "letter": (0.2794, 0.2159)}
"""Width and height of a landscape sheet [m]."""

_INCH: Final = 0.0254
_MARGIN: Final = 0.007
"""What printers leave white [m]."""


def heat_map(error: FloorError, title: str, path: Path) -> None:
    """Draw the bound on the error in each cell.

    Args:
        error: the bounds.
        title: above it.
        path: the file; its suffix selects the format.

    Raises:
        MissingExtra: matplotlib is not installed.
        MuroError: the file cannot be written.
    """
    with style():
        width, height = _extent(error.x), _extent(error.y)
        figure, axes = sheet(6.0, 1.4 + 4.4 * min(height / width, 1.6))
        corners = (*_edges(error.x), *_edges(error.y))
        millimetres = 1e3 * error.bound
        most = max(float(np.nanmax(millimetres)), 1e-3)
        shown = axes.imshow(millimetres, origin="lower", extent=corners, cmap="viridis", vmin=0.0, vmax=most)
        plan_view(axes)
        axes.grid(False)
        axes.set_title(title, loc="left")
        for row, y in enumerate(error.y):
            for column, x in enumerate(error.x):
                number = millimetres[row, column]
                if np.isfinite(number):
                    colour = "black" if number > 0.6 * most else "white"
                    axes.text(x, y, f"{number:.1f}", color=colour, ha="center", va="center", fontsize=7)
        bar = figure.colorbar(shown, ax=axes, shrink=0.8)
        bar.set_label("error below this in 95 % of all calibrations [mm]")
        save(figure, path)


class Tag(NamedTuple):
    """A tag to print.

    Attributes:
        name: whose it is.
        family: as OpenCV names it.
        number: of it.
        size: side of its black square [m].
    """

    name: str
    family: str
    number: int
    size: float


def print_sheets(path: Path, board: Board, tags: list[Tag], paper: str) -> int:
    """Write the board and tags to a PDF, at their true size, each on a sheet of its own.

    Args:
        path: the PDF.
        board: the board.
        tags: the tags.
        paper: one of ``PAPERS``.

    Returns:
        Number of sheets.

    Raises:
        MissingExtra: matplotlib is not installed.
        MuroError: something is larger than the paper, or the file cannot be written.
    """
    with style():
        from matplotlib.backends.backend_pdf import PdfPages

        figures = list(sheets(board, tags, paper))
        try:
            with PdfPages(path, metadata={"CreationDate": None}) as pdf:
                for figure in figures:
                    pdf.savefig(figure)
        except OSError as error:
            raise MuroError(f"{path}: cannot be written ({error.strerror}). Choose another --pdf") from error
    return len(figures)


def sheets(board: Board, tags: list[Tag], paper: str) -> Iterator[Figure]:
    """The sheets, the board first; called within :func:`~muro_zenoh.figures.canvas.style`.

    Args:
        board: the board.
        tags: the tags.
        paper: one of ``PAPERS``.

    Raises:
        MuroError: something is larger than the paper.
    """
    text = (
        f"{board.columns} x {board.rows} squares of {1e3 * board.square:g} mm, tags of {1e3 * board.marker:g} mm, "
        f"{board.family}"
    )
    size = (board.columns * board.square, board.rows * board.square)
    yield _page(board.picture(60), size, text, PAPERS[paper], "the board", "smaller squares, or --paper a3")
    prints: Mapping[str, TagPrints] = {family: TagPrints(family) for family in {tag.family for tag in tags}}
    for tag in tags:
        family = prints[tag.family]
        edge = QUIET * TEXELS  # the paper around it is white anyway
        texture = np.where(family.texture(tag.number)[edge:-edge, edge:-edge] > 127, 255, 0).astype(np.uint8)
        text = f"{tag.name}: tag {tag.number}, {tag.family}, black square {1e3 * tag.size:g} mm"
        yield _page(texture, (tag.size, tag.size), text, PAPERS[paper], f"the tag of {tag.name}", "--paper a3")


def _page(
    picture: Picture, size: tuple[float, float], text: str, paper: tuple[float, float], what: str, hint: str
) -> Figure:
    """A sheet with a picture in the middle, a text under it, and a ruler to check the printer with."""
    width, height = paper
    foot = 0.016
    if size[0] > width - 2.0 * _MARGIN + 1e-9 or size[1] > height - foot - 2.0 * _MARGIN + 1e-9:
        most = f"{1e3 * (width - 2 * _MARGIN):.0f} x {1e3 * (height - foot - 2 * _MARGIN):.0f}"
        got = f"{1e3 * size[0]:.0f} x {1e3 * size[1]:.0f}"
        raise MuroError(f"{what} is {got} mm, expected at most {most} mm on this paper. Use {hint}")
    figure, axes = sheet(width / _INCH, height / _INCH)
    figure.set_layout_engine("none")
    axes.set_position((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(0.0, width)
    axes.set_ylim(0.0, height)
    axes.set_axis_off()
    left, low = 0.5 * (width - size[0]), foot + 0.5 * (height - foot - size[1])
    # Rectangles, not an image: their edges are exact at any resolution.
    from matplotlib.collections import PolyCollection

    axes.add_collection(PolyCollection(_ink(picture, size, left, low), facecolors="black", edgecolors="none"))
    axes.text(0.5 * width, 0.0105, f"{text}.  Print at 100 %: the line is 100 mm", ha="center", va="bottom", fontsize=7)
    axes.plot((0.5 * width - 0.05, 0.5 * width + 0.05), (0.0085, 0.0085), color="black", linewidth=0.6)
    return figure


def _ink(picture: Picture, size: tuple[float, float], left: float, low: float) -> list[list[tuple[float, float]]]:
    """Rectangles [m] of the black runs in each band of equal rows."""
    rows, columns = picture.shape
    wide, tall = size[0] / columns, size[1] / rows
    black = picture < 128
    starts = [0, *(np.flatnonzero((black[1:] != black[:-1]).any(axis=1)) + 1).tolist(), rows]
    boxes = []
    for top, bottom in itertools.pairwise(starts):
        line = np.concatenate(([False], black[top], [False])).astype(np.int8)
        changes = np.flatnonzero(np.diff(line)).tolist()
        for first, last in zip(changes[::2], changes[1::2], strict=True):
            x0, x1 = left + wide * first, left + wide * last
            y1, y0 = low + size[1] - tall * top, low + size[1] - tall * bottom
            boxes.append([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    return boxes


def _edges(middles: NDArray[np.float64]) -> tuple[float, float]:
    half = 0.5 * (middles[1] - middles[0]) if len(middles) > 1 else 0.25
    return float(middles[0] - half), float(middles[-1] + half)


def _extent(middles: NDArray[np.float64]) -> float:
    low, high = _edges(middles)
    return high - low
