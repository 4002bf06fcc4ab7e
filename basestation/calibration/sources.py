"""From recordings to what calibration needs of them: views of the board, and floor tags."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from basestation.calibration.board_views import BoardFinder, BoardView
from basestation.calibration.edges import on_edges
from basestation.localization.detector import TagDetector
from basestation.sources.recordings import image_files, is_image, open_recording, read_image
from basestation.sources.source import Picture
from muro_zenoh.errors import CalibrationError, CameraError, ConfigError
from muro_zenoh.wording import counted

Array = NDArray[np.float64]

_LOOKED_AT: Final = 200
"""So many pictures of a recording are looked at, at most, all over it."""
_STEADY: Final = 3.0
"""A floor tag that moves more than this between pictures is not lying there [px]."""


class Views(NamedTuple):
    """The board in a recording.

    Attributes:
        views: where it was found.
        reasons: why it was not, elsewhere.
        size: width and height of the pictures [px].
    """

    views: tuple[BoardView, ...]
    reasons: tuple[str, ...]
    size: tuple[int, int]


class FloorTag(NamedTuple):
    """A tag on the floor.

    Attributes:
        corners: (4, 2) mean over the pictures [px].
        middle: (2,) where the diagonals cross: the middle of the print in any perspective [px].
        sigma: standard deviation of the mean [px]; 0 with one picture.
    """

    corners: Array
    middle: Array
    sigma: float


def board_views(source: Path, finder: BoardFinder, on_picture: Callable[[], None]) -> Views:
    """The views of a board in a recording.

    Args:
        source: a directory of images, an image or a video.
        finder: of the board.
        on_picture: called after each picture.

    Raises:
        CalibrationError: pictures of different sizes, or the board in none of them.
        CameraError: no recording.
    """
    views: list[BoardView] = []
    reasons: list[str] = []
    size: tuple[int, int] | None = None
    for name, image in pictures(source, reasons):
        height, width = image.shape
        if size is not None and size != (width, height):
            raise CalibrationError(
                f"{name}: got {width} x {height} pixels, expected {size[0]} x {size[1]} as in the pictures before it. "
                "Is it of another camera? Take all with the resolution that the camera runs with"
            )
        size = width, height
        try:
            views.append(finder.find(name, image))
        except CalibrationError as error:
            reasons.append(str(error))
        on_picture()
    if size is None:
        raise CalibrationError(f"{source}: got no picture that can be read. " + "; ".join(reasons[:3]))
    if not views:
        looked_at = counted(len(reasons), "picture")
        raise CalibrationError(f"{source}: got the board in none of {looked_at}, expected it in 20. {reasons[0]}")
    return Views(tuple(views), tuple(reasons), size)


def floor_tags(
    source: Path, family: str, wanted: set[int], size: tuple[int, int], on_picture: Callable[[], None]
) -> dict[int, FloorTag]:
    """The tags that lie on the floor.

    Args:
        source: a directory of images, an image or a video.
        family: of the tags, as OpenCV names it.
        wanted: their numbers.
        size: width and height of the pictures that the lens is calibrated for [px].
        on_picture: called after each picture.

    Raises:
        CalibrationError: pictures of another size, a tag that moves, or one that is seen twice.
        CameraError: no recording.
        ConfigError: an unknown family.
    """
    try:
        detector = TagDetector(family)
    except ValueError as error:
        raise ConfigError("--family", got=repr(family), expected=f"a family: {error}") from None
    found: dict[int, list[Array]] = {}
    for name, image in pictures(source, []):
        height, width = image.shape
        if (width, height) != size:
            raise CalibrationError(
                f"{name}: got {width} x {height} pixels, expected {size[0]} x {size[1]}, which the lens is for"
            )
        markers = [m for m in detector.detect(image, wanted=len(wanted)) if m.id in wanted]
        numbers = [marker.id for marker in markers]
        twice = next((number for number in numbers if numbers.count(number) > 1), None)
        if twice is not None:
            raise CalibrationError(f"{name}: tag {twice} is seen twice, expected once. Cover the one, or a mirror")
        for marker in markers:
            sharp = on_edges(image, marker)
            if sharp is not None:
                found.setdefault(marker.id, []).append(sharp.corners)
        on_picture()
    return {number: floor_tag(number, np.stack(found[number])) for number in sorted(found)}


def pictures(source: Path, reasons: list[str]) -> Iterator[tuple[str, Picture]]:
    """The pictures of a recording by name, at most so many, all over it.

    Args:
        source: a directory of images, an image or a video.
        reasons: takes why a picture cannot be read.

    Raises:
        CameraError: no recording.
    """
    if is_image(source):
        yield source.name, read_image(source)
        return
    recording = open_recording(source, 1.0)
    files = image_files(source) if source.is_dir() else []
    every = max(1, -(-(recording.length or 0) // _LOOKED_AT))
    count = 0
    try:
        while True:
            try:
                shot = recording.read()
            except CameraError as error:
                reasons.append(str(error))
                count += 1
                continue
            if shot is None:
                return
            if count % every == 0:
                yield files[count].name if files else f"picture {count} at {shot.t:.2f} s", shot.image
            count += 1
    finally:
        recording.close()


def floor_tag(number: int, corners: Array) -> FloorTag:
    """A tag from all pictures that it was seen in.

    Args:
        number: of it.
        corners: (K, 4, 2) [px].

    Raises:
        CalibrationError: it moves.
    """
    spread = float(np.sqrt(corners.var(axis=0).sum(axis=-1).max()))
    if spread > _STEADY:
        raise CalibrationError(f"tag {number} moves by {spread:.1f} px between the pictures, expected it on the floor")
    a, b, c, d = mean = corners.mean(axis=0)
    along, across = c - a, d - b
    share = np.linalg.solve(np.column_stack((along, -across)), b - a)[0]
    return FloorTag(mean, a + share * along, spread / np.sqrt(len(corners)))
