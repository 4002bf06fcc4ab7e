"""Which views of a board are good for a calibration, and which of many are taken."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from basestation.calibration.board_views import BoardView
from muro_zenoh.errors import CalibrationError
from muro_zenoh.wording import counted

Array = NDArray[np.float64]

_BLURRED: Final = 1.8
"""A view with more blur is blurred [px] ..."""
_BLURRED_BESIDE: Final = 1.8
"""... and one with so many times that of the middle of all views, if it is more than ..."""
_SHARP: Final = 1.2
"""... this, which is sharp enough in any case [px]."""
_ALIKE: Final = 0.03
"""Views whose boards are nearer to each other than this are one view, in widths of the picture."""
_DIFFERENT: Final = 6
"""Different views that a calibration needs."""
_TILTED: Final = 0.12
"""Least spread of the tilt: the board's far side is so much smaller in one view than in another one."""
_COVERED: Final = 0.7
"""Part of the picture where the board must have been, in cells."""
_CELLS: Final = (6, 4)


def check_views(
    views: Sequence[BoardView], size: tuple[int, int], *, drop: bool
) -> tuple[list[BoardView], tuple[str, ...]]:
    """The views that are sharp; they are different enough.

    Args:
        views: of the board.
        size: width and height of the pictures [px].
        drop: leave out blurred views, instead of refusing the set.

    Returns:
        The views, and why others were left out.

    Raises:
        CalibrationError: blurred views, or views that are too much alike.
    """
    kept, blurred = sharp_views(views)
    dropped = tuple(f"{view.name} is blurred: by {view.blur:.1f} px" for view in blurred)
    if blurred and not drop:
        raise CalibrationError(
            f"{'; '.join(dropped)}. Hold the board still, and light it well. Remove "
            f"{'this picture' if len(blurred) == 1 else 'these pictures'}, or leave out such views with --drop"
        )
    if len(kept) >= _DIFFERENT:  # with fewer there is more to say than that they are alike
        _check_spread(kept, size)
    return kept, dropped


def sharp_views(views: Sequence[BoardView]) -> tuple[list[BoardView], list[BoardView]]:
    """The views that are sharp, and those that are not.

    Args:
        views: of the board.
    """
    if not views:
        return [], []
    limit = min(_BLURRED, max(_SHARP, _BLURRED_BESIDE * float(np.median([view.blur for view in views]))))
    return [view for view in views if view.blur <= limit], [view for view in views if view.blur > limit]


def choose_views(views: Sequence[BoardView], size: tuple[int, int], most: int) -> list[BoardView]:
    """The views that differ most, one after the other farthest from those that were chosen.

    Args:
        views: of the board.
        size: width and height of the pictures [px].
        most: how many to choose at most.

    Returns:
        Them, in the order they were taken in.
    """
    if len(views) <= most:
        return list(views)
    outlines = [_outline(view) / size[0] for view in views]
    distances = np.full(len(views), math.inf)
    chosen = [0]
    while len(chosen) < most:
        distances = np.minimum(distances, [_apart(outline, outlines[chosen[-1]]) for outline in outlines])
        chosen.append(int(distances.argmax()))
    return [views[k] for k in sorted(set(chosen))]


def _check_spread(views: Sequence[BoardView], size: tuple[int, int]) -> None:
    outlines = [_outline(view) / size[0] for view in views]
    different: list[int] = []
    for k, outline in enumerate(outlines):
        if all(_apart(outline, outlines[other]) > _ALIKE for other in different):
            different.append(k)
    if len(different) < _DIFFERENT:
        alike = [view.name for k, view in enumerate(views) if k not in different]
        shown = ", ".join(alike[:8]) + (" and others" if len(alike) > 8 else "")
        raise CalibrationError(
            f"all views are alike: got {counted(len(different), 'different view')} among {len(views)}, expected at "
            f"least {_DIFFERENT}. {shown} show the board where another view has it. Move it to each corner of the "
            "picture, and tilt it by 20 to 45 degrees to all sides"
        )
    tilts = np.array([view.tilt for view in views])
    spread = float(np.ptp(tilts, axis=0).max())
    if spread < _TILTED:
        raise CalibrationError(
            f"all views are alike: in none of {views[0].name} to {views[-1].name} is the board tilted (its scale "
            f"changes by {100 * spread:.0f} %, expected {100 * _TILTED:.0f} %), so that focal length and distance "
            "cannot be told apart. Tilt it by 20 to 45 degrees to all sides"
        )
    cells = np.unique(np.concatenate([np.floor(view.pixels / size * _CELLS).astype(int) for view in views]), axis=0)
    part = len(cells) / math.prod(_CELLS)
    if part < _COVERED:
        raise CalibrationError(
            f"the board was in {100 * part:.0f} % of the picture only, expected {100 * _COVERED:.0f} %: at its edges "
            "the lens bends most. Move the board to each corner of the picture"
        )


def _outline(view: BoardView) -> Array:
    """The corners by number, NaN where they were not found."""
    places = np.full((int(view.ids.max()) + 1, 2), np.nan)
    places[view.ids] = view.pixels
    return places


def _apart(first: Array, second: Array) -> float:
    count = min(len(first), len(second))
    distances = np.hypot(*(first[:count] - second[:count]).T)
    seen = distances[np.isfinite(distances)]
    return float(np.sqrt((seen**2).mean())) if len(seen) else math.inf
