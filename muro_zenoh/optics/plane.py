"""Fits a camera that is known on one plane only, from points with known pixels."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from muro_zenoh.errors import ConfigError
from muro_zenoh.geometry import View
from muro_zenoh.optics.camera_model import CameraModel, planar

Array = NDArray[np.float64]

_RANK = 1e-4  # least ratio of smallest to largest singular value, in normalised points: below it noise dominates


def fit_plane(views: Sequence[View], width: int, height: int, *, camera: str) -> CameraModel:
    """The camera that sees given points of a plane at given pixels (Hartley and Zisserman, 2003, chapter 4).

    Exact for four views; for more, least squares of the distance in pixels.

    Args:
        views: at least four; no three of four collinear, and of more views at least two off any line.
        width: of the picture [px].
        height: of the picture [px].
        camera: name of the camera, for the errors.

    Raises:
        ConfigError: too few, non-finite, collinear, wrongly ordered or mirrored views.
    """
    where = f"camera {camera}: points"
    if len(views) < 4:
        raise ConfigError(where, got=f"{len(views)} points", expected="at least 4, each with pixel and position")
    table = np.array(views, dtype=np.float64)
    if table.shape[1:] != (4,) or not np.isfinite(table).all():
        raise ConfigError(where, got=f"{table.tolist()}", expected="rows of four finite numbers: u, v, x, y")
    pixels, metres = table[:, :2], table[:, 2:]
    if _rank_ratio(pixels, metres) < _RANK:
        raise ConfigError(
            where,
            got="collinear or coinciding points",
            expected="four points, no three of them collinear, in the picture and on the floor",
            hint="Use the corners of a large rectangle",
        )
    found, _ = cv2.findHomography(metres, pixels)
    if found is None:
        raise ConfigError(
            where,
            got="points that do not determine a homography",
            expected="for example the corners of a rectangle",
        )
    matrix = np.asarray(found, dtype=np.float64)
    depth = metres @ matrix[2, :2] + matrix[2, 2]
    if (depth > 0.0).any() and (depth < 0.0).any():
        raise ConfigError(
            where,
            got="points that no camera could see like this: the floor would be folded",
            expected="each pixel with its own position",
            hint="Are two points swapped?",
        )
    matrix = matrix * np.sign(depth[0]) / np.abs(depth).mean()
    if np.linalg.det(matrix) > 0.0:
        raise ConfigError(
            where,
            got="a mirrored floor",
            expected="a floor seen from above, with the same order of points in the picture and on the floor",
            hint="Is y measured downwards, or are x and y swapped?",
        )
    return planar(width, height, matrix)


def _rank_ratio(pixels: Array, metres: Array) -> float:
    """How well the views determine an invertible homography; 0 when they do not."""
    (u, v), (x, y) = _normalised(pixels).T, _normalised(metres).T
    one, zero = np.ones_like(u), np.zeros_like(u)
    rows = np.concatenate(
        (
            np.column_stack((x, y, one, zero, zero, zero, -u * x, -u * y, -u)),
            np.column_stack((zero, zero, zero, x, y, one, -v * x, -v * y, -v)),
        )
    )
    _, singular, right = np.linalg.svd(rows)
    spread = np.linalg.svd(right[-1].reshape(3, 3), compute_uv=False)
    return float(min(singular[7] / (singular[0] or 1.0), spread[2] / (spread[0] or 1.0)))


def _normalised(points: Array) -> Array:
    """Shifted to mean 0 and scaled to mean distance 1."""
    centred = points - points.mean(axis=0)
    scale = float(np.linalg.norm(centred, axis=1).mean())
    scaled: Array = centred / (scale or 1.0)
    return scaled
