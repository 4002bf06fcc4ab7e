"""The picture that an overhead camera takes of the robots: the stand-in for a real one.

Metres become pixels here and nowhere else in the simulation; the inverse belongs to ``basestation.localization``. The
picture has what a tag detector has to live with: an uneven floor, dark bodies, optical blur, sensor noise, and tags
cut by the picture's edge.

In OpenCV an integer coordinate is the centre of a pixel: a texture of n texels reaches from -0.5 to n - 0.5.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

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
"""Grey level of the mark that shows people where forwards is."""
FLOOR: Final = 165
"""Mean grey level of the floor."""

_SHIFT = 4  # binary places of the sub-pixel coordinates that fillConvexPoly takes
_BANK = 96  # a noise crop starts at one of 96 rows and columns: 9216 different frames
_RIM = 4  # pixels round a robot that the blur may reach


class OverheadCamera:
    """Renders grey pictures of robots with tags.

    A tag is drawn through the homography of its own four corners, so that its edges are exact to hundredths of a pixel.
    All tags are taken to lie in the one plane that ``homography`` maps.

    Args:
        width: of the picture [px].
        height: of the picture [px].
        homography: (3, 3), from homogeneous metres [world] to homogeneous pixels, the third of which is positive for
            what lies before the camera.
        family: name of the tags' dictionary in OpenCV, such as ``DICT_4X4_50``.
        blur: standard deviation of the optics' blur on robots and tags [px].
        noise: standard deviation of the sensor's noise [grey levels]; 0 for none.
        seed: of the floor's speckle and of the noise; one camera's seed gives one floor.

    Raises:
        ValueError: an unknown family, a size or a matrix that cannot be a camera's.
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
        """A camera that sees given places at given pixels.

        Args:
            width: of the picture [px].
            height: of the picture [px].
            views: at least four, of which no three in a line; more are fitted by least squares.
            family: name of the tags' dictionary in OpenCV.
            blur: standard deviation of the optics' blur [px].
            noise: standard deviation of the sensor's noise [grey levels].
            seed: of the floor and the noise.

        Raises:
            ValueError: fewer than four views, or views that fix no homography.
        """
        if len(views) < 4:
            raise ValueError(f"{len(views)} views, expected at least 4")
        table = np.array(views, dtype=np.float64)
        found, _ = cv2.findHomography(table[:, 2:], table[:, :2])
        if found is None:
            raise ValueError("the views fix no homography: three of four in a line, or all in one place")
        matrix = np.asarray(found, dtype=np.float64)
        matrix *= math.copysign(1.0, float((table[:, 2:] @ matrix[2, :2] + matrix[2, 2]).mean()))
        return cls(width, height, matrix, family=family, blur=blur, noise=noise, seed=seed)

    def project(self, points: Array) -> Array:
        """Where places are seen.

        Args:
            points: (..., 2) [m, world].

        Returns:
            (..., 2) [px].
        """
        homogeneous = points @ self.homography[:, :2].T + self.homography[:, 2]
        return homogeneous[..., :2] / homogeneous[..., 2:]

    def tag_corners(self, pose: Array, mount: TagMount, border: float = 0.0) -> Array:
        """Where a tag's corners are seen when its robot is at a pose.

        Args:
            pose: (3,) x [m], y [m], theta [rad] of the base frame in the world.
            mount: the tag on the robot.
            border: this much more on each side [m].

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
            ValueError: not as many mounts or radii as poses, or a tag that the family does not have.
        """
        if not len(poses) == len(mounts) == len(radii):
            raise ValueError(f"{len(poses)} poses, {len(mounts)} mounts, {len(radii)} radii, expected as many of each")
        scene = self._floor.copy()
        bodies, papers, boxes = self._outlines(poses, mounts, radii)
        shown = [i for i, (left, top, right, bottom) in enumerate(boxes) if left < right and top < bottom]
        for i in shown:
            self._draw_body(scene, bodies[i])
        for i in shown:
            self._draw_tag(scene, papers[i], boxes[i], mounts[i].id)
        picture = scene
        if self._blur > 0.0:
            # From the sharp scene into a copy, so that what lies in two boxes is not blurred twice.
            picture = scene.copy()
            for i in shown:
                left, top, right, bottom = boxes[i]
                sharp, blurred = scene[top:bottom, left:right], picture[top:bottom, left:right]
                cv2.GaussianBlur(sharp, (0, 0), self._blur, dst=blurred)
        if self._noise is not None:
            row, column = rng.integers(0, _BANK, size=2).tolist()
            window = (slice(row, row + self.height), slice(column, column + self.width))
            brighter, darker = self._noise
            cv2.add(picture, brighter[window], dst=picture)
            cv2.subtract(picture, darker[window], dst=picture)
        return picture

    def _outlines(
        self, poses: Array, mounts: Sequence[TagMount], radii: Sequence[float]
    ) -> tuple[Array, Array, list[list[int]]]:
        """Of all robots: bodies (N, 43, 2) and papers (N, 4, 2) [px], and the boxes round both, cut at the edges."""
        count = len(poses)
        half = np.array([0.5 * mount.size * self._prints.paper for mount in mounts]).reshape(count, 1, 1)
        yaw = np.array([mount.yaw for mount in mounts])
        offset = np.array([(mount.x, mount.y) for mount in mounts]).reshape(count, 1, 2)
        paper = turned(turned(half * SQUARE, yaw) + offset, poses[:, 2])
        body = turned(np.array(radii).reshape(count, 1, 1) * _BODY, poses[:, 2])
        places = np.concatenate((body, paper), axis=1) + poses[:, None, :2]
        points = self.project(places)
        # A robot behind the camera, or so far out that OpenCV's fixed-point numbers would overflow, is not drawn.
        sane = ((places @ self.homography[2, :2] + self.homography[2, 2]) > 0.0).all(axis=1)
        sane &= (np.abs(points) < 1e5).all(axis=(1, 2))
        points = np.where(sane[:, None, None], points, -1e3)
        low = np.floor(points.min(axis=1)).astype(np.int64) - _RIM
        high = np.ceil(points.max(axis=1)).astype(np.int64) + _RIM + 1
        boxes = np.concatenate((np.maximum(low, 0), np.minimum(high, (self.width, self.height))), axis=1)
        return points[:, : len(_BODY)], points[:, len(_BODY) :], boxes.tolist()

    def _draw_floor(self, rng: np.random.Generator) -> Picture:
        """Light that falls off to the corners and from one side, and a speckle of two grain sizes."""
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
        """What is added and what is taken away, as bytes: two saturating passes, and no signed arithmetic."""
        if noise <= 0.0:
            return None
        shape = (self.height + _BANK, self.width + _BANK)
        grey = np.rint(noise * rng.standard_normal(shape, dtype=np.float32))
        return grey.clip(0, 255).astype(np.uint8), (-grey).clip(0, 255).astype(np.uint8)

    def _draw_body(self, scene: Picture, outline: Array) -> None:
        fixed = np.rint(outline * (1 << _SHIFT)).astype(np.int32)
        disc, mark = fixed[:_DISC], fixed[_DISC:]
        cv2.fillConvexPoly(scene, disc, (BODY,), cv2.LINE_AA, _SHIFT)
        cv2.fillConvexPoly(scene, mark, (MARK,), cv2.LINE_AA, _SHIFT)

    def _draw_tag(self, scene: Picture, paper: Array, box: list[int], tag: int) -> None:
        left, top, right, bottom = box
        texture = self._prints.texture(tag)
        end = texture.shape[0] - 0.5
        texels = np.array(((-0.5, -0.5), (end, -0.5), (end, end), (-0.5, end)), dtype=np.float32)
        # getPerspectiveTransform takes single precision, which suffices near the origin of the box.
        to_box = cv2.getPerspectiveTransform(texels, (paper - (left, top)).astype(np.float32))
        window = scene[top:bottom, left:right]
        size = (right - left, bottom - top)
        cv2.warpPerspective(texture, to_box, size, dst=window, borderMode=cv2.BORDER_TRANSPARENT)


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
    """A disc of radius 1 as a polygon, and a mark that points forwards: for people, who cannot read tags."""
    angles = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)
    mark = ((0.72, 0.16), (0.95, 0.0), (0.72, -0.16))
    return np.concatenate((np.column_stack((np.cos(angles), np.sin(angles))), mark))


_DISC: Final = 40  # corners: 0.1 px from a circle of 40 px radius
_BODY: Final = _body(_DISC)
