"""The board in a picture: its corners, and how sharp they are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from basestation.calibration.board import Board
from muro_zenoh.errors import CalibrationError

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

_STEP = 0.25  # of the profiles across edges [px]
_REACH = 5.0  # of the profiles, at most [px]
_REACH_IN_SIDES = 0.12  # a tag begins at an eighth of a square's side from the edge
_MANY_TAGS = 4  # so many tags without a corner between them are not this board
_BLURRED = 2.0  # a picture whose steepest edges are blurred so much is blurred [px]
_BESIDE_TAGS = 1.0  # a window around a corner ends so far before the nearest tag [px]
_WINDOWS = 2, 12  # half the side of such a window, at least and at most [px]


@dataclass(frozen=True, slots=True, eq=False)
class BoardView:
    """The board in a picture.

    Attributes:
        name: of the picture, for people.
        ids: (N,) numbers of the corners that were found.
        points: (N, 3) the same on the board [m].
        pixels: (N, 2) the same in the picture [px].
        blur: standard deviation of the picture's blur at the board's edges, in the direction where it is worse [px].
    """

    name: str
    ids: NDArray[np.int64]
    points: Array
    pixels: Array
    blur: float

    @property
    def tilt(self) -> Array:
        """(2,) how much the board's scale changes across it along its x and y, in a picture without a lens."""
        found, _ = cv2.findHomography(self.points[:, :2], self.pixels)
        centre = np.append(self.points[:, :2].mean(axis=0), 1.0)
        row = np.asarray(found)[2]
        size = float(np.ptp(self.points[:, :2], axis=0).max())
        slope: Array = row[:2] / (row @ centre) * size
        return slope


class BoardFinder:
    """Finds a board in pictures.

    Args:
        board: the board.
    """

    def __init__(self, board: Board) -> None:
        cv2.setNumThreads(1)
        self.board = board
        self._charuco = board.charuco()
        self._detector = cv2.aruco.CharucoDetector(self._charuco)
        self._least = max(12, board.corners // 3)

    def find(self, name: str, image: Picture) -> BoardView:
        """The board in a picture.

        Args:
            name: of the picture.
            image: (height, width), grey.

        Raises:
            CalibrationError: the board is not there, or too little of it.
        """
        corners, ids, _, tags = self._detector.detectBoard(image)
        found = 0 if ids is None else len(ids)
        if ids is None or found < self._least:
            seen = [] if tags is None else np.ravel(tags).astype(int).tolist()
            size = f"{self.board.columns} x {self.board.rows} squares"
            raise CalibrationError(
                f"{name}: got {found} of {self.board.corners} corners of a board of {size}, "
                f"expected at least {self._least}. {self._why(image, found, seen)}"
            )
        numbers = np.ravel(ids).astype(np.int64)
        pixels = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
        matched, _ = self._charuco.matchImagePoints([*np.asarray(corners).reshape(-1, 1, 2)], np.asarray(ids))
        points = np.asarray(matched, dtype=np.float64).reshape(-1, 3)
        pixels = _refined(image, points, pixels, 0.5 * (self.board.square - self.board.marker))
        return BoardView(name, numbers, points, pixels, _blur(image, numbers, pixels, self.board.columns - 1))

    def _why(self, image: Picture, found: int, tags: list[int]) -> str:
        """Why the board was not found, and what to do."""
        another = "is it another board? --columns and --rows are the squares of the one that you hold"
        known = self.board.columns * self.board.rows // 2
        foreign = [tag for tag in tags if tag >= known]
        if foreign:
            return f"It has tag {foreign[0]}, and this board has 0 to {known - 1}: {another}"
        blur = picture_blur(image)
        if _BLURRED < blur < math.inf:
            return f"The picture is blurred: by {blur:.1f} px, even where it is sharpest. Hold still, more light"
        if found:
            return "Much of it is outside the picture, covered, or in glare: show at least a third of it"
        if len(tags) >= _MANY_TAGS:
            return f"Its tags are seen, but not where this board has them: {another}"
        return "Hold the board flat, in even light, and closer. Is it this board?"


def picture_blur(image: Picture) -> float:
    """Standard deviation of the blur at the steepest edges of any picture [px]; infinite without edges.

    Args:
        image: (height, width), grey.
    """
    smooth = cv2.GaussianBlur(image, (0, 0), 1.0).astype(np.float32)  # the sensor's noise is no edge
    slope = np.hypot(*(cv2.Sobel(smooth, cv2.CV_32F, k, 1 - k, ksize=1, scale=0.5) for k in (0, 1)))
    steepest = float(np.percentile(slope, 99.8))
    dark, light = np.percentile(smooth, (0.5, 99.5)).tolist()
    if steepest <= 0.0:
        return math.inf
    return math.sqrt(max(((light - dark) / (steepest * math.sqrt(2.0 * math.pi))) ** 2 - 1.0, 0.0))


def _refined(image: Picture, points: Array, pixels: Array, gap: float) -> Array:
    """The corners by windows as large as the tags beside each leave room for: half the error of OpenCV's own, whose
    window is one for all of a board that is held at a slant."""
    found, _ = cv2.findHomography(points[:, :2], pixels)
    if found is None:
        return pixels
    to_pixels = np.asarray(found)
    scale = np.column_stack((points[:, :2], np.ones(len(points)))) @ to_pixels[2]
    slopes = (to_pixels[:2, :2] - pixels[:, :, None] * to_pixels[2, :2]) / scale[:, None, None]
    room = gap * np.linalg.svd(slopes, compute_uv=False)[:, 1]  # in the direction in which the board is shortest
    sides = np.floor(room - _BESIDE_TAGS).clip(*_WINDOWS).astype(int)
    enough = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-4)
    refined = pixels.copy()
    for side in np.unique(sides).tolist():
        there = sides == side
        corners = np.ascontiguousarray(pixels[there], dtype=np.float32).reshape(-1, 1, 2)
        refined[there] = cv2.cornerSubPix(image, corners, (side, side), (-1, -1), enough).reshape(-1, 2)
    return refined


