"""How far off on the floor a calibration may be: a bound for each cell.

An error of the camera's numbers moves what is seen at a pixel to another place of the floor. From the covariance of the
numbers follows that of the place, and from that the distance that is not exceeded in 95 % of all calibrations.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from basestation.calibration.camera import LENS, Camera, project
from basestation.localization.floor_map import FloorMap
from muro_zenoh.geometry import Bounds

Array = NDArray[np.float64]

CONFIDENT: Final = math.sqrt(-2.0 * math.log(0.05))
"""A plane normal variable is within so many standard deviations in 95 % of all cases (Rayleigh)."""


@dataclass(frozen=True, slots=True, eq=False)
class FloorError:
    """The bound on the error in each cell.

    Attributes:
        x: (C,) middles of the columns [m].
        y: (R,) middles of the rows, from the lowest [m].
        bound: (R, C) of the error, at 95 % [m]; NaN where the camera does not see.
    """

    x: Array
    y: Array
    bound: Array

    @property
    def worst(self) -> float:
        """The greatest bound [m]."""
        return float(np.nanmax(self.bound))


def cells_of(bounds: Bounds, cell: float) -> tuple[Array, Array]:
    """The middles of the cells of a grid over a rectangle.

    Args:
        bounds: the rectangle.
        cell: side of a cell, at most [m].

    Returns:
        The columns' x and the rows' y [m].
    """
    columns, rows = max(round(bounds.width / cell), 1), max(round(bounds.height / cell), 1)
    x = bounds.x_min + bounds.width * (np.arange(columns) + 0.5) / columns
    y = bounds.y_min + bounds.height * (np.arange(rows) + 0.5) / rows
    return x, y


def floor_error(camera: Camera, covariance: Array, bounds: Bounds, height: float, cell: float = 0.5) -> FloorError:
    """The bound for a camera that was placed.

    Args:
        camera: the camera.
        covariance: (15, 15) of its numbers.
        bounds: the floor to judge.
        height: of the tags above the floor [m].
        cell: side of a cell [m].
    """
    x, y = cells_of(bounds, cell)
    places = grid(x, y)
    slopes = floor_slopes(camera, places, height)
    bound = bound_of(slopes @ covariance @ slopes.transpose(0, 2, 1))
    bound[~seen(camera, places, height)] = np.nan
    return FloorError(x, y, bound.reshape(len(y), len(x)))


def lens_error(camera: Camera, covariance: Array, height: float, cells: int = 8) -> FloorError:
    """The bound for a lens alone, as if the camera hung over the floor and looked straight down.

    What another place of the camera makes up for is no error, because the camera will be placed with this lens.

    Args:
        camera: the camera with the lens.
        covariance: (9, 9) of the lens.
        height: over the floor [m].
        cells: in the picture's width.
    """
    hung, x, y = _hung(camera, height, cells)
    slopes = floor_slopes(hung, grid(x, y), 0.0)
    flat = slopes.reshape(-1, slopes.shape[-1])
    lens = remainder(flat, flat[:, :LENS]).reshape(-1, 2, LENS)
    bound = bound_of(lens @ covariance @ lens.transpose(0, 2, 1))
    return FloorError(x, y, bound.reshape(len(y), len(x)))


def lens_difference(first: Camera, second: Camera, height: float, cells: int = 8) -> Array:
    """How far apart on the floor two lenses see the same pixels, at best.

    Args:
        first: a camera; its cells are those of :func:`lens_error`.
        second: a camera with another lens.
        height: over the floor [m].
        cells: in the picture's width.

    Returns:
        (R, C, 2) [m].
    """
    hung, x, y = _hung(first, height, cells)
    places = grid(x, y)
    other = Camera(hung.width, hung.height, second.lens, hung.turn, hung.shift)
    pixels = project(hung, np.insert(places, 2, 0.0, axis=1)).pixels
    off = (FloorMap(other.model).to_metres(pixels) - places).reshape(-1, 1)
    slopes = floor_slopes(hung, places, 0.0)
    left: Array = remainder(slopes.reshape(-1, slopes.shape[-1]), off)
    return left.reshape(len(y), len(x), 2)


def floor_slopes(camera: Camera, places: Array, height: float) -> Array:
    """How places move on the floor when the camera's numbers change and the pixels stay.

    Args:
        camera: the camera.
        places: (M, 2) [m, world].
        height: of them [m].

    Returns:
        (M, 2, 15).
    """
    _, by_camera, by_point = project(camera, np.insert(places, 2, height, axis=1))
    return np.asarray(-np.linalg.solve(by_point[:, :, :2], by_camera), dtype=np.float64)


def bound_of(covariance: Array) -> Array:
    """The distance within which a plane normal variable is in 95 % of all cases, at least.

    Args:
        covariance: (M, 2, 2) [m^2].

    Returns:
        (M,) [m].
    """
    bound: Array = CONFIDENT * np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, 1], 0.0))
    return bound


def seen(camera: Camera, places: Array, height: float) -> NDArray[np.bool_]:
    """Which places are in the picture.

    Args:
        camera: the camera.
        places: (M, 2) [m, world].
        height: of them [m].
    """
    floor = FloorMap(camera.model)
    with np.errstate(invalid="ignore"):
        inside: NDArray[np.bool_] = floor.margin(floor.to_pixels(places, height)) >= 0.0
    return inside


def remainder(slopes: Array, moved: Array) -> Array:
    """What of a change on the floor no other place of the camera makes up for.

    Args:
        slopes: (K, 15) of the floor's coordinates by the camera's numbers.
        moved: (K, ...) changes of the coordinates.
    """
    place = slopes[:, LENS:]
    return np.asarray(moved - place @ np.linalg.lstsq(place, moved, rcond=None)[0], dtype=np.float64)


def _hung(camera: Camera, height: float, cells: int) -> tuple[Camera, Array, Array]:
    turn = np.diag((1.0, -1.0, -1.0))
    hung = Camera(camera.width, camera.height, camera.lens, turn, np.array((0.0, 0.0, height)))
    rows = max(round(cells * camera.height / camera.width), 1)
    middle_u, middle_v = 0.5 * (camera.width - 1), 0.5 * (camera.height - 1)
    edges = np.array(
        ((-0.5, middle_v), (camera.width - 0.5, middle_v), (middle_u, camera.height - 0.5), (middle_u, -0.5))
    )
    (left, _), (right, _), (_, low), (_, high) = FloorMap(hung.model).to_metres(edges).tolist()
    x = left + (right - left) * (np.arange(cells) + 0.5) / cells
    y = low + (high - low) * (np.arange(rows) + 0.5) / rows
    return hung, x, y


def grid(x: Array, y: Array) -> Array:
    """The middles of all cells, row by row.

    Args:
        x: (C,) of the columns [m].
        y: (R,) of the rows [m].

    Returns:
        (R C, 2) [m].
    """
    columns, rows = np.meshgrid(x, y)
    return np.column_stack((columns.ravel(), rows.ravel()))
