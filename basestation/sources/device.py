"""A camera that is plugged into this machine."""

from __future__ import annotations

import time

import cv2
import numpy as np

from basestation.sources.source import Shot, grey
from muro_zenoh.errors import CameraError


class Device:
    """A camera that OpenCV can open.

    Args:
        device: its number, or its path such as ``/dev/video0``.
        width: of the pictures to ask for [px].
        height: of them [px].
        rate: pictures per second to ask for [Hz].

    Raises:
        CameraError: there is no such camera, or it is in use.
    """

    length: int | None = None

    def __init__(self, device: int | str, width: int, height: int, rate: float) -> None:
        self.name = f"device {device}"
        self.rate = rate
        self._video = cv2.VideoCapture(device)
        if not self._video.isOpened():
            self._video.release()
            raise CameraError(f"{self.name}: got no camera, expected one. Is it plugged in, and not in use elsewhere?")
        # Raw pictures of this size do not fit through USB 2; of several buffered ones the newest is periods old.
        for what, value in (
            (
                cv2.CAP_PROP_FOURCC,
                cv2.VideoWriter.fourcc(*"MJPG"),
            ),
            (cv2.CAP_PROP_FRAME_WIDTH, width),
            (cv2.CAP_PROP_FRAME_HEIGHT, height),
            (cv2.CAP_PROP_FPS, rate),
            (cv2.CAP_PROP_BUFFERSIZE, 1),
        ):
            self._video.set(what, value)
        self._begin = time.monotonic()

    def read(self) -> Shot | None:
        """The next picture; it waits for it.

        Raises:
            CameraError: it gives none, or something that is none.
        """
        try:
            good, image = self._video.read()
        except cv2.error as error:
            raise CameraError(f"{self.name}: gives no picture: {error}. Was it unplugged?") from error
        if not good or image is None:
            raise CameraError(f"{self.name}: gives no picture. Was it unplugged?")
        if image.dtype != np.uint8 or image.ndim not in (2, 3) or image.shape[2:] not in ((), (3,)) or not image.size:
            got = f"got {' x '.join(map(str, image.shape)) or 'nothing'} of {image.dtype}"
            raise CameraError(
                f"{self.name}: {got}, expected a picture in grey or in colours. Is its driver the right one?"
            )
        return Shot(grey(image), time.monotonic() - self._begin)

    def close(self) -> None:
        """Release the camera."""
        self._video.release()
