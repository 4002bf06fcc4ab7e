"""A calibrated camera: its lens, and where it is in the world.

A pinhole with the distortion of Brown and Conrady, in OpenCV's order and signs (``cv2.projectPoints``): a place is
transformed into the camera's frame (x right, y down, z into the picture), divided by its depth, distorted and scaled.
Integer pixels are pixel centres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from muro_zenoh.errors import ParameterError
from muro_zenoh.geometry import Bounds

Array = NDArray[np.float64]

NO_DISTORTION: Final = (0.0, 0.0, 0.0, 0.0, 0.0)

_EXACT = 1e-5  # an error that the next step of Newton's method makes less than 1e-10
_ITERATIONS = 20  # Newton's method needs four for an ordinary lens


@dataclass(frozen=True, slots=True, eq=False)
class CameraModel:
    """A camera.

    Args:
        width: of the picture [px].
        height: of the picture [px].
        view: (3, 4), from homogeneous metres [world] to the camera's frame: rotation and translation. A camera that is
            known on one plane only has a third column of zeros: it sees all heights in the same place.
        focal: focal lengths along u and v [px].
        centre: the principal point [px].
        distortion: k1, k2, p1, p2, k3.

    Raises:
        ParameterError: a number that is not finite, an empty picture, or a lens that folds the picture.
    """

    width: int
    height: int
    view: Array
    focal: tuple[float, float] = (1.0, 1.0)
    centre: tuple[float, float] = (0.0, 0.0)
    distortion: tuple[float, float, float, float, float] = NO_DISTORTION

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise ParameterError("camera", got=f"{self.width} x {self.height} pixels", expected="at least 1 x 1")
        if self.view.shape != (3, 4) or not np.isfinite(self.view).all():
            raise ParameterError("view", got=f"shape {self.view.shape}", expected="a finite 3 x 4 matrix")
        if not (min(self.focal) > 0.0 and np.isfinite((*self.focal, *self.centre, *self.distortion)).all()):
            raise ParameterError("focal", got=f"{self.focal}", expected="finite numbers above 0 [px]")
        if not np.isfinite(self.rays(self._border())).all():
            raise ParameterError(
                "distortion",
                got=f"{self.distortion}",
                expected="a lens that maps each pixel to one direction",
                hint="Calibrate again, with the board in the corners of the picture too",
            )

    @property
    def matrix(self) -> Array:
        """(3, 3), the camera matrix of OpenCV."""
        (fx, fy), (cx, cy) = self.focal, self.centre
        return np.array(((fx, 0.0, cx), (0.0, fy, cy), (0.0, 0.0, 1.0)))

    @property
    def position(self) -> Array:
        """(3,), where the camera is [m, world]; not for a camera that is known on one plane only."""
        place: Array = -self.view[:, :3].T @ self.view[:, 3]
        return place

    def project(self, points: Array) -> Array:
        """Pixels of places.

        Args:
            points: (..., 3) [m, world].

        Returns:
            (..., 2) [px]; NaN for what is behind the camera, or so far aside that the lens would fold it back.
        """
        seen = points @ self.view[:, :3].T + self.view[:, 3]
        depth = seen[..., 2:]
        flat = seen[..., :2] / np.where(depth > 1e-9, depth, np.nan)
        squared = (flat * flat).sum(axis=-1, keepdims=True)
        bent = self._distort(np.where(squared < _fold(self.distortion), flat, np.nan))
        pixels: Array = bent * self.focal + self.centre
        return pixels

    def rays(self, pixels: Array) -> Array:
        """The directions that pixels look in: the inverse of lens and camera matrix, by Newton's method.

        Args:
            pixels: (..., 2) [px].

        Returns:
            (..., 2): x / z and y / z in the camera's frame; NaN for pixels that the lens maps no direction to.
        """
        target: Array = (pixels - self.centre) / self.focal
        if self.distortion == NO_DISTORTION:
            return target
        k1, k2, p1, p2, k3 = self.distortion
        u, v = target[..., 0], target[..., 1]
        squared = u * u + v * v
        shrink = 1.0 + squared * (k1 + squared * (k2 + squared * k3))
        shrink = np.where(shrink > 0.5, shrink, 1.0)
        x, y = u / shrink, v / shrink
        for _ in range(_ITERATIONS):
            xx, xy, yy = x * x, x * y, y * y
            squared = xx + yy
            radial = 1.0 + squared * (k1 + squared * (k2 + squared * k3))
            slope = 2.0 * (k1 + squared * (2.0 * k2 + (3.0 * k3) * squared))
            off_u = x * radial + (2.0 * p1) * xy + p2 * (squared + 2.0 * xx) - u
            off_v = y * radial + (2.0 * p2) * xy + p1 * (squared + 2.0 * yy) - v
            uu = radial + slope * xx + (2.0 * p1) * y + (6.0 * p2) * x
            vv = radial + slope * yy + (6.0 * p1) * y + (2.0 * p2) * x
            uv = slope * xy + (2.0 * p1) * x + (2.0 * p2) * y
            determinant = uu * vv - uv * uv
            determinant = np.where(determinant > 0.0, determinant, np.nan)
            x = x - (vv * off_u - uv * off_v) / determinant
            y = y - (uu * off_v - uv * off_u) / determinant
            if not np.nanmax(np.abs(off_u) + np.abs(off_v), initial=0.0) > _EXACT:
                break
        rays: Array = np.stack((x, y), axis=-1)
        rays[~(x * x + y * y < _fold(self.distortion))] = np.nan
        return rays

    def moved(self, rotation: Sequence[float], shift: Sequence[float] = (0.0, 0.0, 0.0)) -> CameraModel:
        """The same camera after a bump.

        Args:
            rotation: rotation vector in the camera's frame [rad].
            shift: in the camera's frame [m].
        """
        turn = rotation_matrix(rotation)
        view = turn @ self.view
        view[:, 3] += shift
        return CameraModel(self.width, self.height, view, self.focal, self.centre, self.distortion)

    def _distort(self, flat: Array) -> Array:
        if self.distortion == NO_DISTORTION:
            return flat
        k1, k2, p1, p2, k3 = self.distortion
        x, y = flat[..., 0], flat[..., 1]
        squared = x * x + y * y
        radial = 1.0 + squared * (k1 + squared * (k2 + squared * k3))
        cross = 2.0 * x * y
        return np.stack(
            (
                x * radial + p1 * cross + p2 * (squared + 2.0 * x * x),
                y * radial + p2 * cross + p1 * (squared + 2.0 * y * y),
            ),
            axis=-1,
        )

    def _border(self) -> Array:
        across, down = np.linspace(-0.5, self.width - 0.5, 17), np.linspace(-0.5, self.height - 0.5, 17)
        u, v = np.meshgrid(across, down)
        return np.stack((u, v), axis=-1)


@lru_cache(maxsize=16)
def _fold(distortion: tuple[float, ...]) -> float:
    """The squared distance from the axis from which on a lens would map outer directions further in."""
    k1, k2, _, _, k3 = distortion
    slope = (7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0)
    roots = np.roots([c if abs(c) > 1e-9 else 0.0 for c in slope])  # np.roots divides by the first
    return min((float(r.real) for r in roots if abs(r.imag) < 1e-9 and r.real > 0.0), default=math.inf)


def calibrated(
    width: int,
    height: int,
    *,
    focal: tuple[float, float],
    centre: tuple[float, float],
    distortion: tuple[float, float, float, float, float] = NO_DISTORTION,
    position: tuple[float, float, float],
    rotation: tuple[float, float, float],
) -> CameraModel:
    """A camera with known lens and place.

    Args:
        width: of the picture [px].
        height: of the picture [px].
        focal: focal lengths along u and v [px].
        centre: the principal point [px].
        distortion: k1, k2, p1, p2, k3.
        position: of the camera [m, world].
        rotation: rotation vector from the world's to the camera's frame, OpenCV's ``rvec`` [rad].
    """
    turn = rotation_matrix(rotation)
    view = np.column_stack((turn, -turn @ np.array(position)))
    return CameraModel(width, height, view, focal, centre, distortion)


def planar(width: int, height: int, homography: Array) -> CameraModel:
    """A camera that is known on one plane only.

    Args:
        width: of the picture [px].
        height: of the picture [px].
        homography: (3, 3), from homogeneous metres [world] to homogeneous pixels; the third component is positive in
            front of the camera.
    """
    if homography.shape != (3, 3):
        raise ParameterError("homography", got=f"shape {homography.shape}", expected="a 3 x 3 matrix")
    return CameraModel(width, height, np.insert(homography.astype(np.float64), 2, 0.0, axis=1))


def hung(
    width: int,
    height: int,
    *,
    position: tuple[float, float, float],
    tilt: float = 0.0,
    heading: float = 0.0,
    fov: float | None = None,
    sees: Bounds | None = None,
    distortion: tuple[float, float, float, float, float] = NO_DISTORTION,
) -> CameraModel:
    """A camera that hangs over the floor, with square pixels.

    Args:
        width: of the picture [px].
        height: of the picture [px].
        position: of the camera [m, world].
        tilt: from straight down towards the picture's upper edge [rad].
        heading: of the picture's right edge, counter-clockwise from x [rad].
        fov: angle that the picture's width covers, without the distortion [rad].
        sees: the rectangle of floor that just fits into the picture, when ``fov`` is None.
        distortion: k1, k2, p1, p2, k3.

    Raises:
        ParameterError: neither ``fov`` nor ``sees``, or a rectangle that reaches behind the camera.
    """
    c, s = math.cos(heading), math.sin(heading)
    right, up = np.array((c, s, 0.0)), np.array((-s, c, 0.0))
    ahead = math.sin(tilt) * up - math.cos(tilt) * np.array((0.0, 0.0, 1.0))
    turn = np.stack((right, np.cross(ahead, right), ahead))
    view = np.column_stack((turn, -turn @ np.array(position)))
    centre = (0.5 * (width - 1), 0.5 * (height - 1))
    if fov is not None:
        focal = 0.5 * width / math.tan(0.5 * fov)
    elif sees is not None:
        wide = CameraModel(width, height, view, (1e9, 1e9), centre, distortion)
        across, down = np.linspace(sees.x_min, sees.x_max, 9), np.linspace(sees.y_min, sees.y_max, 9)
        x, y = np.meshgrid(across, down)
        reach = np.abs((wide.project(np.stack((x, y, np.zeros_like(x)), axis=-1)) - centre) / 1e9).max(axis=(0, 1))
        if not np.isfinite(reach).all():
            raise ParameterError(
                "fov", got="nothing", expected="an angle [rad], because the camera cannot see the whole arena"
            )
        focal = float((0.5 * np.array((width, height)) / reach).min())
    else:
        raise ParameterError("fov", got="nothing", expected="an angle [rad], or a rectangle to see")
    return CameraModel(width, height, view, (focal, focal), centre, distortion)


def rotation_matrix(rotation: Sequence[float]) -> Array:
    """The rotation by a rotation vector (Rodrigues).

    Args:
        rotation: axis times angle [rad].

    Returns:
        (3, 3).
    """
    angle = math.hypot(*rotation)
    x, y, z = np.array(rotation) / angle if angle > 0.0 else (1.0, 0.0, 0.0)
    cross = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    turn: Array = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)
    return turn


def rotation_vector(turn: Array) -> tuple[float, float, float]:
    """The rotation vector of a rotation: the inverse of :func:`rotation_matrix`, also near half a turn.

    Args:
        turn: (3, 3).

    Returns:
        Axis times angle [rad], the angle at most pi.
    """
    # The rows of 4 q q^T are multiples of the quaternion q; the longest one has the least error.
    (a, b, c), (d, e, f), (g, h, i) = turn.tolist()
    rows = np.array(
        (
            (1.0 + a + e + i, h - f, c - g, d - b),
            (h - f, 1.0 + a - e - i, b + d, c + g),
            (c - g, b + d, 1.0 - a + e - i, f + h),
            (d - b, c + g, f + h, 1.0 - a - e + i),
        )
    )
    w, *axis = rows[np.argmax(np.diag(rows))].tolist()
    if w < 0.0:
        w, axis = -w, [-each for each in axis]
    length = math.hypot(*axis)
    factor = 2.0 * math.atan2(length, w) / length if length > 0.0 else 0.0
    x, y, z = (factor * each for each in axis)
    return x, y, z
