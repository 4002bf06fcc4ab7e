"""A simulated overhead camera's picture of the robots.

Metres are converted to pixels here and nowhere else in the simulation; the inverse is in ``basestation.localization``.
The picture has what makes tag detection hard: an uneven floor, dark bodies, optical blur, sensor noise, and tags cut by
the picture's edge.

In OpenCV an integer coordinate is the centre of a pixel: a texture of n texels reaches from -0.5 to n - 0.5.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from muro_zenoh.geometry import TagMount, View
from muro_zenoh.simulation.tag_print import SQUARE, TagPrints, corners_in_world, turned

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

BODY: Final = 75
"""Grey level of a robot's top."""
MARK: Final = 135
"""Grey level of the mark that shows the forward direction."""
FLOOR: Final = 165
"""Mean grey level of the floor."""

_SHIFT = 4  # binary places of the sub-pixel coordinates that fillConvexPoly takes
_BANK = 96  # a noise crop starts at one of 96 rows and columns: 9216 different frames
_NOWHERE = -1e3  # a coordinate outside every picture [px]
_RIM = 4  # margin around a robot for the blur [px]


class _Box(NamedTuple):
    """Part of a picture [px]: ``right`` and ``bottom`` are the first column and row outside."""

    left: int
    top: int
    right: int
    bottom: int


