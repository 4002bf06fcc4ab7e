"""Shows what a camera sees while it films: in a window, or as a picture that is written every second."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from basestation.offline import Eye
from basestation.sources.source import FrameSource, Shot

log = logging.getLogger(__name__)

_PERIOD = 1.0
"""Where there is no display a picture is written with this period [s]."""


class Screen:
    """A window, where there is a display and OpenCV has windows; otherwise a PNG file.

    Args:
        title: of the window.
        path: of the file; it is replaced as a whole, so that a viewer never finds half a picture.
        clock: for the file's period [s].
    """

    def __init__(self, title: str, path: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self._title = title
        self._path = path
        self._clock = clock
        self._window = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
        self._due = -float("inf")
        self._said = False

    @property
    def is_due(self) -> bool:
        """Whether a picture would be shown now."""
        return self._window or self._clock() >= self._due

    def show(self, picture: NDArray[np.uint8]) -> None:
        """Show a picture.

        Args:
            picture: (height, width, 3) blue, green, red.
        """
        if self._window:
            try:
                cv2.imshow(self._title, picture)
                cv2.waitKey(1)
                return
            except cv2.error:  # an OpenCV without windows
                self._window = False
        if not self._said:
            log.info("no display: what is seen is written to %s every second", self._path)
            self._said = True
        self._due = self._clock() + _PERIOD
        partial = self._path.with_suffix(".partial.png")
        if cv2.imwrite(str(partial), picture, (cv2.IMWRITE_PNG_COMPRESSION, 1)):
            partial.replace(self._path)


class Shown:
    """A source whose pictures are also shown, with what is in them.

    Args:
        source: of the pictures.
        eye: finds what is in them.
        screen: shows them.
    """

    def __init__(self, source: FrameSource, eye: Eye, screen: Screen) -> None:
        self.name, self.length, self.rate = source.name, source.length, source.rate
        self._source = source
        self._eye = eye
        self._screen = screen

    def read(self) -> Shot | None:
        """The next picture; None at the end of a recording.

        Raises:
            CameraError: there is none, though there should be, or it has another size than the camera's.
        """
        shot = self._source.read()
        if shot is not None:
            looked = self._eye.look(shot)
            if self._screen.is_due:
                self._screen.show(self._eye.draw(shot, looked))
        return shot

    def close(self) -> None:
        """Release the camera or the file."""
        self._source.close()
