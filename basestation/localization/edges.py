"""Follows tags from one picture to the next: their sides in the grey levels, and their print, cell by cell."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from basestation.localization.markers import Marker, Picture

Array = NDArray[np.float64]

_REACH = 4
"""A side is looked for so far from where it is expected [px] ..."""
_NEAR = 2.0
"""... and only believed so far from there: of one at the end of the reach the half would be missing."""
_CELL = 4.0
"""In tags with smaller cells [px] the print's own edges would be taken for the sides."""
_STEP = 15.0
"""A side is at least such a step from ink to paper [grey levels] ..."""
_CROOKED = 0.35
"""... and straight: the greatest root mean square distance from a line [px]."""
_CONTRAST = 30.0
"""Paper is brighter than ink by this [grey levels]."""

_ALONG = np.linspace(-0.38, 0.38, 8, dtype=np.float32)
"""Where a side is looked at, from its middle, in its length: the corners are rounded by blur."""
_ACROSS = np.arange(-_REACH, _REACH + 1, dtype=np.float32)
_BETWEEN = 0.5 * (_ACROSS[:-1] + _ACROSS[1:])
_LINE = np.stack((np.full_like(_ALONG, 1.0 / len(_ALONG)), _ALONG / (_ALONG @ _ALONG)), axis=1)
"""Offsets at these places times this: the offset of a side's middle, and how it changes along the side."""


_AHEAD, _BEFORE = [1, 2, 3, 0], [3, 0, 1, 2]


class EdgeReader:
    """Finds tags again whose corners are known within a few pixels, all of them at once.

    Each side is where the grey levels rise from ink to paper, at eight places along it, and a corner is where two sides
    meet. That is as exact as the search of a detector and several times faster, but it knows nothing of what it was not
    asked for: a tag is only found again when each cell of its print is as it must be.

    Args:
        family: name of the tags' dictionary in OpenCV.
    """

    def __init__(self, family: str) -> None:
        self._dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, family))
        self._cells = int(self._dictionary.markerSize) + 2
        middles = (np.arange(self._cells) + 0.5) / self._cells
        right, down = (axis.ravel() for axis in np.meshgrid(middles, middles))
        # Of the four corners, clockwise from the upper left one: the weights that give each cell's middle.
        self._middles = np.stack(((1 - right) * (1 - down), right * (1 - down), right * down, (1 - right) * down), 1)
        self._prints: dict[int, NDArray[np.bool_]] = {}

    def find_again(self, image: Picture, expected: Sequence[Marker]) -> list[Marker | None]:
        """The tags that are where they are expected.

        Args:
            image: (height, width), grey.
            expected: tags with their expected corners.

        Returns:
            For each the tag as it is in the picture; None where it is not, or is not clearly seen.
        """
        if not expected:
            return []
        corners = np.stack([marker.corners for marker in expected])
        found, sharp = self._fit_sides(image, corners)
        prints = np.stack([self._print(marker.id) for marker in expected])
        good = sharp & self._is_printed(image, found, prints)
        return [
            Marker(marker.id, each) if is_good else None
            for marker, each, is_good in zip(expected, found, good.tolist(), strict=True)
        ]

    def _fit_sides(self, image: Picture, corners: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Corners (N, 4, 2) where the sides meet, and whether all four sides of a tag are clear."""
        ahead = corners[:, _AHEAD]
        side = ahead - corners
        length = np.sqrt((side * side).sum(axis=2))
        # Clockwise in a picture whose v points down: the left of the way is outside.
        normal = np.stack((side[..., 1], -side[..., 0]), axis=2) / np.maximum(length, 1e-9)[..., None]
        middle = 0.5 * (corners + ahead)
        on_side = middle[:, :, None] + _ALONG[:, None] * side[:, :, None]
        places = on_side[:, :, :, None].astype(np.float32) + _ACROSS[:, None] * normal[:, :, None, None].astype(
            np.float32
        )
        rise = np.diff(_grey(image, places), axis=3)
        np.maximum(rise, 0.0, out=rise)
        rise *= rise
        total = rise.sum(axis=3)
        offset = (rise @ _BETWEEN) / np.maximum(total, 1e-9)
        line = (offset @ _LINE).astype(np.float64)
        mean, slope = line[..., :1], line[..., 1:]
        residual = offset - mean - slope * _ALONG
        straight = (residual * residual).mean(axis=2) < _CROOKED**2
        near = np.abs(line) @ (1.0, 0.5) < _NEAR
        clear = straight & near & (total.min(axis=2) > _STEP**2) & (length > _CELL * self._cells)
        starts = middle + (mean - 0.5 * slope) * normal - 0.5 * side
        return _meet(starts, side + slope * normal), clear.all(axis=1)

    def _is_printed(self, image: Picture, corners: Array, prints: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Whether each cell is on its side of the middle between ink and paper."""
        places = self._middles @ (corners if np.isfinite(corners).all() else np.nan_to_num(corners))
        cells = _grey(image, places)
        paper = np.where(prints, cells, 0.0).sum(axis=1) / prints.sum(axis=1)
        ink = np.where(prints, 0.0, cells).sum(axis=1) / (~prints).sum(axis=1)
        as_printed = (cells > 0.5 * (paper + ink)[:, None]) == prints
        good: NDArray[np.bool_] = as_printed.all(axis=1) & (paper - ink > _CONTRAST)
        return good

    def _print(self, number: int) -> NDArray[np.bool_]:
        """Which cells of a tag are paper, row by row, with its border."""
        if number not in self._prints:
            drawn = cv2.aruco.generateImageMarker(self._dictionary, number, self._cells)
            self._prints[number] = np.asarray(drawn).ravel() > 127
        return self._prints[number]


def _grey(image: Picture, places: NDArray[np.floating]) -> NDArray[np.float32]:
    """Grey levels (...) at places (..., 2) between pixels; outside the picture those of its edge."""
    rows = places.astype(np.float32, copy=False).reshape(-1, places.shape[-2], 2)
    u, v = np.ascontiguousarray(rows[..., 0]), np.ascontiguousarray(rows[..., 1])
    levels = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(levels, dtype=np.float32).reshape(places.shape[:-1])


def _meet(starts: Array, ways: Array) -> Array:
    """Where each line (N, 4, 2) crosses the one before it."""
    before, along = starts[:, _BEFORE], ways[:, _BEFORE]
    gap = before - starts
    cross = ways[..., 0] * along[..., 1] - ways[..., 1] * along[..., 0]
    share = (gap[..., 0] * along[..., 1] - gap[..., 1] * along[..., 0]) / np.where(cross == 0.0, np.nan, cross)
    met: Array = starts + share[..., None] * ways
    return met