class OverheadCamera:
    """Renders grey pictures of robots with tags.

    A tag is drawn through the homography of its own four corners, so that its edges are exact to hundredths of a pixel.
    All tags are assumed to be in the one plane that ``homography`` maps.

    Args:
        width: of the picture [px].
        height: of the picture [px].
        homography: (3, 3), from homogeneous metres [world] to homogeneous pixels; the third component is positive in
            front of the camera.
        family: name of the tags' dictionary in OpenCV, such as ``DICT_4X4_50``.
        blur: standard deviation of the optics' blur on robots and tags [px].
        noise: standard deviation of the sensor's noise [grey levels]; 0 for none.
        seed: of the floor's speckle and of the noise; one camera's seed gives one floor.

    Raises:
        ValueError: an unknown family, an invalid size or matrix.
    """

    def __init__(
        self,
        width: int,
        height: int,
        homography: Array,
        *,
        family: str = "DICT_4X4_50",
        blur: float = 0.7,
        noise: float = 2.5,
        seed: int = 0,
    ) -> None:
        if width < 1 or height < 1:
            raise ValueError(f"a picture of {width} x {height} pixels, expected at least 1 x 1")
        if homography.shape != (3, 3) or not np.isfinite(homography).all():
            raise ValueError(f"homography of shape {homography.shape}, expected a finite 3 x 3 matrix")
        if not 0.0 <= noise <= 64.0 or not 0.0 <= blur <= 10.0:
            raise ValueError(f"noise {noise} and blur {blur}, expected 0 to 64 grey levels and 0 to 10 pixels")
        cv2.setNumThreads(1)
        self.width = width
        self.height = height
        self.homography = homography.astype(np.float64)
        self._prints = TagPrints(family)
        self._blur = blur
        rng = np.random.default_rng(seed)
        self._floor = self._draw_floor(rng)
        self._scene = self._floor.copy()
        self._shapes: _Shapes | None = None
        self._noise = self._draw_noise(rng, noise)

    @classmethod
    def from_views(
        cls,
        width: int,
        height: int,
        views: Sequence[View],
        *,
        family: str = "DICT_4X4_50",
        blur: float = 0.7,
        noise: float = 2.5,
        seed: int = 0,
    ) -> OverheadCamera:
        """A camera that sees given points at given pixels.

        Args:
            width: of the picture [px].
            height: of the picture [px].
            views: at least four, no three of them collinear; more are fitted by least squares.
            family: name of the tags' dictionary in OpenCV.
            blur: standard deviation of the optics' blur [px].
            noise: standard deviation of the sensor's noise [grey levels].
            seed: of the floor and the noise.

        Raises:
            ValueError: fewer than four views, or views that do not determine a homography.
        """
        if len(views) < 4:
            raise ValueError(f"{len(views)} views, expected at least 4")
        table = np.array(views, dtype=np.float64)
        found, _ = cv2.findHomography(table[:, 2:], table[:, :2])
        if found is None:
            raise ValueError("the views do not determine a homography: three of four are collinear, or all coincide")
        matrix = np.asarray(found, dtype=np.float64)
        matrix *= math.copysign(1.0, float((table[:, 2:] @ matrix[2, :2] + matrix[2, 2]).mean()))
        return cls(width, height, matrix, family=family, blur=blur, noise=noise, seed=seed)

    def project(self, points: Array) -> Array:
        """Project points into the picture.

        Args:
            points: (..., 2) [m, world].

        Returns:
            (..., 2) [px].
        """
        homogeneous = points @ self.homography[:, :2].T + self.homography[:, 2]
        return homogeneous[..., :2] / homogeneous[..., 2:]

    def tag_corners(self, pose: Array, mount: TagMount, border: float = 0.0) -> Array:
        """A tag's corners in the picture, for a pose of its robot.

        Args:
            pose: (3,) x [m], y [m], theta [rad] of the base frame in the world.
            mount: the tag on the robot.
            border: margin on each side [m].

        Returns:
            (4, 2) [px]: as printed, the upper left corner, then clockwise.
        """
        return self.project(corners_in_world(pose, mount, border))

    def render(
        self, poses: Array, mounts: Sequence[TagMount], radii: Sequence[float], rng: np.random.Generator
    ) -> Picture:
        """The picture of all robots.

        Args:
            poses: (N, 3) x [m], y [m], theta [rad] of the base frames in the world.
            mounts: N, a tag for each robot.
            radii: N, of the robots' round bodies [m].
            rng: draws the noise.

        Returns:
            (height, width) of uint8.

        Raises:
            ValueError: the numbers of mounts, radii and poses differ, or the family has no such tag.
        """
        if not len(poses) == len(mounts) == len(radii):
            raise ValueError(f"{len(poses)} poses, {len(mounts)} mounts, {len(radii)} radii, expected as many of each")
        shapes = self._shapes_of(mounts, radii)
        outlines = self._project_outlines(poses, shapes)
        papers = self._boxes_round(outlines[:, len(_BODY) :], rim=1)
        # Everything is drawn on one picture of the floor, which is restored afterwards where robots were: a few small
        # copies instead of two of the whole picture.
        scene = self._scene
        drawn = [box for box in self._boxes_round(outlines, rim=_RIM) if _is_seen(box)]
        try:
            self._draw_bodies(scene, outlines[:, : len(_BODY)])
            for box, texture, to_box in zip(
                papers, shapes.textures, self._texels_to_boxes(poses, shapes, papers), strict=True
            ):
                if _is_seen(box):
                    _draw_tag(_window(scene, box), texture, to_box)
            if self._blur > 0.0:
                # From copies of the sharp scene, so that overlapping boxes are not blurred twice.
                for window, sharp in [(_window(scene, box), _window(scene, box).copy()) for box in drawn]:
                    cv2.GaussianBlur(sharp, (0, 0), self._blur, dst=window)
            return self._expose(scene, rng)
        finally:
            for box in drawn:
                np.copyto(_window(scene, box), _window(self._floor, box))

    def _shapes_of(self, mounts: Sequence[TagMount], radii: Sequence[float]) -> _Shapes:
        """The robots' shapes; rebuilt only when the robots differ from those of the last picture."""
        if self._shapes is None or self._shapes.mounts != mounts or self._shapes.radii != radii:
            self._shapes = _Shapes(self._prints, list(mounts), list(radii))
        return self._shapes

    def _project_outlines(self, poses: Array, shapes: _Shapes) -> Array:
        """Outlines of the bodies and papers (N, 47, 2) [px]; far outside for a robot that cannot be seen."""
        places = turned(shapes.outlines, poses[:, 2]) + poses[:, None, :2]
        homogeneous = places @ self.homography[:, :2].T + self.homography[:, 2]
        depths = homogeneous[..., 2]
        points = homogeneous[..., :2] / depths[..., None]
        # A robot behind the camera, or so far outside that OpenCV's fixed-point numbers would overflow, is not drawn.
        drawable = np.all(depths > 0.0, axis=1) & np.all(np.abs(points) < 1e5, axis=(1, 2))
        shown: Array = np.where(drawable.reshape(-1, 1, 1), points, _NOWHERE)
        return shown

    def _boxes_round(self, points: Array, rim: int) -> list[_Box]:
        """The bounding boxes of N groups of points (N, K, 2) [px], clipped to the picture."""
        size = (self.width, self.height)
        low = np.clip(np.floor(points.min(axis=1)).astype(np.int64) - rim, 0, size)
        high = np.clip(np.ceil(points.max(axis=1)).astype(np.int64) + rim + 1, 0, size)
        return [_Box(*corners) for corners in np.concatenate((low, high), axis=1).tolist()]

    def _texels_to_boxes(self, poses: Array, shapes: _Shapes, boxes: list[_Box]) -> Array:
        """The homographies (N, 3, 3) from the tags' texels to the pixels of their boxes."""
        to_world = np.zeros((len(poses), 3, 3))
        to_world[:, 0, 0] = to_world[:, 1, 1] = np.cos(poses[:, 2])
        to_world[:, 1, 0] = np.sin(poses[:, 2])
        to_world[:, 0, 1] = -to_world[:, 1, 0]
        to_world[:, :2, 2] = poses[:, :2]
        to_world[:, 2, 2] = 1.0
        matrices: Array = self.homography @ to_world @ shapes.texels_to_base
        corners = np.array([(box.left, box.top) for box in boxes], dtype=np.float64).reshape(-1, 2, 1)
        matrices[:, :2] -= corners * matrices[:, 2:]
        return matrices

    def _draw_bodies(self, scene: Picture, outlines: Array) -> None:
        for outline in np.rint(outlines * (1 << _SHIFT)).astype(np.int32):
            cv2.fillConvexPoly(scene, outline[:_DISC], (BODY,), cv2.LINE_AA, _SHIFT)
            cv2.fillConvexPoly(scene, outline[_DISC:], (MARK,), cv2.LINE_AA, _SHIFT)

    def _expose(self, scene: Picture, rng: np.random.Generator) -> Picture:
        """A picture of the scene, with the sensor's noise."""
        if self._noise is None:
            return scene.copy()
        row, column = rng.integers(0, _BANK, size=2).tolist()
        window = (slice(row, row + self.height), slice(column, column + self.width))
        brighter, darker = self._noise
        picture = cv2.add(scene, brighter[window])
        cv2.subtract(picture, darker[window], dst=picture)
        exposed: Picture = picture  # type: ignore[assignment]  # OpenCV's stubs know no element types
        return exposed

    def _draw_floor(self, rng: np.random.Generator) -> Picture:
        """Light that falls off towards the corners and one side, and a speckle of two grain sizes."""
        v, u = np.mgrid[0 : self.height, 0 : self.width].astype(np.float32)
        u, v = u / self.width - 0.5, v / self.height - 0.5
        floor: NDArray[np.float32] = FLOOR + 25.0 * u - 12.0 * v - 50.0 * (u * u + v * v)
        for grain, strength in ((1.5, 5.0), (12.0, 5.0)):
            speckle = rng.standard_normal((self.height, self.width), dtype=np.float32)
            grains = cv2.GaussianBlur(speckle, (0, 0), grain)
            floor += strength / float(grains.std() or 1.0) * grains
        drawn: Picture = np.clip(np.rint(floor), 0, 255).astype(np.uint8)
        return drawn

    def _draw_noise(self, rng: np.random.Generator, noise: float) -> tuple[Picture, Picture] | None:
        """Noise to add and noise to subtract, as bytes: two saturating passes, no signed arithmetic."""
        if noise <= 0.0:
            return None
        shape = (self.height + _BANK, self.width + _BANK)
        grey = np.rint(noise * rng.standard_normal(shape, dtype=np.float32))
        return grey.clip(0, 255).astype(np.uint8), (-grey).clip(0, 255).astype(np.uint8)


