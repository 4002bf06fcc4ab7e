"""Tags in a picture: their numbers and the pixels of their corners. No metres, no robots."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Marker:
    """A tag that was seen or is expected in a picture.

    Attributes:
        id: its number.
        corners: (4, 2) [px; integers are pixel centres]: as printed, the upper left corner, then clockwise.
    """

    id: int
    corners: Array

    @property
    def centre(self) -> tuple[float, float]:
        """Mean of the corners [px]."""
        (au, av), (bu, bv), (cu, cv), (du, dv) = self.corners.tolist()
        return 0.25 * (au + bu + cu + du), 0.25 * (av + bv + cv + dv)

    @property
    def side(self) -> float:
        """Mean length of the four sides [px]."""
        a, b, c, d = self.corners.tolist()
        return 0.25 * (math.dist(a, b) + math.dist(b, c) + math.dist(c, d) + math.dist(d, a))

    def is_same_as(self, other: Marker) -> bool:
        """Whether both are the same print: the same number at nearly the same position.

        Args:
            other: another marker of the same picture.
        """
        return self.id == other.id and math.dist(self.centre, other.centre) < 0.5 * max(self.side, other.side)

    def moved(self, u: float, v: float) -> Marker:
        """The same tag, shifted.

        Args:
            u: to the right [px].
            v: down [px].
        """
        return Marker(self.id, self.corners + np.array((u, v)))


class TagReader(Protocol):
    """A library that reads tags.

    Attributes:
        family: name of the tags' dictionary in OpenCV.
    """

    family: str

    def read(self, image: Picture, smallest: float, *, hard: bool, crop: bool) -> list[Marker]:
        """The tags in a picture or a part of one.

        Args:
            image: (height, width), grey.
            smallest: side of the smallest tag to find [px].
            hard: whether the picture is dim, blurred or foreign; otherwise it is of a lit room.
            crop: whether one tag fills much of the picture, and may touch its edge.
        """
        ...
