"""Corners of tags from the edges of their black squares, for measuring.

Each side is a line through the places where the picture is halfway between ink and paper, by the part of a profile that
is ink: no blur makes the tag larger or smaller, and a tag of 17 pixels will do. The base station, which follows many
tags at 20 Hz, has a quicker way (``basestation.localization.edges``) that refuses tags below 24 pixels. On rendered
tags of 32 pixels with a blur of 1.2 its sides are 0.05 % short and its corners 0.061 px off, here 0.003 % and 0.056 px:
no matter for a pose, but for a scale.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from basestation.localization.markers import Marker, Picture

Array = NDArray[np.float64]

_ALONG: Final = np.linspace(0.12, 0.88, 16)
"""Where along a side it is looked at, in sides: not at the corners, which blur rounds."""
_REACH: Final = 0.09
"""How far to both sides of it, in sides: ink and paper are at least an eighth of a side wide."""
_STEPS: Final = 33
_TWICE: Final = 2  # the second time along the edges that were found


def on_edges(image: Picture, marker: Marker) -> Marker | None:
    """A tag with its corners where its edges meet; None when an edge is not clear: it would be too small.

    Args:
        image: (height, width), grey.
        marker: as the detector found it.
    """
    corners = marker.corners
    for _ in range(_TWICE):
        found = _meet(image, corners)
        if found is None:
            return None
        corners = found
    return Marker(marker.id, corners)


def _meet(image: Picture, corners: Array) -> Array | None:
    along = np.roll(corners, -1, axis=0) - corners
    sides = np.hypot(*along.T)
    out = np.column_stack((along[:, 1], -along[:, 0])) / sides[:, None]  # clockwise, and v down: out of the tag
    reach = max(_REACH * float(sides.mean()), 1.5)
    offsets = np.linspace(-reach, reach, _STEPS)
    on_side = corners[:, None] + _ALONG[:, None] * along[:, None]  # (4, 16, 2)
    places = on_side[:, :, None] + offsets[:, None] * out[:, None, None]
    height, width = image.shape
    if not ((places > 0.0) & (places < (width - 1.0, height - 1.0))).all():
        return None
    u, v = (np.ascontiguousarray(places[..., k].reshape(4, -1), dtype=np.float32) for k in (0, 1))
    levels = np.asarray(cv2.remap(image, u, v, cv2.INTER_LINEAR), dtype=np.float64).reshape(4, len(_ALONG), _STEPS)
    ink, paper = levels[..., :4].mean(axis=2), levels[..., -4:].mean(axis=2)
    contrast = paper - ink
    if np.median(contrast) < 20.0:
        return None
    # The part of a profile that is ink is as long as the edge is far from its inner end.
    with np.errstate(divide="ignore", invalid="ignore"):
        inked = ((paper[..., None] - levels) / contrast[..., None]).clip(-0.2, 1.2).mean(axis=2)
    shift = (2.0 * inked - 1.0) * reach * _STEPS / (_STEPS - 1.0)
    good = (contrast > 0.5 * np.median(contrast)) & (np.abs(shift) < 0.8 * reach)
    if (good.sum(axis=1) < len(_ALONG) // 2).any():
        return None
    lines = []
    for side in range(4):
        points = on_side[side][good[side]] + shift[side][good[side]][:, None] * out[side]
        middle = points.mean(axis=0)
        normal = np.linalg.svd(points - middle, full_matrices=False)[2][1]
        lines.append((*normal, normal @ middle))
    before = np.roll(np.array(lines), 1, axis=0)
    pairs = zip(before, lines, strict=True)
    return np.array([np.linalg.solve(np.stack((a[:2], b[:2])), (a[2], b[2])) for a, b in pairs])
