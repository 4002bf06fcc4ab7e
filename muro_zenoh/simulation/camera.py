"""A simulated overhead camera's picture of the robots.

Metres are converted to pixels here and nowhere else in the simulation; the inverse is in ``basestation.localization``.
The picture has what makes tag detection hard: perspective and a lens that bends, an uneven floor, dark bodies, optical
blur, motion blur, uneven light, things in the way, sensor noise, and tags cut by the picture's edge.

In OpenCV an integer coordinate is the centre of a pixel: a texture of n texels reaches from -0.5 to n - 0.5.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from muro_zenoh.geometry import TagMount
from muro_zenoh.optics.camera_model import CameraModel
from muro_zenoh.simulation.scenery import BANK, draw_floor, draw_light, draw_noise
from muro_zenoh.simulation.shapes import DISC, PAPER, Shapes
from muro_zenoh.simulation.tag_print import TagPrints, corners_in_world, turned

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

BODY: Final = 75
"""Grey level of a robot's top."""
MARK: Final = 135
"""Grey level of the mark that shows the forward direction."""
SIDE: Final = 55
"""Grey level of a robot's side."""
SLEEVE: Final = 95
"""Grey level of what comes between the camera and the floor."""

Pixel = TypeVar("Pixel", np.uint8, np.float32)

_SHIFT = 4  # binary places of the sub-pixel coordinates that fillConvexPoly takes
_NOWHERE = -1e3  # a coordinate outside every picture [px]
_RIM = 4  # margin around a robot for the blur [px]
_COARSE = 4  # directions are computed at each fourth pixel and interpolated: 0.003 px off for a strong lens
_SHORT = 0.25  # motion below this is too short to blur anything [px]


class _Box(NamedTuple):
    """Part of a picture [px]: ``right`` and ``bottom`` are the first column and row outside."""

    left: int
    top: int
    right: int
    bottom: int


