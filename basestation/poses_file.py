"""What is written of a recording: poses as CSV, and an annotated video."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import IO

import cv2
import numpy as np
from numpy.typing import NDArray

from basestation.localization.fusion import Fix
from muro_zenoh.errors import CameraError

COLUMNS = ("t", "robot", "x", "y", "theta", "sigma_x", "sigma_y", "sigma_theta")
"""Time [s], name, place [m, world], heading [rad], and their standard deviations."""


class PosesFile:
    """Writes poses as CSV, a row per robot and picture.

    Args:
        path: the file; an existing one is replaced.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> PosesFile:
        try:
            self._file: IO[str] = self._path.open("w", newline="")
        except OSError as error:
            raise CameraError(f"{self._path}: cannot be written ({error.strerror}). Choose another --out") from error
        self._rows = csv.writer(self._file)
        self._rows.writerow(COLUMNS)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._file.close()

    def write(self, t: float, fixes: Sequence[Fix]) -> None:
        """Write the robots of a picture.

        Args:
            t: when it was taken [s].
            fixes: the robots.
        """
        for fix in fixes:
            x, y, theta = fix.pose
            sigmas = (math.sqrt(fix.covariance[k]) for k in (0, 4, 8))
            numbers = (f"{number:.6f}" for number in (x, y, theta, *sigmas))
            self._rows.writerow((f"{t:.6f}", fix.name, *numbers))


class AnnotatedVideo:
    """Writes pictures as an MP4 video.

    Args:
        path: the file.
        rate: pictures per second [Hz].
        width: of a picture [px].
        height: of a picture [px].

    Raises:
        CameraError: OpenCV cannot write there.
    """

    def __init__(self, path: Path, rate: float, width: int, height: int) -> None:
        self._video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate, (width, height))
        if not self._video.isOpened():
            raise CameraError(f"{path}: cannot be written as a video, expected a file that ends with .mp4")

    def write(self, picture: NDArray[np.uint8]) -> None:
        """Append a picture.

        Args:
            picture: (height, width, 3) blue, green, red.
        """
        self._video.write(picture)

    def close(self) -> None:
        """Finish the file."""
        self._video.release()
