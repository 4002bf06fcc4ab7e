"""Reads tags with OpenCV."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from basestation.localization.markers import Marker, Picture


@dataclass(frozen=True, slots=True)
class _Threshold:
    """Sides of the adaptive threshold's windows [px], and how much darker than its window ink is [grey levels]."""

    first: int
    last: int
    contrast: float


_LIT = _Threshold(13, 13, 15.0)
_HARD = _Threshold(7, 37, 7.0)


@dataclass
class _Detectors:
    """OpenCV's detectors for one threshold: one for crops, and one per size of whole pictures."""

    settings: cv2.aruco.DetectorParameters
    crop: cv2.aruco.ArucoDetector
    whole: dict[tuple[int, float], cv2.aruco.ArucoDetector] = field(default_factory=dict)


class ArucoReader:
    """OpenCV's detector of square tags, configured for overhead cameras.

    One window of the threshold is enough for a lit room; dim, blurred or foreign pictures need several. Tags below 20
    pixels need OpenCV >= 4.14: older versions read half as many of them.

    "As printed" means as OpenCV prints them: the AprilTag project's own pictures of ``DICT_APRILTAG`` tags are rotated
    by half a turn, so add pi to the ``tag_yaw`` of a robot with such a print.

    Args:
        family: name of the tags' dictionary in OpenCV, such as ``DICT_4X4_50`` or ``DICT_APRILTAG_36h11``.

    Raises:
        ValueError: an unknown family.
    """

    def __init__(self, family: str) -> None:
        number = getattr(cv2.aruco, family, None) if family.startswith("DICT_") else None
        if not isinstance(number, int):
            known = ", ".join(sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_")))
            raise ValueError(f"tag family {family!r}, expected one of {known}")
        cv2.setNumThreads(1)
        self.family = family
        self._dictionary = cv2.aruco.getPredefinedDictionary(number)
        self._detectors = {hard: self._make(_HARD if hard else _LIT) for hard in (False, True)}

    def read(self, image: Picture, smallest: float, *, hard: bool, crop: bool) -> list[Marker]:
        """The tags in a picture or a part of one.

        Args:
            image: (height, width), grey.
            smallest: side of the smallest tag to find [px].
            hard: whether the picture is dim, blurred or foreign; otherwise it is of a lit room.
            crop: whether one tag fills much of the picture, and may touch its edge.
        """
        detectors = self._detectors[hard]
        detector = detectors.crop if crop else self._whole(detectors, max(image.shape), smallest)
        corners, ids, _ = detector.detectMarkers(image)
        if ids is None:
            return []
        return [
            Marker(int(number), quad[0].astype(np.float64)) for number, quad in zip(ids.ravel(), corners, strict=True)
        ]

    def _make(self, threshold: _Threshold) -> _Detectors:
        settings = cv2.aruco.DetectorParameters()
        settings.adaptiveThreshWinSizeMin, settings.adaptiveThreshWinSizeMax = threshold.first, threshold.last
        settings.adaptiveThreshWinSizeStep = 10
        settings.adaptiveThreshConstant = threshold.contrast
        settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
        settings.errorCorrectionRate = 1.0
        settings.perspectiveRemovePixelPerCell = 10
        settings.perspectiveRemoveIgnoredMarginPerCell = 0.33
        # In a crop a tag fills much of the view, and may touch its edge. (The rate is relative to the longer side: with
        # that of the whole picture every speck in the crop would be a candidate.)
        settings.minMarkerPerimeterRate = 1.0
        settings.minDistanceToBorder = 0
        return _Detectors(settings, cv2.aruco.ArucoDetector(self._dictionary, settings))

    def _whole(self, detectors: _Detectors, longest: int, smallest: float) -> cv2.aruco.ArucoDetector:
        """The detector for whole pictures of a size: OpenCV's minimum perimeter is relative to the longer side."""
        key = longest, smallest
        if key not in detectors.whole:
            settings = detectors.settings
            settings.minMarkerPerimeterRate = min(4.0 * smallest / longest, 1.0)
            settings.minDistanceToBorder = 1
            detectors.whole[key] = cv2.aruco.ArucoDetector(self._dictionary, settings)
        return detectors.whole[key]