class _Shapes:
    """What is constant between pictures of the same robots.

    Attributes:
        mounts: the robots' tags.
        radii: of their bodies [m].
        outlines: (N, 47, 2) bodies and papers in the base frames [m].
        textures: N, the tags' prints.
        texels_to_base: (N, 3, 3) from homogeneous texels to homogeneous metres in the base frames.
    """

    def __init__(self, prints: TagPrints, mounts: list[TagMount], radii: list[float]) -> None:
        self.mounts = mounts
        self.radii = radii
        count = len(mounts)
        half = np.array([0.5 * mount.size * prints.paper for mount in mounts]).reshape(count, 1, 1)
        yaw = np.array([mount.yaw for mount in mounts])
        offset = np.array([(mount.x, mount.y) for mount in mounts]).reshape(count, 1, 2)
        papers = turned(half * SQUARE, yaw) + offset
        bodies = np.array(radii).reshape(count, 1, 1) * _BODY
        self.outlines: Array = np.concatenate((bodies, papers), axis=1)
        self.textures = [prints.texture(mount.id) for mount in mounts]
        self.texels_to_base: Array = np.zeros((count, 3, 3))
        for matrix, paper, texture in zip(self.texels_to_base, papers, self.textures, strict=True):
            upper_left, upper_right, _, lower_left = paper
            right, down = (upper_right - upper_left) / len(texture), (lower_left - upper_left) / len(texture)
            # The upper left corner of the paper is at (-0.5, -0.5).
            matrix[:2] = np.column_stack((right, down, upper_left + 0.5 * (right + down)))
            matrix[2, 2] = 1.0


def _is_seen(box: _Box) -> bool:
    return box.left < box.right and box.top < box.bottom


def _window(picture: Picture, box: _Box) -> Picture:
    return picture[box.top : box.bottom, box.left : box.right]


def _draw_tag(window: Picture, texture: Picture, to_window: Array) -> None:
    height, width = window.shape
    cv2.warpPerspective(texture, to_window, (width, height), dst=window, borderMode=cv2.BORDER_TRANSPARENT)


def encode_jpeg(picture: Picture, quality: int = 85) -> bytes:
    """A grey picture as JPEG.

    Args:
        picture: (height, width) of uint8.
        quality: 1 to 100; 80 to 85 costs the detector no accuracy.
    """
    ok, data = cv2.imencode(".jpg", picture, (cv2.IMWRITE_JPEG_QUALITY, quality))
    if not ok:
        raise ValueError(f"OpenCV cannot write a picture of shape {picture.shape} as JPEG")
    return data.tobytes()


def _body(count: int) -> Array:
    """A disc of radius 1 as a polygon, and a mark that points forwards, for human viewers."""
    angles = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)
    mark = ((0.72, 0.16), (0.95, 0.0), (0.72, -0.16))
    return np.concatenate((np.column_stack((np.cos(angles), np.sin(angles))), mark))


_DISC: Final = 40  # corners: 0.1 px from a circle of 40 px radius
_BODY: Final = _body(_DISC)
