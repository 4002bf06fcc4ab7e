"""Places a camera with a known lens over the floor, from marks whose places are known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from basestation.localization.floor_map import FloorMap
from muro_zenoh.errors import CameraError
from muro_zenoh.geometry import Bounds
from muro_zenoh.optics.camera_model import CameraModel, calibrated

Array = NDArray[np.float64]

_FEWEST = 4
_NAMED = 6  # so many marks are needed to find the wrong one among them
_WRONG = 0.010
"""A mark that is this far from where the camera sees it is wrong [m] ..."""
_CLEAR = 3.0
"""... and it is the one, when without it the others agree so many times better."""
_CLICK = 0.3
"""Least standard deviation of a mark's pixels that is believed [px]: four points always agree with each other."""
_95 = 2.448
"""Radius, in standard deviations, of the circle that holds 95 % of a normal distribution in two dimensions."""


class Mark(NamedTuple):
    """A point with a known place: its ``name``, its pixel ``u``, ``v`` and its place ``x``, ``y``, ``z`` [m, world]."""

    name: str
    u: float
    v: float
    x: float
    y: float
    z: float = 0.0


class Placement(NamedTuple):
    """Where a camera is.

    ``camera``: the camera with its place; ``errors``: how far each mark is from where the camera sees it [m];
    ``sigma``: standard deviation of the marks' pixels [px]; ``covariance``: (6, 6) of the rotation vector [rad] and
    the translation [m], from the world's to the camera's frame.
    """

    camera: CameraModel
    errors: tuple[float, ...]
    sigma: float
    covariance: Array


def place_camera(lens: CameraModel, marks: Sequence[Mark], *, camera: str) -> Placement:
    """Place a camera over the floor.

    Args:
        lens: a camera with the lens; where it is makes no difference.
        marks: at least four, not in one line; from six on a wrong one is found.
        camera: its name, for errors.

    Raises:
        CameraError: too few marks, marks in one line, or marks that contradict each other: with the wrong one's name,
            where that can be known.
    """
    if len(marks) < _FEWEST:
        raise CameraError(f"camera {camera}: got {len(marks)} marks, expected at least {_FEWEST}, far apart")
    spread = np.linalg.svd(_places(marks)[:, :2] - _places(marks)[:, :2].mean(axis=0), compute_uv=False)
    if spread[1] < 0.05 * spread[0]:
        raise CameraError(f"camera {camera}: got marks in one line, expected marks in the corners of what it sees")
    placed = _solve(lens, marks)
    worst = max(placed.errors)
    if worst < _WRONG:
        return placed
    if len(marks) >= _NAMED:
        rest = {mark.name: max(_solve(lens, [m for m in marks if m is not mark]).errors) for mark in marks}
        name = min(rest, key=lambda each: rest[each])
        if rest[name] < _WRONG and _CLEAR * rest[name] < worst:
            without = _solve(lens, [mark for mark in marks if mark.name != name])
            wrong = next(mark for mark in marks if mark.name == name)
            off = _errors(without.camera, [wrong])[0]
            raise CameraError(
                f"camera {camera}: mark {name} is {1e3 * off:.0f} mm from where the {len(rest) - 1} others put it, "
                f"which agree to {1e3 * rest[name]:.1f} mm. Is it mislabelled, or mistyped? Correct it, or leave it out"
            )
    raise CameraError(
        f"camera {camera}: the marks contradict each other by {1e3 * worst:.0f} mm, expected less than "
        f"{1e3 * _WRONG:.0f} mm. Are two swapped, or is the lens another one? Of {_NAMED} marks a wrong one is found"
    )


