"""Where in each camera's pictures a robot's tag was, over a drive."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from basestation.calibration.edges import on_edges
from basestation.localization.detector import TagDetector
from basestation.localization.markers import Marker, Picture
from basestation.sources.source import FrameSource
from muro_zenoh.config import Scenario
from muro_zenoh.errors import CalibrationError, CameraError

Array = NDArray[np.float64]

COLUMNS: Final = ("t", "camera", "tag", "u1", "v1", "u2", "v2", "u3", "v3", "u4", "v4")
"""Time [s], name, number, and the corners as printed, the upper left one, then clockwise [px]."""

_SEARCH_EVERY: Final = 5
"""While the tag is not seen, and for other tags, one in so many pictures is searched whole."""
_GAP: Final = 0.2
"""Between sightings farther apart than this nothing is interpolated [s]."""
_FAST: Final = 0.4
"""Nor when the tag moved so far between them, in its sides."""


class Seen(NamedTuple):
    """A tag in a picture.

    Attributes:
        t: when [s], on one clock for all cameras.
        camera: that saw it.
        tag: its number.
        corners: (4, 2) [px].
    """

    t: float
    camera: str
    tag: int
    corners: Array


class TagSearch:
    """Finds the tags in one camera's pictures: around the one that drives, and now and then all.

    Args:
        detector: finds the tags.
        wanted: number of the tag that drives.
        camera: that takes the pictures, for errors.
        size: width and height of them, for which its lens is [px].
    """

    def __init__(self, detector: TagDetector, wanted: int, camera: str, size: tuple[int, int]) -> None:
        self._camera = camera
        self._size = size
        self._detector = detector
        self._wanted = wanted
        self._last: list[Marker] = []
        self._count = 0

    def look(self, image: Picture) -> list[Marker]:
        """The tags in the next picture.

        Args:
            image: (height, width), grey.

        Raises:
            CalibrationError: a picture of another size than the lens is for.
        """
        height, width = image.shape
        if (width, height) != self._size:
            raise CalibrationError(
                f"camera {self._camera}: got pictures of {width} x {height} pixels, expected {self._size[0]} x "
                f"{self._size[1]}, which its lens is for. Record with the resolution that the camera runs with"
            )
        whole = self._count % _SEARCH_EVERY == 0
        self._count += 1
        markers = self._detector.detect(image, wanted=1) if whole else self._detector.detect_near(image, self._last)
        self._last = [marker for marker in markers if marker.id == self._wanted]
        return [sharp for marker in markers if (sharp := on_edges(image, marker)) is not None]


def make_search(scenario: Scenario, camera: str, wanted: int) -> TagSearch:
    """The search of a camera's pictures, with the detector that its settings choose.

    Args:
        scenario: the fleet's settings.
        camera: its name.
        wanted: number of the tag that drives.

    Raises:
        MissingExtra: the library of its detector is not installed.
    """
    settings = scenario.camera[camera]
    detector = TagDetector(settings.family, settings.detector)
    return TagSearch(detector, wanted, camera, (settings.width, settings.height))


def look_for_tags(
    camera: str, source: FrameSource, search: TagSearch, seconds: float, on_picture: Callable[[], None]
) -> list[Seen]:
    """All tags in the pictures of a recording.

    Args:
        camera: that took it.
        source: the recording.
        search: finds the tags.
        seconds: to look at, at most [s].
        on_picture: called after each picture.

    Raises:
        CalibrationError: pictures of another size than the lens is for.
    """
    found: list[Seen] = []
    while True:
        try:
            shot = source.read()
        except CameraError:  # a damaged picture is one picture less
            continue
        if shot is None or shot.t > seconds:
            return found
        found += [Seen(shot.t, camera, marker.id, marker.corners) for marker in search.look(shot.image)]
        on_picture()


def save_tags(path: Path, rows: Iterable[Seen]) -> None:
    """Write what was seen as CSV.

    Args:
        path: the file.
        rows: what was seen.

    Raises:
        CalibrationError: the file cannot be written.
    """
    try:
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(COLUMNS)
            for seen in rows:
                corners = (f"{number:.4f}" for number in seen.corners.ravel())
                writer.writerow((f"{seen.t:.6f}", seen.camera, seen.tag, *corners))
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be written ({error.strerror}). Choose another --save") from error


def load_tags(path: Path) -> list[Seen]:
    """Read what :func:`save_tags` wrote.

    Args:
        path: the file.

    Raises:
        CalibrationError: no such file, or another one.
    """
    try:
        with path.open(newline="") as file:
            reader = csv.reader(file)
            header = next(reader, [])
            if tuple(header) != COLUMNS:
                raise CalibrationError(f"{path}: got the columns {','.join(header)[:80]}, expected {','.join(COLUMNS)}")
            rows = []
            for number, row in enumerate(reader, 2):
                try:
                    corners = np.array([float(cell) for cell in row[3:]]).reshape(4, 2)
                    rows.append(Seen(float(row[0]), row[1], int(row[2]), corners))
                except (ValueError, IndexError):
                    raise CalibrationError(
                        f"{path}, line {number}: got {','.join(row)[:80]!r}, expected {','.join(COLUMNS)}"
                    ) from None
            return rows
    except (OSError, UnicodeDecodeError) as error:
        raise CalibrationError(f"{path}: got {error}, expected detections that muro calibrate drive saved") from error


class Knots(NamedTuple):
    """A drive at common times.

    Attributes:
        t: (K,) the times [s].
        corners: by camera, (K, 4, 2) [px]; NaN where it did not see the tag.
    """

    t: Array
    corners: dict[str, Array]

    def seen(self, camera: str) -> NDArray[np.bool_]:
        """(K,) whether a camera saw the tag.

        Args:
            camera: its name.
        """
        return np.asarray(np.isfinite(self.corners[camera]).all(axis=(1, 2)))


def knots_of(rows: Sequence[Seen], cameras: Sequence[str], tag: int, most: int) -> Knots:
    """The drive at times that are the same for all cameras, by interpolation between pictures.

    Args:
        rows: what was seen.
        cameras: their names.
        tag: number of the tag that drives.
        most: how many times.
    """
    mine = [row for row in rows if row.tag == tag and row.camera in cameras]
    if not mine:
        return Knots(np.zeros(0), {camera: np.zeros((0, 4, 2)) for camera in cameras})
    first, last = min(row.t for row in mine), max(row.t for row in mine)
    t = np.linspace(first, last, most)
    corners = {camera: _at(t, [row for row in mine if row.camera == camera]) for camera in cameras}
    knots = Knots(t, corners)
    used = np.any([knots.seen(camera) for camera in cameras], axis=0)
    return Knots(t[used], {camera: each[used] for camera, each in corners.items()})


def _at(t: Array, rows: Sequence[Seen]) -> Array:
    out = np.full((len(t), 4, 2), np.nan)
    if len(rows) < 2:
        return out
    rows = sorted(rows, key=lambda row: row.t)
    times = np.array([row.t for row in rows])
    corners = np.stack([row.corners for row in rows])
    after = np.searchsorted(times, t).clip(1, len(times) - 1)
    span = times[after] - times[after - 1]
    share = ((t - times[after - 1]) / np.where(span > 0.0, span, 1.0))[:, None, None]
    a, b = corners[after - 1], corners[after]
    moved = np.hypot(*np.moveaxis(b - a, 2, 0)).max(axis=1)
    side = np.hypot(*np.moveaxis(b - np.roll(b, 1, axis=1), 2, 0)).mean(axis=1)
    inside = (share[:, 0, 0] > -1e-6) & (share[:, 0, 0] < 1.0 + 1e-6)
    exact = np.minimum(np.abs(share), np.abs(1.0 - share))[:, 0, 0] < 1e-6
    good = inside & (span > 0.0) & (exact | ((span < _GAP) & (moved < _FAST * side)))
    out[good] = ((1.0 - share) * a + share * b)[good]
    return out