class OverheadCamera:
    """Renders grey pictures of robots with tags.

    A tag is drawn pixel by pixel: each pixel's direction is followed to the tag's plane, so that its edges are bent as
    the lens bends them, and exact to hundredths of a pixel.

    Args:
        model: the camera.
        family: name of the tags' dictionary in OpenCV, such as ``DICT_4X4_50``.
        blur: standard deviation of the optics' blur on robots and tags [px].
        noise: standard deviation of the sensor's noise [grey levels]; 0 for none.
        shade: the fraction of the light that is missing in the darkest place.
        exposure: duration of the exposure [s]; what moves is blurred.
        seed: of the floor's speckle, the light and the noise; one camera's seed gives one floor.

    Raises:
        ValueError: an unknown family, an invalid setting.
    """

    def __init__(
        self,
        model: CameraModel,
        *,
        family: str = "DICT_4X4_50",
        blur: float = 0.7,
        noise: float = 2.5,
        shade: float = 0.0,
        exposure: float = 0.0,
        seed: int = 0,
    ) -> None:
        if not 0.0 <= noise <= 64.0 or not 0.0 <= blur <= 10.0:
            raise ValueError(f"noise {noise} and blur {blur}, expected 0 to 64 grey levels and 0 to 10 pixels")
        if not 0.0 <= shade < 1.0 or not 0.0 <= exposure <= 1.0:
            raise ValueError(f"shade {shade} and exposure {exposure}, expected 0 to 1 and 0 to 1 s")
        cv2.setNumThreads(1)
        self.model = model
        self.width = model.width
        self.height = model.height
        self._prints = TagPrints(family)
        self._blur = blur
        self._exposure = exposure
        self._rays = _rays_of_pixels(model)
        rng = np.random.default_rng(seed)
        self._floor = draw_floor(self.width, self.height, rng)
        self._scene = self._floor.copy()
        self._shapes: Shapes | None = None
        self._noise = draw_noise(self.width, self.height, rng, noise)
        # Robots are drawn on the scene in full light, and copied from there to the lit one.
        self._light = draw_light(self.width, self.height, rng, shade) if shade > 0.0 else None
        self._lit_floor = self._floor
        self._lit = self._scene
        if self._light is not None:
            self._lit_floor = np.asarray(cv2.multiply(self._floor, self._light, scale=1 / 255), dtype=np.uint8)
            self._lit = self._lit_floor.copy()

    def project(self, points: Array) -> Array:
        """Project points into the picture.

        Args:
            points: (..., 3) [m, world].

        Returns:
            (..., 2) [px].
        """
        return self.model.project(points)

    def tag_corners(self, pose: Array, mount: TagMount, border: float = 0.0) -> Array:
        """A tag's corners in the picture, for a pose of its robot.

        Args:
            pose: (3,) x [m], y [m], theta [rad] of the base frame in the world.
            mount: the tag on the robot.
            border: margin on each side [m].

        Returns:
            (4, 2) [px]: as printed, the upper left corner, then clockwise.
        """
        return self.project(np.insert(corners_in_world(pose, mount, border), 2, mount.z, axis=1))

    def render(
        self,
        poses: Array,
        mounts: Sequence[TagMount],
        radii: Sequence[float],
        rng: np.random.Generator,
        *,
        twists: Array | None = None,
        cover: Array | None = None,
    ) -> Picture:
        """The picture of all robots.

        Args:
            poses: (N, 3) x [m], y [m], theta [rad] of the base frames in the world, in the middle of the exposure.
            mounts: N, a tag for each robot.
            radii: N, of the robots' round bodies [m].
            rng: draws the noise.
            twists: (N, 2) v [m/s], omega [rad/s] of the robots, for the motion blur; None when all stand still.
            cover: (K, 2) corners of a convex thing between camera and floor [px]; None for none.

        Returns:
            (height, width) of uint8.

        Raises:
            ValueError: the numbers of mounts, radii and poses differ, or the family has no such tag.
        """
        if not len(poses) == len(mounts) == len(radii):
            raise ValueError(f"{len(poses)} poses, {len(mounts)} mounts, {len(radii)} radii, expected as many of each")
        shapes = self._shapes_of(mounts, radii)
        outlines = self._project_outlines(poses, shapes)
        papers = self._boxes_round(outlines[:, PAPER:], rim=2)
        # Everything is drawn on one picture of the floor, which is restored afterwards where robots were: a few small
        # copies instead of two of the whole picture.
        scene, lit = self._scene, self._lit
        boxes = self._boxes_round(outlines, rim=_RIM)
        kernels = self._kernels(poses, twists, mounts)
        drawn = [(box, kernel) for box, kernel in zip(boxes, kernels, strict=True) if _is_seen(box)]
        hidden = [] if cover is None else [box for box in self._boxes_round(cover[None], rim=1) if _is_seen(box)]
        try:
            self._draw_bodies(scene, outlines)
            for box, texture, to_texel in zip(
                papers, shapes.textures, self._rays_to_texels(poses, shapes), strict=True
            ):
                if _is_seen(box):
                    _draw_tag(_window(scene, box), texture, _window(self._rays, box), to_texel)
            # From copies of the sharp scene, so that overlapping boxes are not blurred twice.
            sharp = [(box, kernel, _window(scene, box).copy()) for box, kernel in drawn]
            for box, kernel, window in sharp:
                self._expose_window(box, window, kernel)
            if cover is not None and hidden:
                cv2.fillConvexPoly(lit, np.rint(cover * (1 << _SHIFT)).astype(np.int32), (SLEEVE,), cv2.LINE_AA, _SHIFT)
            return self._expose(lit, rng)
        finally:
            for box in [*(box for box, _ in drawn), *hidden]:
                np.copyto(_window(scene, box), _window(self._floor, box))
                np.copyto(_window(lit, box), _window(self._lit_floor, box))

    def _expose_window(self, box: _Box, sharp: Picture, kernel: Array | None) -> None:
        """Blur and light a part of the scene, from a sharp copy of it."""
        target = _window(self._lit, box)
        if kernel is not None:
            cv2.filter2D(sharp, -1, kernel, dst=target)
        elif self._blur > 0.0:
            cv2.GaussianBlur(sharp, (0, 0), self._blur, dst=target)
        else:
            np.copyto(target, sharp)
        if self._light is not None:
            cv2.multiply(target, _window(self._light, box), dst=target, scale=1 / 255)

    def _shapes_of(self, mounts: Sequence[TagMount], radii: Sequence[float]) -> Shapes:
        """The robots' shapes; rebuilt only when the robots differ from those of the last picture."""
        if self._shapes is None or self._shapes.mounts != mounts or self._shapes.radii != radii:
            self._shapes = Shapes(self._prints, list(mounts), list(radii))
        return self._shapes

    def _project_outlines(self, poses: Array, shapes: Shapes) -> Array:
        """Outlines of feet, bodies, marks and papers (N, 87, 2) [px]; far outside for a robot that cannot be seen."""
        places = turned(shapes.outlines, poses[:, 2]) + poses[:, None, :2]
        points = self.project(np.concatenate((places, shapes.heights[..., None]), axis=-1))
        # A robot behind the camera, or so far outside that OpenCV's fixed-point numbers would overflow, is not drawn.
        drawable = np.all(np.abs(points) < 1e5, axis=(1, 2))  # false for NaN
        shown: Array = np.where(drawable.reshape(-1, 1, 1), points, _NOWHERE)
        return shown

    def _kernels(
        self, poses: Array, twists: Array | None, mounts: Sequence[TagMount]
    ) -> list[NDArray[np.float64] | None]:
        """The kernels of optics and motion together; None for a robot that does not move enough to be blurred by it.

        A short smear is as good as a Gaussian with its second moment: a third of the square of half its length.
        """
        if twists is None or self._exposure <= 0.0 or not len(poses):
            return [None] * len(poses)
        ahead = np.column_stack((np.cos(poses[:, 2]), np.sin(poses[:, 2])))
        offsets = turned(np.array([[(mount.x, mount.y)] for mount in mounts]), poses[:, 2])[:, 0]
        spin = twists[:, 1:] * np.column_stack((-offsets[:, 1], offsets[:, 0]))
        half = 0.5 * self._exposure * (twists[:, :1] * ahead + spin)
        places = np.column_stack((poses[:, :2] + offsets, [mount.z for mount in mounts]))
        after = places + np.column_stack((half, np.zeros(len(half))))
        smear = self.project(after) - self.project(places)
        return [_smear(self._blur, u, v) if math.hypot(u, v) > 0.5 * _SHORT else None for u, v in smear.tolist()]

    def _boxes_round(self, points: Array, rim: int) -> list[_Box]:
        """The bounding boxes of N groups of points (N, K, 2) [px], clipped to the picture."""
        size = (self.width, self.height)
        low = np.clip(np.floor(points.min(axis=1)).astype(np.int64) - rim, 0, size)
        high = np.clip(np.ceil(points.max(axis=1)).astype(np.int64) + rim + 1, 0, size)
        return [_Box(*corners) for corners in np.concatenate((low, high), axis=1).tolist()]

    def _rays_to_texels(self, poses: Array, shapes: Shapes) -> Array:
        """The homographies (N, 3, 3) from directions to the tags' texels."""
        to_world = np.zeros((len(poses), 4, 4))
        to_world[:, 0, 0] = to_world[:, 1, 1] = np.cos(poses[:, 2])
        to_world[:, 1, 0] = np.sin(poses[:, 2])
        to_world[:, 0, 1] = -to_world[:, 1, 0]
        to_world[:, :2, 3] = poses[:, :2]
        to_world[:, 2, 2] = to_world[:, 3, 3] = 1.0
        matrices: Array = self.model.view @ to_world @ shapes.texels_to_base
        # A robot at no place is not drawn, whatever its matrix.
        matrices[~np.isfinite(matrices).all(axis=(1, 2))] = np.eye(3)
        return np.linalg.inv(matrices).astype(np.float64)

    def _draw_bodies(self, scene: Picture, outlines: Array) -> None:
        for outline in np.rint(outlines * (1 << _SHIFT)).astype(np.int32):
            side = cv2.convexHull(outline[: 2 * DISC])
            cv2.fillConvexPoly(scene, side, (SIDE,), cv2.LINE_AA, _SHIFT)
            cv2.fillConvexPoly(scene, outline[DISC : 2 * DISC], (BODY,), cv2.LINE_AA, _SHIFT)
            cv2.fillConvexPoly(scene, outline[2 * DISC : PAPER], (MARK,), cv2.LINE_AA, _SHIFT)

    def _expose(self, scene: Picture, rng: np.random.Generator) -> Picture:
        """A picture of the scene, with the sensor's noise."""
        if self._noise is None:
            return scene.copy()
        row, column = rng.integers(0, BANK, size=2).tolist()
        window = (slice(row, row + self.height), slice(column, column + self.width))
        brighter, darker = self._noise
        picture = cv2.add(scene, brighter[window])
        cv2.subtract(picture, darker[window], dst=picture)
        exposed: Picture = picture  # type: ignore[assignment]  # OpenCV's stubs know no element types
        return exposed


