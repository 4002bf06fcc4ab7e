"""A camera as calibration adjusts it: nine numbers of the lens, a rotation and a translation, and their covariance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from muro_zenoh.optics.camera_model import CameraModel, rotation_matrix

Array = NDArray[np.float64]

LENS: Final = 9
"""Numbers of a lens: fx, fy, cx, cy [px], k1, k2, p1, p2, k3."""
ALL: Final = 15
"""Numbers of a camera: its lens, then a small rotation [rad] and a shift [m], both in the camera's frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A camera.

    Args:
        width: of its pictures [px].
        height: of them [px].
        lens: (9,) fx, fy, cx, cy [px], k1, k2, p1, p2, k3.
        turn: (3, 3) from the world's to the camera's frame.
        shift: (3,) the world's origin in the camera's frame [m].
    """

    width: int
    height: int
    lens: Array
    turn: Array
    shift: Array

    @property
    def model(self) -> CameraModel:
        """The same, for renderer and localization.

        Raises:
            ParameterError: a lens that folds the picture.
        """
        fx, fy, cx, cy, k1, k2, p1, p2, k3 = self.lens.tolist()
        view = np.column_stack((self.turn, self.shift))
        return CameraModel(self.width, self.height, view, (fx, fy), (cx, cy), (k1, k2, p1, p2, k3))

    def adjusted(self, step: Array) -> Camera:
        """The camera after a step of its fifteen numbers.

        Args:
            step: (15,).
        """
        lens = self.lens + step[:LENS]
        turn = rotation_matrix(step[LENS : LENS + 3].tolist()) @ self.turn
        return Camera(self.width, self.height, lens, turn, self.shift + step[LENS + 3 :])


def camera_of(model: CameraModel) -> Camera:
    """A model as calibration adjusts it.

    Args:
        model: of a camera with a lens.
    """
    lens = np.array((*model.focal, *model.centre, *model.distortion))
    return Camera(model.width, model.height, lens, model.view[:, :3], model.view[:, 3])


class Projected(NamedTuple):
    """Pixels with their derivatives.

    Attributes:
        pixels: (N, 2) [px].
        by_camera: (N, 2, 15) by the camera's numbers.
        by_point: (N, 2, 3) by the place [px/m].
    """

    pixels: Array
    by_camera: Array
    by_point: Array


def project(camera: Camera, points: Array) -> Projected:
    """Pixels of places in front of the camera, and how they change: the model of ``optics.camera_model``, derived.

    Args:
        camera: the camera.
        points: (N, 3) [m, world].
    """
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = camera.lens.tolist()
    turned = points @ camera.turn.T
    seen = turned + camera.shift
    depth = seen[:, 2]
    x, y = seen[:, 0] / depth, seen[:, 1] / depth
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2))
    u = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    v = y * radial + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y)
    zero, one = np.zeros_like(x), np.ones_like(x)
    pixels = np.column_stack((fx * u + cx, fy * v + cy))
    by_lens = np.stack(
        (
            np.column_stack(
                (u, zero, one, zero, fx * x * r2, fx * x * r2**2, 2 * fx * x * y, fx * (r2 + 2 * x * x), fx * x * r2**3)
            ),
            np.column_stack(
                (zero, v, zero, one, fy * y * r2, fy * y * r2**2, fy * (r2 + 2 * y * y), 2 * fy * x * y, fy * y * r2**3)
            ),
        ),
        axis=1,
    )
    uu = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
    vv = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
    uv = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
    du = np.column_stack((uu, uv, -(uu * x + uv * y))) * fx
    dv = np.column_stack((uv, vv, -(uv * x + vv * y))) * fy
    by_seen = np.stack((du, dv), axis=1) / depth[:, None, None]
    # A small rotation d moves the rotated point p by d x p.
    by_turn = np.cross(turned[:, None, :], by_seen)
    by_camera = np.concatenate((by_lens, by_turn, by_seen), axis=2)
    return Projected(pixels, by_camera, by_seen @ camera.turn)
