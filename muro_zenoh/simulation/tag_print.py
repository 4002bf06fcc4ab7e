"""Tags as printed and mounted on robots: cells, paper, corners."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from muro_zenoh.geometry import TagMount

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

BLACK: Final = 30
"""Grey level of a tag's ink."""
WHITE: Final = 225
"""Grey level of a tag's paper."""
TEXELS: Final = 8
"""A cell's side in the texture [texels]: a cell is 4 to 10 pixels wide in a picture, so linear sampling hardly aliases.
"""
QUIET: Final = 1
"""Cells of white paper around a tag's black border."""
SQUARE: Final = np.array(((-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)))
"""(4, 2) corners of a tag of side 2 in its own frame: as printed, the upper left one, then clockwise."""


class TagPrints:
    """The prints of one family.

    Args:
        family: name of the tags' dictionary in OpenCV, such as ``DICT_4X4_50`` or ``DICT_APRILTAG_36h11``.

    Attributes:
        paper: side of the white paper, in sides of the tag's black square.

    Raises:
        ValueError: an unknown family.
    """

    def __init__(self, family: str) -> None:
        self._family = family
        self._dictionary = tag_dictionary(family)
        self._textures: dict[int, Picture] = {}
        cells = self._dictionary.markerSize + 2
        self.paper = (cells + 2 * QUIET) / cells

    def texture(self, tag: int) -> Picture:
        """A print with its paper, ``TEXELS`` pixels a cell.

        Args:
            tag: its number.

        Raises:
            ValueError: the family has no such tag.
        """
        if tag not in self._textures:
            count = len(self._dictionary.bytesList)
            if not 0 <= tag < count:
                raise ValueError(f"tag {tag}, expected 0 to {count - 1}: {self._family} has {count} tags")
            cells = self._dictionary.markerSize + 2
            bits = cv2.aruco.generateImageMarker(self._dictionary, tag, cells, borderBits=1)
            levels = np.where(np.pad(bits, QUIET, constant_values=255) > 0, WHITE, BLACK).astype(np.uint8)
            self._textures[tag] = np.kron(levels, np.ones((TEXELS, TEXELS), dtype=np.uint8))
        return self._textures[tag]


def corners_in_world(pose: Array, mount: TagMount, border: float = 0.0) -> Array:
    """A tag's corners in the world, for a pose of its robot.

    Args:
        pose: (3,) x [m], y [m], theta [rad] of the base frame in the world.
        mount: the tag on the robot.
        border: margin on each side [m].

    Returns:
        (4, 2) [m, world]: as printed, the upper left corner, then clockwise.
    """
    half = 0.5 * mount.size + border
    in_base = turned(half * SQUARE, np.asarray(mount.yaw)) + np.array((mount.x, mount.y))
    return turned(in_base, pose[2]) + pose[:2]


def tag_dictionary(family: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary of tags by its name.

    Args:
        family: its name, such as ``DICT_4X4_50`` or ``DICT_APRILTAG_36h11``.

    Raises:
        ValueError: no such dictionary.
    """
    number = getattr(cv2.aruco, family, None) if family.startswith("DICT_") else None
    if not isinstance(number, int):
        known = ", ".join(sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_")))
        raise ValueError(f"tag family {family!r}, expected one of {known}")
    return cv2.aruco.getPredefinedDictionary(number)


def turned(points: Array, angle: Array) -> Array:
    """Points rotated counter-clockwise about the origin.

    Args:
        points: (..., K, 2).
        angle: (...) [rad].

    Returns:
        (..., K, 2).
    """
    c, s = np.cos(angle), np.sin(angle)
    result: Array = points @ np.stack((np.stack((c, s), axis=-1), np.stack((-s, c), axis=-1)), axis=-2)
    return result