def _is_seen(box: _Box) -> bool:
    return box.left < box.right and box.top < box.bottom


def _window(picture: NDArray[Pixel], box: _Box) -> NDArray[Pixel]:
    return picture[box.top : box.bottom, box.left : box.right]


def _draw_tag(window: Picture, texture: Picture, rays: NDArray[np.float32], to_texel: Array) -> None:
    texels = cv2.perspectiveTransform(rays, to_texel)
    cv2.remap(  # type: ignore[call-overload]  # OpenCV's stubs want a second map
        texture, texels, None, cv2.INTER_LINEAR, dst=window, borderMode=cv2.BORDER_TRANSPARENT
    )


def _rays_of_pixels(model: CameraModel) -> NDArray[np.float32]:
    """The direction of each pixel (height, width, 2)."""
    columns, rows = -(-model.width // _COARSE), -(-model.height // _COARSE)
    middle = 0.5 * (_COARSE - 1)
    u, v = np.meshgrid(np.arange(-1.0, columns + 1.0), np.arange(-1.0, rows + 1.0))
    coarse = model.rays(_COARSE * np.stack((u, v), axis=-1) + middle).astype(np.float32)
    fine = cv2.resize(coarse, None, fx=_COARSE, fy=_COARSE, interpolation=cv2.INTER_LINEAR)
    inside = fine[_COARSE : _COARSE + model.height, _COARSE : _COARSE + model.width]
    return np.ascontiguousarray(inside, dtype=np.float32)


def _smear(blur: float, u: float, v: float) -> NDArray[np.float64]:
    """The kernel of a blur [px] and of a motion from (-u, -v) to (u, v) [px]."""
    optics = max(blur * blur, 0.05)
    xx, xy, yy = u * u / 3.0 + optics, u * v / 3.0, v * v / 3.0 + optics
    reach = min(math.ceil(2.5 * math.sqrt(xx + yy)), 15)
    steps = np.arange(-reach, reach + 1.0)
    # The inverse of the covariance by hand: ten robots a picture, and numpy's took a fifth of the picture's time.
    half, squares = 0.5 / (xx * yy - xy * xy), steps * steps
    down = (half * xx) * squares
    kernel = np.exp((2.0 * half * xy) * np.outer(steps, steps) - (half * yy) * squares - down[:, None])
    even: NDArray[np.float64] = kernel / kernel.sum()
    return even
