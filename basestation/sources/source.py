"""What every source of pictures is."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]


class Shot(NamedTuple):
    """A picture: grey ``image`` (height, width), and ``t`` [s], when it was taken, since the recording's start or since
    the camera was opened."""

    image: Picture
    t: float


class FrameSource(Protocol):
    """A camera or a recording. Its methods block: they are called in a thread.

    Attributes:
        name: for errors and logs.
        length: number of pictures; None when it is not known.
        rate: pictures per second [Hz].
    """

    name: str
    length: int | None
    rate: float

    def read(self) -> Shot | None:
        """The next picture; None at the end of a recording.

        Raises:
            CameraError: there is none, though there should be.
        """
        ...

    def close(self) -> None:
        """Release the camera or the file; a second time does nothing."""
        ...


def grey(image: object) -> Picture:
    """A picture of OpenCV's as a grey one.

    Args:
        image: (height, width), or (height, width, 3) blue, green, red; uint8.
    """
    picture = np.asarray(image, dtype=np.uint8)
    if picture.ndim == 3:
        picture = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    return picture