def bounds_on_floor(placed: Placement, arena: Bounds, cell: float = 0.5) -> list[list[float]]:
    """How wrong places may be, because of where the camera is taken to be.

    Args:
        placed: the camera.
        arena: the floor.
        cell: side of a cell [m].

    Returns:
        Rows from the upper edge of the arena down, of cells from its left edge to the right: the bound that holds with
        95 % [m]; NaN for a cell whose middle the camera does not see.
    """
    floor = FloorMap(placed.camera)
    columns, rows = math.ceil(arena.width / cell - 1e-9), math.ceil(arena.height / cell - 1e-9)
    x = arena.x_min + cell * (np.arange(columns) + 0.5)
    y = arena.y_max - cell * (np.arange(rows) + 0.5)
    middles = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    pixels = floor.to_pixels(middles)
    seen = floor.margin(np.nan_to_num(pixels, nan=-1e6)) > 0.0
    slopes = np.stack([_shift(placed.camera, k, pixels) for k in range(6)], axis=-1)
    spread = slopes @ placed.covariance @ slopes.transpose(0, 2, 1)
    largest = np.linalg.eigvalsh(np.nan_to_num(spread))[:, 1]
    bound = np.where(seen, _95 * np.sqrt(np.maximum(largest, 0.0)), np.nan)
    return [row.tolist() for row in bound.reshape(rows, columns)]


def _places(marks: Sequence[Mark]) -> Array:
    return np.array([mark[3:] for mark in marks], dtype=np.float64)


def _solve(lens: CameraModel, marks: Sequence[Mark]) -> Placement:
    places, pixels = _places(marks), np.array([mark[1:3] for mark in marks], dtype=np.float64)
    distortion = np.array(lens.distortion)
    flat = bool(np.ptp(places[:, 2]) < 1e-6)
    # The minimum is found from a closed solution for marks in a plane, else from OpenCV's linear one.
    method = cv2.SOLVEPNP_IPPE if flat else cv2.SOLVEPNP_SQPNP
    good, rotation, shift = cv2.solvePnP(places, pixels, lens.matrix, distortion, flags=method)
    if not good:
        raise CameraError(f"got {len(marks)} marks from which no place of the camera follows, expected marks far apart")
    rotation, shift = cv2.solvePnPRefineLM(places, pixels, lens.matrix, distortion, rotation, shift)
    turn, move = (np.asarray(each, dtype=np.float64).ravel() for each in (rotation, shift))
    found, jacobian = cv2.projectPoints(places, turn, move, lens.matrix, distortion)
    residual = np.asarray(found)[:, 0] - pixels
    free = residual.size - 6
    sigma = max(math.sqrt(float((residual**2).sum()) / free) if free > 0 else 0.0, _CLICK)
    slopes = np.asarray(jacobian, dtype=np.float64)[:, :6]
    covariance: Array = (sigma * sigma * np.linalg.inv(slopes.T @ slopes)).astype(np.float64)
    camera = _with_pose(lens, turn, move)
    return Placement(camera, _errors(camera, marks), sigma, covariance)


def _with_pose(lens: CameraModel, rotation: Array, shift: Array) -> CameraModel:
    turn = np.asarray(cv2.Rodrigues(rotation)[0], dtype=np.float64)
    x, y, z = (-turn.T @ shift).tolist()
    rx, ry, rz = rotation.tolist()
    return calibrated(
        lens.width,
        lens.height,
        focal=lens.focal,
        centre=lens.centre,
        distortion=lens.distortion,
        position=(x, y, z),
        rotation=(rx, ry, rz),
    )


def _errors(camera: CameraModel, marks: Sequence[Mark]) -> tuple[float, ...]:
    places = _places(marks)
    pixels = np.array([mark[1:3] for mark in marks], dtype=np.float64)
    off = FloorMap(camera).to_metres(pixels, places[:, 2]) - places[:, :2]
    return tuple(np.hypot(off[:, 0], off[:, 1]).tolist())


def _shift(camera: CameraModel, parameter: int, pixels: Array) -> Array:
    """How places on the floor move with one parameter of the camera's pose (N, 2)."""
    step = 1e-5
    vector = np.asarray(cv2.Rodrigues(camera.view[:, :3])[0], dtype=np.float64).ravel()
    moved = []
    for sign in (1.0, -1.0):
        pose = np.concatenate((vector, camera.view[:, 3]))
        pose[parameter] += sign * step
        moved.append(FloorMap(_with_pose(camera, pose[:3], pose[3:])).to_metres(pixels))
    slope: Array = (moved[0] - moved[1]) / (2.0 * step)
    return slope
