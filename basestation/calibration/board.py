"""The ChArUco board: a chessboard whose white squares have tags, so that each corner has a number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray

from muro_zenoh.errors import ParameterError
from muro_zenoh.quantities import Length, Quantity, check_quantities
from muro_zenoh.simulation.tag_print import tag_dictionary

Picture = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Board:
    """A board; by default it fits on a sheet of A4. Its tags are of a family that robots do not use.

    Args:
        columns: of squares.
        rows: of squares.
        square: side of a square [m].
        marker: side of a tag [m].
        family: of the tags, as OpenCV names it.

    Raises:
        ParameterError: a number outside its limits, or tags that do not fit into the squares.
        ValueError: an unknown family.
    """

    columns: Annotated[int, Quantity(at_least=4, at_most=30, whole=True)] = 9
    rows: Annotated[int, Quantity(at_least=4, at_most=30, whole=True)] = 6
    square: Length = 0.03
    marker: Length = 0.022
    family: str = "DICT_5X5_100"

    def __post_init__(self) -> None:
        check_quantities(self)
        if not self.marker < 0.9 * self.square:
            raise ParameterError(
                "marker", got=f"{self.marker:g} m", expected=f"below 0.9 of a square of {self.square:g} m"
            )
        tags, known = self.columns * self.rows // 2, len(tag_dictionary(self.family).bytesList)
        if tags > known:
            raise ParameterError(
                "board", got=f"{self.columns} x {self.rows} squares", expected=f"at most {known} tags: {self.family}"
            )

    @property
    def corners(self) -> int:
        """Number of the chessboard's inner corners."""
        return (self.columns - 1) * (self.rows - 1)

    def charuco(self) -> cv2.aruco.CharucoBoard:
        """The board as OpenCV has it."""
        size = (self.columns, self.rows)
        return cv2.aruco.CharucoBoard(size, self.square, self.marker, tag_dictionary(self.family))

    def picture(self, pixels: int) -> Picture:
        """The print.

        Args:
            pixels: side of a square [px].
        """
        size = (self.columns * pixels, self.rows * pixels)
        return np.asarray(self.charuco().generateImage(size, marginSize=0, borderBits=1), dtype=np.uint8)
