"""From a camera's pixels to metres on the plane of the tags, and back.

The only place in the project where pixels are converted to metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from muro_zenoh.errors import ConfigError
from muro_zenoh.geometry import View

Array = NDArray[np.float64]

_RANK = 1e-4  # least ratio of smallest to largest singular value, in normalised points: below it noise dominates


@dataclass(frozen=True, slots=True, eq=False)
class Homography:
    """A projective map of the plane (Hartley and Zisserman, Multiple View Geometry, 2003, chapter 4).

    Attributes:
        matrix: (3, 3), from homogeneous pixels to homogeneous metres; the third component is positive in the picture.
    """

    matrix: Array

    @classmethod
    def fit(cls, views: Sequence[View], *, camera: str) -> Homography:
        """The homography of a camera, from points with known pixels.

        Exact for four views; for more, least squares of the distance in pixels.

        Args:
            views: at least four; no three of four collinear, and of more views at least two off any line.
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
        to_pixels, _ = cv2.findHomography(metres, pixels)
        if to_pixels is None:
            raise ConfigError(
                where,
                got="points that do not determine a homography",
                expected="for example the corners of a rectangle",
            )
        matrix = _inverse(np.asarray(to_pixels, dtype=np.float64))
        depth = pixels @ matrix[2, :2] + matrix[2, 2]
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
        return cls(matrix)

    def to_metres(self, points: Array) -> Array:
        """Positions of pixels.

        Args:
            points: (..., 2) [px]; integers are pixel centres.

        Returns:
            (..., 2) [m, world]; NaN for pixels on or above the horizon.
        """
        return _project(self.matrix, points)

    def to_pixels(self, points: Array) -> Array:
        """Pixels of positions.

        Args:
            points: (..., 2) [m, world].

        Returns:
            (..., 2) [px]; NaN for positions behind the camera.
        """
        return _project(_inverse(self.matrix), points)

    def jacobian(self, points: Array) -> Array:
        """Derivatives of positions with respect to pixels.

        Args:
            points: (..., 2) [px].

        Returns:
            (..., 2, 2) [m/px]: rows x and y, columns u and v.
        """
        homogeneous = points @ self.matrix[:, :2].T + self.matrix[:, 2]
        depth = homogeneous[..., 2, None, None]
        place = homogeneous[..., :2, None] / depth
        slope: Array = (self.matrix[:2, :2] - place * self.matrix[2, :2]) / depth
        return slope


def _inverse(matrix: Array) -> Array:
    return np.linalg.inv(matrix).astype(np.float64)


def _project(matrix: Array, points: Array) -> Array:
    homogeneous = points @ matrix[:, :2].T + matrix[:, 2]
    depth = homogeneous[..., 2:]
    mapped: Array = homogeneous[..., :2] / np.where(depth > 0.0, depth, np.nan)
    return mapped


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
