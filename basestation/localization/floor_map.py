"""From a camera's pixels to metres on planes above the floor.

The only place in the project where pixels are converted to metres.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from muro_zenoh.optics.camera_model import CameraModel

Array = NDArray[np.float64]


class FloorMap:
    """Where on a plane above the floor a pixel is.

    The distortion of the lens is undone on the points, not on the picture.

    Args:
        camera: the calibrated camera.
    """

    def __init__(self, camera: CameraModel) -> None:
        self.camera = camera
        self._limits = np.array(((-0.5, camera.width - 0.5), (-0.5, camera.height - 0.5)))

    def to_metres(self, points: Array, heights: Array | float = 0.0) -> Array:
        """Positions of pixels on level planes.

        Args:
            points: (..., 2) [px]; integers are pixel centres.
            heights: (...), or one for all: of the planes above the floor [m].

        Returns:
            (..., 2) [m, world]; NaN for pixels on or above the horizon.
        """
        rays = self.camera.rays(points)
        z = np.broadcast_to(np.asarray(heights, dtype=np.float64), points.shape[:-1])
        view = self.camera.view
        # Of the plane at height z the camera sees the homography (first, second, z third + fourth column).
        plane = np.empty((*z.shape, 3, 3))
        plane[..., :2] = view[:, :2]
        plane[..., 2] = z[..., None] * view[:, 2] + view[:, 3]
        ahead = np.concatenate((rays, np.ones((*rays.shape[:-1], 1))), axis=-1)
        homogeneous = (np.linalg.inv(plane) @ ahead[..., None])[..., 0]
        depth = homogeneous[..., 2:]
        metres: Array = homogeneous[..., :2] / np.where(depth > 0.0, depth, np.nan)
        return metres

    def to_pixels(self, points: Array, heights: Array | float = 0.0) -> Array:
        """Pixels of positions on level planes.

        Args:
            points: (..., 2) [m, world].
            heights: (...), or one for all: of the planes above the floor [m].

        Returns:
            (..., 2) [px]; NaN for positions behind the camera.
        """
        z = np.broadcast_to(np.asarray(heights, dtype=np.float64), points.shape[:-1])
        return self.camera.project(np.concatenate((points, z[..., None]), axis=-1))

    def margin(self, points: Array) -> Array:
        """How far inside the picture points are.

        Args:
            points: (..., 2) [px].

        Returns:
            (...) distance from the nearest edge [px]; below 0 outside.
        """
        inside = np.minimum(points - self._limits[:, 0], self._limits[:, 1] - points)
        nearest: Array = inside.min(axis=-1)
        return nearest
