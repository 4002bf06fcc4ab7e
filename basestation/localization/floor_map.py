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
        # On the plane at height z: x first + y second + (z third + fourth) is a multiple of (u, v, 1). Cramer's rule.
        (au, bu, cu, du), (av, bv, cv, dv), (aw, bw, cw, dw) = view.tolist()
        u, v = rays[..., 0], rays[..., 1]
        depth = cw * z + dw
        off_u, off_v = u * depth - (cu * z + du), v * depth - (cv * z + dv)
        xu, yu, xv, yv = au - u * aw, bu - u * bw, av - v * aw, bv - v * bw
        determinant = xu * yv - yu * xv
        metres = np.stack((off_u * yv - yu * off_v, xu * off_v - off_u * xv), axis=-1)
        metres /= np.where(determinant == 0.0, np.nan, determinant)[..., None]
        metres[~(aw * metres[..., 0] + bw * metres[..., 1] + depth > 0.0)] = np.nan
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
