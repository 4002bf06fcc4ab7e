"""Draws into a picture what is seen in it: names, axes, and the reasons for what is not believed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from basestation.localization.fusion import Fix
from basestation.localization.markers import Picture
from muro_zenoh.geometry import TagMount
from muro_zenoh.optics.camera_model import CameraModel

_AXIS = 0.2
"""Length of the axes [m]."""
_FORWARDS, _LEFT, _NAME, _WRONG = (60, 60, 255), (60, 220, 60), (255, 255, 80), (80, 140, 255)  # blue, green, red


def annotate(
    picture: Picture,
    camera: CameraModel,
    fixes: Sequence[Fix],
    mounts: Mapping[str, TagMount],
    complaints: Sequence[str],
) -> NDArray[np.uint8]:
    """A picture with what was found in it.

    Args:
        picture: (height, width), grey.
        camera: that took it.
        fixes: the robots that are believed: each with its name, a red axis forwards and a green one to the left.
        mounts: the robots' tags, by name.
        complaints: lines of text in the upper left corner.

    Returns:
        (height, width, 3) blue, green, red.
    """
    drawn = np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    for fix in fixes:
        x, y, theta = fix.pose
        c, s, z = _AXIS * math.cos(theta), _AXIS * math.sin(theta), mounts[fix.name].z
        ends = camera.project(np.array([[x, y, z], [x + c, y + s, z], [x - s, y + c, z]]))
        if not np.isfinite(ends).all():
            continue
        middle, ahead, left = (tuple(end) for end in np.rint(ends).astype(int).tolist())
        cv2.line(drawn, middle, ahead, _FORWARDS, 2, cv2.LINE_AA)
        cv2.line(drawn, middle, left, _LEFT, 2, cv2.LINE_AA)
        cv2.putText(drawn, fix.name, (middle[0] + 8, middle[1] - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.6, _NAME, 2)
    for number, line in enumerate(complaints):
        cv2.putText(drawn, line, (10, 24 + 22 * number), cv2.FONT_HERSHEY_SIMPLEX, 0.55, _WRONG, 1, cv2.LINE_AA)
    return drawn
