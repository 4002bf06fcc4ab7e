"""Detects tags in a picture: their numbers and the pixels of their corners. No metres, no robots."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Marker:
    """A tag that was seen or is expected in a picture.

    Attributes:
        id: its number.
        corners: (4, 2) [px; integers are pixel centres]: as printed, the upper left corner, then clockwise.
    """

    id: int
    corners: Array

    @property
    def centre(self) -> tuple[float, float]:
        """Mean of the corners [px]."""
        (au, av), (bu, bv), (cu, cv), (du, dv) = self.corners.tolist()
        return 0.25 * (au + bu + cu + du), 0.25 * (av + bv + cv + dv)

    @property
    def side(self) -> float:
        """Mean length of the four sides [px]."""
        a, b, c, d = self.corners.tolist()
        return 0.25 * (math.dist(a, b) + math.dist(b, c) + math.dist(c, d) + math.dist(d, a))

    def is_same_as(self, other: Marker) -> bool:
        """Whether both are the same print: the same number at nearly the same position."""
        return self.id == other.id and math.dist(self.centre, other.centre) < 0.5 * max(self.side, other.side)

    def moved(self, u: float, v: float) -> Marker:
        """The same tag, shifted.

        Args:
            u: to the right [px].
            v: down [px].
        """
        return Marker(self.id, self.corners + np.array((u, v)))


class TagDetector:
    """OpenCV's detector of square tags, configured for overhead cameras.

    Thresholding with one window suffices in a lit room. Dim, blurred or foreign pictures need ``windows=(9, 19)`` and a
    ``contrast`` of 7. Tags below 20 pixels need OpenCV >= 4.14: older versions read half as many of them.

    "As printed" means as OpenCV prints them: the AprilTag project's own pictures of ``DICT_APRILTAG`` tags are rotated
    by half a turn, so add pi to the ``tag_yaw`` of a robot with such a print.

    Args:
        family: name of the tags' dictionary in OpenCV, such as ``DICT_4X4_50`` or ``DICT_APRILTAG_36h11``.
        windows: minimum and maximum side of the adaptive threshold's window [px].
        step: from one window to the next [px].
        contrast: how much darker than its window a pixel must be to count as ink [grey levels].
        smallest: side of the smallest tag to detect in a whole picture [px].

    Raises:
        ValueError: an unknown family.
    """

    def __init__(
        self,
        family: str = "DICT_4X4_50",
        *,
        windows: tuple[int, int] = (13, 13),
        step: int = 10,
        contrast: float = 15.0,
        smallest: float = 12.0,
    ) -> None:
        number = getattr(cv2.aruco, family, None) if family.startswith("DICT_") else None
        if not isinstance(number, int):
            known = ", ".join(sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_")))
            raise ValueError(f"tag family {family!r}, expected one of {known}")
        cv2.setNumThreads(1)
        self.family = family
        self._smallest = smallest
        self._dictionary = cv2.aruco.getPredefinedDictionary(number)
        self._settings = cv2.aruco.DetectorParameters()
        self._settings.adaptiveThreshWinSizeMin, self._settings.adaptiveThreshWinSizeMax = windows
        self._settings.adaptiveThreshWinSizeStep = step
        self._settings.adaptiveThreshConstant = contrast
        self._settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
        self._settings.errorCorrectionRate = 1.0
        self._settings.perspectiveRemovePixelPerCell = 10
        self._settings.perspectiveRemoveIgnoredMarginPerCell = 0.33
        self._whole = cv2.aruco.ArucoDetector(self._dictionary, self._settings)
        # In a crop a tag fills much of the view, and may touch its edge. (The rate is relative to the longer side: with
        # that of the whole picture every speck in the crop would be a candidate.)
        self._settings.minMarkerPerimeterRate = 1.0
        self._settings.minDistanceToBorder = 0
        self._crop = cv2.aruco.ArucoDetector(self._dictionary, self._settings)
        self._rates: dict[int, cv2.aruco.ArucoDetector] = {}

    def detect(self, image: Picture) -> list[Marker]:
        """All tags in a picture. A number that is seen twice is returned twice.

        Args:
            image: (height, width), grey.
        """
        return _distinct(_markers(self._of(max(image.shape)), image, 0, 0))

    def detect_near(self, image: Picture, expected: Iterable[Marker], *, reach: float = 0.4) -> list[Marker]:
        """The tags near their expected positions; several times faster than searching the whole picture.

        All tags in a crop are returned, even when another one was expected there.

        Args:
            image: (height, width), grey.
            expected: tags with their expected corners.
            reach: maximum distance of a tag from its expected position, in sides of the tag.
        """
        expected = [marker for marker in expected if np.isfinite(marker.corners).all()]
        if not expected:
            return []
        height, width = image.shape
        corners = np.stack([marker.corners for marker in expected])
        around = [[reach * marker.side + 4.0] for marker in expected]
        limits = np.array((width, height))
        lows = np.floor(corners.min(axis=1) - around).clip(0, limits).astype(np.int64).tolist()
        highs = np.ceil(corners.max(axis=1) + around).clip(0, limits).astype(np.int64).tolist()
        found: list[Marker] = []
        for (left, top), (right, bottom) in zip(lows, highs, strict=True):
            if right - left >= self._smallest and bottom - top >= self._smallest:
                found += _markers(self._crop, image[top:bottom, left:right], left, top)
        return _distinct(found)

    def _of(self, longest: int) -> cv2.aruco.ArucoDetector:
        """The detector for whole pictures of a size: OpenCV's minimum perimeter is relative to the longer side."""
        if longest not in self._rates:
            self._settings.minMarkerPerimeterRate = min(4.0 * self._smallest / longest, 1.0)
            self._settings.minDistanceToBorder = 1
            self._rates[longest] = cv2.aruco.ArucoDetector(self._dictionary, self._settings)
        return self._rates[longest]


def _markers(detector: cv2.aruco.ArucoDetector, image: Picture, left: int, top: int) -> list[Marker]:
    corners, ids, _ = detector.detectMarkers(image)
    if ids is None:
        return []
    shift = np.array((left, top), dtype=np.float64)
    return [Marker(int(number), quad[0] + shift) for number, quad in zip(ids.ravel(), corners, strict=True)]


def _distinct(markers: list[Marker]) -> list[Marker]:
    """The markers without duplicates from overlapping crops."""
    kept: dict[int, list[Marker]] = {}
    for marker in markers:
        same = kept.setdefault(marker.id, [])
        if not any(marker.is_same_as(other) for other in same):
            same.append(marker)
    return [marker for same in kept.values() for marker in same]
