"""Finds tags in pictures: in the whole or near expected places, in a lit room or where it is hard."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import cv2
import numpy as np

from basestation.localization.apriltag import AprilTagReader
from basestation.localization.aruco import ArucoReader
from basestation.localization.edges import EdgeReader
from basestation.localization.markers import Marker, Picture, TagReader

READERS: dict[str, Callable[[str], TagReader]] = {"opencv": ArucoReader, "apriltag": AprilTagReader}
"""The libraries, by the name in the settings."""

_SMALLEST = 12.0
"""Side of the smallest tag to find in a picture of a lit room [px] ..."""
_SMALLEST_HARD = 8.0
"""... and in a hard one. Robots' tags are larger; each speck above this costs time."""
_ENLARGED = 1.5
"""Hard pictures are searched enlarged by this: thin cells survive the threshold."""
_TRY_EVERY = 20
"""While tags are missing, one in so many whole pictures is searched both ways ..."""
_TRY_RARELY = 320
"""... and in the end one in so many, where that finds no more: those robots are elsewhere, and it takes 30 ms."""


class TagDetector:
    """Finds tags in one camera's pictures.

    A whole picture is first searched as one of a lit room. When fewer tags are found than may be in it, it is searched
    the hard way too, which takes twenty times as long: at once in the first picture, and now and then afterwards, ever
    more rarely while it finds no more. From the way that finds more, the detector learns which kind of pictures the
    camera gives.

    Corners are where the sides meet in the grey levels, wherever the tag is clear enough: the library's own are on the
    ink, half a pixel inside, and ten times as noisy.

    Args:
        family: name of the tags' dictionary in OpenCV, such as ``DICT_4X4_50`` or ``DICT_APRILTAG_36h11``.
        library: ``opencv`` or ``apriltag``.

    Attributes:
        hard: whether the camera's pictures are dim, blurred or foreign.

    Raises:
        ValueError: an unknown family.
        MissingExtra: the library is not installed.
    """

    def __init__(self, family: str = "DICT_4X4_50", library: str = "opencv") -> None:
        self.family = family
        self.hard = False
        self._reader: TagReader = READERS[library](family)
        self._edges = EdgeReader(family)
        self._until_try = 0
        self._pause = _TRY_EVERY

    def detect(self, image: Picture, *, wanted: int = 0, lost: bool = False) -> list[Marker]:
        """All tags in a picture. A number that is seen twice is returned twice.

        Args:
            image: (height, width), grey.
            wanted: number of tags that may be in it.
            lost: whether one that must be in it was not found lately: the light may have changed.
        """
        if lost:
            self._pause = _TRY_EVERY
            self._until_try = min(self._until_try, _TRY_EVERY)
        markers = self._whole(image, self.hard)
        if not self.hard and len(markers) >= wanted:
            return markers
        self._until_try -= 1
        if self._until_try >= 0:
            return markers
        others = self._whole(image, not self.hard)
        lit, hard = (others, markers) if self.hard else (markers, others)
        in_vain = not self.hard and 0 < len(hard) <= len(lit)
        self._pause = min(2 * self._pause, _TRY_RARELY) if in_vain else _TRY_EVERY
        self._until_try = self._pause
        self.hard = len(hard) > len(lit)
        return hard if self.hard else lit

    def detect_near(self, image: Picture, expected: Iterable[Marker], *, reach: float = 0.3) -> list[Marker]:
        """The tags near their expected positions; several times faster than searching the whole picture.

        Tags within a few pixels of where they are expected are found by their sides; for each of the others its
        surroundings are searched. All tags there are returned, even when another one was expected.

        Args:
            image: (height, width), grey.
            expected: tags with their expected corners.
            reach: maximum distance of a tag from its expected position, in sides of the tag.
        """
        expected = [marker for marker in expected if np.isfinite(marker.corners).all()]
        again = self._edges.find_again(image, expected)
        near = self._around(
            image, [marker for marker, seen in zip(expected, again, strict=True) if seen is None], reach
        )
        return distinct([*(marker for marker in again if marker is not None), *near])

    def _around(self, image: Picture, expected: list[Marker], reach: float) -> list[Marker]:
        if not expected:
            return []
        height, width = image.shape
        corners = np.stack([marker.corners for marker in expected])
        sides = np.hypot(*np.moveaxis(corners - np.roll(corners, 1, axis=1), 2, 0)).mean(axis=1, keepdims=True)
        around = reach * sides + 4.0
        limits = np.array((width, height))
        lows = np.floor(corners.min(axis=1) - around).clip(0, limits).astype(np.int64).tolist()
        highs = np.ceil(corners.max(axis=1) + around).clip(0, limits).astype(np.int64).tolist()
        found: list[Marker] = []
        for (left, top), (right, bottom) in zip(lows, highs, strict=True):
            if right - left >= _SMALLEST and bottom - top >= _SMALLEST:
                crop = self._read(image[top:bottom, left:right], self.hard, crop=True)
                found += [marker.moved(left, top) for marker in crop]
        return self._sharpened(image, found)

    def _whole(self, image: Picture, hard: bool) -> list[Marker]:
        return self._sharpened(image, distinct(self._read(image, hard, crop=False)))

    def _sharpened(self, image: Picture, markers: list[Marker]) -> list[Marker]:
        again = self._edges.find_again(image, markers)
        return [seen or marker for marker, seen in zip(markers, again, strict=True)]

    def _read(self, image: Picture, hard: bool, crop: bool) -> list[Marker]:
        if not hard:
            return self._reader.read(image, _SMALLEST, hard=False, crop=crop)
        large = cv2.resize(image, None, fx=_ENLARGED, fy=_ENLARGED, interpolation=cv2.INTER_CUBIC)
        picture = np.asarray(large, dtype=np.uint8)
        markers = self._reader.read(picture, _ENLARGED * _SMALLEST_HARD, hard=True, crop=crop)
        # The edge of the picture, at -0.5, stays where it is. (The sides are enlarged by whole pixels.)
        scale = np.array(picture.shape[::-1]) / image.shape[::-1]
        return [Marker(marker.id, (marker.corners + 0.5) / scale - 0.5) for marker in markers]


def distinct(markers: list[Marker]) -> list[Marker]:
    """The markers without duplicates from overlapping crops.

    Args:
        markers: of one picture.
    """
    kept: dict[int, list[Marker]] = {}
    for marker in markers:
        same = kept.setdefault(marker.id, [])
        if not any(marker.is_same_as(other) for other in same):
            same.append(marker)
    return [marker for same in kept.values() for marker in same]
