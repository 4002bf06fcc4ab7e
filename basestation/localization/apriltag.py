"""Reads tags with the AprilTag project's own detector: an option, from the extra ``apriltag``."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from basestation.localization.markers import Marker, Picture
from muro_zenoh.errors import MissingExtra

_PREFIX = "DICT_APRILTAG_"
_FAMILIES = ("16h5", "25h9", "36h11")
_SURE = 20.0
"""Detections with a decision margin below this are noise."""


class AprilTagReader:
    """The AprilTag project's detector (Wang and Olson, IROS 2016), which reads tags of its own families only.

    It is slower than OpenCV's, and finds more of small and blurred tags.

    Args:
        family: as OpenCV names it, such as ``DICT_APRILTAG_36h11``.

    Raises:
        ValueError: another family.
        MissingExtra: the package is not installed.
    """

    def __init__(self, family: str) -> None:
        name = family.removeprefix(_PREFIX)
        if name == family or name not in _FAMILIES:
            known = ", ".join(_PREFIX + each for each in _FAMILIES)
            raise ValueError(f"tag family {family!r} for the AprilTag detector, expected one of {known}")
        try:
            library: Any = importlib.import_module("pyapriltags")
        except ModuleNotFoundError:
            raise MissingExtra("apriltag", 'detector = "apriltag" needs its detector', "pyapriltags") from None
        self.family = family
        self._detector = library.Detector(families=f"tag{name}", nthreads=1, quad_decimate=1.0)

    def read(self, image: Picture, smallest: float, *, hard: bool, crop: bool) -> list[Marker]:
        """The tags in a picture or a part of one.

        Args:
            image: (height, width), grey.
            smallest: side of the smallest tag to find [px].
            hard: makes no difference.
            crop: makes no difference.
        """
        markers = []
        for found in self._detector.detect(np.ascontiguousarray(image)):
            # Its pixels have their centres at one half, its corners run counter-clockwise from the lower left one, and
            # its prints are OpenCV's, turned by half a turn.
            marker = Marker(int(found.tag_id), np.asarray(found.corners, dtype=np.float64)[[1, 0, 3, 2]] - 0.5)
            if found.decision_margin >= _SURE and marker.side >= smallest:
                markers.append(marker)
        return markers