def _blur(image: Picture, ids: NDArray[np.int64], pixels: Array, row: int) -> float:
    """How wide the edges between neighbouring corners are; infinite where there are none."""
    place = dict(zip(ids.tolist(), pixels, strict=True))
    left, top = np.floor(pixels.min(axis=0)).astype(int).clip(0).tolist()
    right, bottom = np.ceil(pixels.max(axis=0)).astype(int).tolist()
    dark, light = np.percentile(image[top : bottom + 1, left : right + 1], (10, 90)).tolist()
    widths = []
    for step in (1, row):
        ends = [(place[k], place[k + step]) for k in place if k + step in place and (step != 1 or k % row != row - 1)]
        if ends:
            widths.append(_width(image, np.array(ends), light - dark))
    return max(widths, default=math.inf)


def _width(image: Picture, ends: Array, contrast: float) -> float:
    """Standard deviation of the blur across edges: a step of height c has a slope of c / (sigma sqrt(2 pi))."""
    along = ends[:, 1] - ends[:, 0]
    sides = np.hypot(*along.T)
    reach = min(_REACH, _REACH_IN_SIDES * float(np.median(sides)))
    offsets = np.arange(-reach, reach + 0.5 * _STEP, _STEP)
    across = np.column_stack((-along[:, 1], along[:, 0])) / sides[:, None]
    places = ends.mean(axis=1)[:, None] + offsets[:, None] * across[:, None]
    u, v = (np.ascontiguousarray(places[..., k], dtype=np.float32) for k in (0, 1))
    profiles = np.asarray(cv2.remap(image, u, v, cv2.INTER_LINEAR), dtype=np.float64)
    falls = profiles[:, -1] < profiles[:, 0]
    profiles[falls] = 255.0 - profiles[falls]
    slope = float(np.gradient(np.median(profiles, axis=0), _STEP).max())
    return contrast / (slope * math.sqrt(2.0 * math.pi)) if slope > 0.0 else math.inf
