"""Recordings: a video file, or a directory of images."""

from __future__ import annotations

import os
from pathlib import Path

import cv2

from basestation.sources.source import FrameSource, Picture, Shot, grey
from muro_zenoh.errors import CameraError

# FFmpeg and OpenCV would write lines of their own about a damaged video, before we say which it is.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)

_IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm")


class VideoFile:
    """A video that OpenCV can read.

    Args:
        path: the file.

    Raises:
        CameraError: no such file, or not a video.
    """

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        if not path.is_file():
            raise CameraError(f"{path}: got no such file, expected a video or a directory of images")
        self._video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
        self.rate = self._video.get(cv2.CAP_PROP_FPS)
        count = int(self._video.get(cv2.CAP_PROP_FRAME_COUNT))
        if not self._video.isOpened() or not 0.0 < self.rate < 1e4:
            self._video.release()
            raise CameraError(f"{path}: got a file that is no video, or a damaged one, expected a video. Does it play?")
        self.length: int | None = count if 0 < count < 1e9 else None
        self._read = 0
        self._ended = False

    def read(self) -> Shot | None:
        """The next picture; None at the end.

        Raises:
            CameraError: the file ends before the end that it announces; the next call returns None.
        """
        if self._ended:
            return None
        good, image = self._video.read()
        if not good or image is None:
            self._ended = True
            # The number in the header is often one or two too many.
            if self.length is not None and self._read < self.length - max(2, self.length // 100):
                raise CameraError(
                    f"{self.name}: got {self._read} pictures, expected {self.length} as its header says. "
                    "The file is damaged or was cut off after them"
                )
            return None
        self._read += 1
        return Shot(grey(image), (self._read - 1) / self.rate)

    def close(self) -> None:
        """Release the file."""
        self._video.release()


class ImageDirectory:
    """A directory of images, in the order of their names.

    Args:
        path: the directory.
        rate: images per second, for their times [Hz].

    Raises:
        CameraError: it has no images.
    """

    def __init__(self, path: Path, rate: float) -> None:
        self.name = str(path)
        self._files = image_files(path)
        if not self._files:
            raise CameraError(f"{path}: got no images, expected files that end with {' '.join(_IMAGES)}")
        self.length: int | None = len(self._files)
        self.rate = rate
        self._next = 0

    def read(self) -> Shot | None:
        """The next picture; None at the end.

        Raises:
            CameraError: a file is not an image; the next call returns the one after it.
        """
        if self._next == len(self._files):
            return None
        file = self._files[self._next]
        self._next += 1
        return Shot(read_image(file), (self._next - 1) / self.rate)

    def close(self) -> None:
        """Nothing is held."""


def image_files(path: Path) -> list[Path]:
    """The images of a directory, in the order of their names.

    Args:
        path: the directory.
    """
    return sorted(file for file in path.iterdir() if file.suffix.lower() in _IMAGES)


def is_image(path: Path) -> bool:
    """Whether a path is a single image, by its ending.

    Args:
        path: the path.
    """
    return path.is_file() and path.suffix.lower() in _IMAGES


def read_image(path: Path) -> Picture:
    """A grey image from a file.

    Args:
        path: the file.

    Raises:
        CameraError: it is not an image.
    """
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise CameraError(f"{path}: got a file that is no image, or a damaged one, expected an image")
    return grey(image)


def open_recording(path: Path, rate: float) -> FrameSource:
    """A video file or a directory of images.

    Args:
        path: of it.
        rate: images per second of a directory [Hz].

    Raises:
        CameraError: neither.
    """
    return ImageDirectory(path, rate) if path.is_dir() else VideoFile(path)
