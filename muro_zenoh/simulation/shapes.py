"""The shapes of robots that a camera sees: a round body with a mark, and a tag on top."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from muro_zenoh.geometry import TagMount
from muro_zenoh.simulation.tag_print import SQUARE, TagPrints, turned

Array = NDArray[np.float64]


def _body(count: int) -> Array:
    """Two discs of radius 1 as polygons, at foot and top, and a mark that points forwards, for human viewers."""
    angles = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)
    mark = ((0.72, 0.16), (0.95, 0.0), (0.72, -0.16))
    disc = np.column_stack((np.cos(angles), np.sin(angles)))
    return np.concatenate((disc, disc, mark))


DISC: Final = 40  # corners: 0.1 px from a circle of 40 px radius
_BODY_OUTLINE: Final = _body(DISC)
PAPER: Final = len(_BODY_OUTLINE)  # the first of the paper's corners among the outlines


class Shapes:
    """What is constant between pictures of the same robots.

    Args:
        prints: the tags' prints.
        mounts: the robots' tags.
        radii: of their bodies [m].

    Attributes:
        mounts: the robots' tags.
        radii: of their bodies [m].
        outlines: (N, 87, 2) feet, bodies, marks and papers in the base frames [m].
        heights: (N, 87) above the floor [m].
        textures: N, the tags' prints.
        texels_to_base: (N, 4, 3) from homogeneous texels to homogeneous metres in the base frames.
    """

    def __init__(self, prints: TagPrints, mounts: list[TagMount], radii: list[float]) -> None:
        self.mounts = mounts
        self.radii = radii
        count = len(mounts)
        half = np.array([0.5 * mount.size * prints.paper for mount in mounts]).reshape(count, 1, 1)
        yaw = np.array([mount.yaw for mount in mounts])
        offset = np.array([(mount.x, mount.y) for mount in mounts]).reshape(count, 1, 2)
        papers = turned(half * SQUARE, yaw) + offset
        bodies = np.array(radii).reshape(count, 1, 1) * _BODY_OUTLINE
        self.outlines: Array = np.concatenate((bodies, papers), axis=1)
        self.heights: Array = np.array([mount.z for mount in mounts]).reshape(count, 1).repeat(PAPER + 4, axis=1)
        self.heights[:, :DISC] = 0.0
        self.textures = [prints.texture(mount.id) for mount in mounts]
        self.texels_to_base: Array = np.zeros((count, 4, 3))
        for matrix, mount, paper, texture in zip(self.texels_to_base, mounts, papers, self.textures, strict=True):
            upper_left, upper_right, _, lower_left = paper
            right, down = (upper_right - upper_left) / len(texture), (lower_left - upper_left) / len(texture)
            # The upper left corner of the paper is at (-0.5, -0.5).
            matrix[:2] = np.column_stack((right, down, upper_left + 0.5 * (right + down)))
            matrix[2:, 2] = mount.z, 1.0
