"""The map that several cameras make together: how far off it may be, apart from how it lies in the room."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from basestation.calibration.camera import ALL, Camera, project
from basestation.calibration.drive_start import match
from basestation.calibration.floor_error import FloorError, bound_of, cells_of, floor_slopes, grid, seen
from basestation.localization.floor_map import FloorMap
from muro_zenoh.geometry import Bounds

Array = NDArray[np.float64]


def misfit_covariance(information: Array, misfit: float, count: int) -> Array:
    """The covariance of the first numbers of a fit.

    Args:
        information: of all its numbers.
        misfit: sum of squares per degree of freedom.
        count: how many numbers.
    """
    scale = np.sqrt(np.diag(information))
    inverse = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-13, hermitian=True)
    covariance: Array = misfit * (inverse / np.outer(scale, scale))[:count, :count]
    return covariance


def shared_error(
    cameras: Mapping[str, Camera], covariance: Array, floor: Bounds, height: float, cell: float = 0.5
) -> FloorError:
    """The bound of the best camera in each cell. How the frame lies in the room is not in it.

    Args:
        cameras: the cameras.
        covariance: of all their numbers, in this order.
        floor: the floor to judge.
        height: of the tags above it [m].
        cell: side of a cell [m].
    """
    x, y = cells_of(floor, cell)
    places = grid(x, y)
    slopes, index = shared_slopes(cameras, places, height)
    bound = bound_of(slopes @ covariance @ slopes.transpose(0, 2, 1))
    best = np.full(len(places), np.inf)
    np.minimum.at(best, index, bound)
    best[~np.isfinite(best)] = np.nan
    return FloorError(x, y, best.reshape(len(y), len(x)))


def map_difference(first: Mapping[str, Camera], second: Mapping[str, Camera], places: Array, height: float) -> Array:
    """How far apart two sets of cameras see the same pixels, after their frames were brought together.

    Args:
        first: cameras.
        second: the same cameras elsewhere.
        places: (M, 2) [m, in the frame of the first].
        height: of the tags [m].

    Returns:
        (N, 2) [m]: for each camera, for each place that it sees.
    """
    old, new = [], []
    for name, camera in first.items():
        mine = places[seen(camera, places, height)]
        pixels = project(camera, np.insert(mine, 2, height, axis=1)).pixels
        old.append(mine)
        new.append(FloorMap(second[name].model).to_metres(pixels, height))
    here, there = np.concatenate(old), np.concatenate(new)
    pose = match(there, here)
    c, s = math.cos(pose.theta), math.sin(pose.theta)
    moved = there @ np.array(((c, s), (-s, c))) + (pose.x, pose.y)
    difference: Array = moved - here
    return difference


def shared_slopes(cameras: Mapping[str, Camera], places: Array, height: float) -> tuple[Array, NDArray[np.int64]]:
    """How places move when the cameras' numbers change, apart from motions of the frame.

    Args:
        cameras: the cameras.
        places: (M, 2) [m, world].
        height: of them [m].

    Returns:
        (N, 2, P) by all cameras' numbers, for each camera, for each place that it sees; and (N,) the place's index.
    """
    blocks, indices = [], []
    for k, camera in enumerate(cameras.values()):
        mine = np.flatnonzero(seen(camera, places, height))
        block = np.zeros((len(mine), 2, ALL * len(cameras)))
        block[:, :, ALL * k : ALL * (k + 1)] = floor_slopes(camera, places[mine], height)
        blocks.append(block)
        indices.append(mine)
    slopes, index = np.concatenate(blocks), np.concatenate(indices)
    at = places[index]
    frame = np.zeros((len(at), 2, 3))
    frame[:, 0, 0] = frame[:, 1, 1] = 1.0
    frame[:, 0, 2], frame[:, 1, 2] = -at[:, 1], at[:, 0]
    flat, motions = slopes.reshape(2 * len(at), -1), frame.reshape(-1, 3)
    left = flat - motions @ np.linalg.lstsq(motions, flat, rcond=None)[0]
    return left.reshape(slopes.shape), index
