"""The gaps of many rings at once, for the lock-step rollout."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from muro_zenoh.elementwise import Array
from muro_zenoh.geometry import TWO_PI


def array_gaps(
    angles: Array, clockwise: bool, eligible: NDArray[np.bool_] | None = None
) -> tuple[Array, Array, NDArray[np.intp]]:
    """Gap ahead, gap behind and count for whole arrays of rings, without the hysteresis; ties are broken by index.

    Args:
        angles: angles seen from the centre [rad], shape ``[..., robots]``; each ring is one row.
        clockwise: the direction of travel.
        eligible: which robots are on the ring, same shape; all when None.

    Returns:
        Gap to the successor and from the predecessor [rad], shape ``[..., robots]``, 2 pi each for robots that are not
        on the ring; number of robots on the ring, shape ``[..., 1]``.
    """
    travelled = np.mod(-angles if clockwise else angles, TWO_PI)
    if eligible is not None:
        travelled = np.where(eligible, travelled, np.inf)
        count = eligible.sum(axis=-1, keepdims=True)
    else:
        count = np.full((*angles.shape[:-1], 1), angles.shape[-1])
    index = np.argsort(travelled, axis=-1, kind="stable")
    ordered = np.take_along_axis(travelled, index, axis=-1)
    place = np.broadcast_to(np.arange(angles.shape[-1]), angles.shape)
    last = place == count - 1
    successor = np.where(last, 0, np.minimum(place + 1, angles.shape[-1] - 1))
    on_ring = place < count
    with np.errstate(invalid="ignore"):  # inf - inf, off the ring, overwritten below
        ahead = np.take_along_axis(ordered, successor, axis=-1) - ordered + np.where(last, TWO_PI, 0.0)
    ahead = np.where(on_ring, ahead, TWO_PI)
    predecessor = np.where(place == 0, np.maximum(count - 1, 0), place - 1)
    behind = np.where(on_ring, np.take_along_axis(ahead, predecessor, axis=-1), TWO_PI)
    gap, gap_behind = np.empty_like(travelled), np.empty_like(travelled)
    np.put_along_axis(gap, index, ahead, axis=-1)
    np.put_along_axis(gap_behind, index, behind, axis=-1)
    return gap, gap_behind, count
