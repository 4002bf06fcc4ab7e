"""A first guess for cameras that saw a tag drive about on a level plane."""

from __future__ import annotations

import math
from collections.abc import Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from basestation.calibration.camera import Camera
from basestation.calibration.tag_tracks import Knots
from basestation.localization.floor_map import FloorMap
from basestation.localization.localizer import fit_squares
from muro_zenoh.errors import CalibrationError
from muro_zenoh.geometry import Pose2

Array = NDArray[np.float64]

_COMMON = 6
"""Places that two cameras must have seen the robot in together ..."""
_APART = 0.3
"""... this far apart [m]."""


def above_plane(lens: Camera, quads: Array, size: float, height: float) -> Camera:
    """A camera over the plane that a square of known size was moved in; where on the plane is left open.

    Args:
        lens: the camera with its lens.
        quads: (K, 4, 2) the square's corners [px].
        size: its side [m].
        height: of the plane [m].
    """
    half = 0.5 * size
    square = np.array(((-half, half, 0.0), (half, half, 0.0), (half, -half, 0.0), (-half, -half, 0.0)))
    rays = lens.model.rays(quads)
    normals = []
    for each in rays:
        _, turns, _, _ = cv2.solvePnPGeneric(square, each, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
        normals += [-np.asarray(cv2.Rodrigues(turn)[0])[:, 2] for turn in turns]  # away from the camera
    # Of each pair one is right, and the right ones are parallel.
    candidates = np.array(normals)
    pairs = candidates.reshape(len(rays), -1, 3) @ candidates.T
    best = int(pairs.max(axis=1).sum(axis=0).argmax())
    near = candidates[candidates @ candidates[best] > math.cos(0.15)]
    down = near.mean(axis=0)
    down /= np.linalg.norm(down)
    right = np.cross(down, (0.0, 1.0, 0.0)) if abs(down[1]) < 0.9 else np.cross(down, (1.0, 0.0, 0.0))
    right /= np.linalg.norm(right)
    turn = np.column_stack((right, np.cross(-down, right), -down))
    unit = Camera(lens.width, lens.height, lens.lens, turn, down)
    _, sides, _ = fit_squares(FloorMap(unit.model).to_metres(quads, 0.0))
    distance = size / float(np.median(sides))
    return Camera(lens.width, lens.height, lens.lens, turn, down * (distance + height))


def tag_poses(camera: Camera, quads: Array, height: float) -> list[Pose2]:
    """Where the tag is, by a placed camera.

    Args:
        camera: the camera.
        quads: (K, 4, 2) [px].
        height: of the tag [m].
    """
    return fit_squares(FloorMap(camera.model).to_metres(quads, height))[0]


def in_frame(camera: Camera, pose: Pose2) -> Camera:
    """The camera in another frame.

    Args:
        camera: the camera.
        pose: of the old frame in the new one.
    """
    c, s = math.cos(pose.theta), math.sin(pose.theta)
    turn = camera.turn @ np.array(((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)))
    return Camera(camera.width, camera.height, camera.lens, turn, camera.shift - turn @ np.array((pose.x, pose.y, 0.0)))


def match(old: Array, new: Array) -> Pose2:
    """The pose of an old frame in a new one that brings points together best.

    Args:
        old: (K, 2) in the old frame [m].
        new: (K, 2) the same in the new frame [m].
    """
    z, w = old @ (1.0, 1j), new @ (1.0, 1j)
    theta = float(np.angle(np.vdot(z - z.mean(), w - w.mean())))
    move = w.mean() - np.exp(1j * theta) * z.mean()
    return Pose2(float(move.real), float(move.imag), theta)


def first_guess(lenses: Mapping[str, Camera], knots: Knots, size: float, height: float) -> dict[str, Camera]:
    """All cameras in the frame of the first.

    Args:
        lenses: the cameras with their lenses.
        knots: the drive.
        size: side of the tag [m].
        height: of it above the floor [m].

    Raises:
        CalibrationError: cameras that have not seen the robot together.
    """
    own: dict[str, Camera] = {}
    places: dict[str, Array] = {}
    for name, lens in lenses.items():
        there = knots.seen(name)
        own[name] = above_plane(lens, knots.corners[name][there], size, height)
        places[name] = np.full((len(knots.t), 2), np.nan)
        places[name][there] = [pose[:2] for pose in tag_poses(own[name], knots.corners[name][there], height)]
    first, *left = own
    placed = {first: own[first]}
    while left:
        common = {(name, other): int((knots.seen(name) & knots.seen(other)).sum()) for name in left for other in placed}
        (name, other), count = max(common.items(), key=lambda item: item[1])
        both = knots.seen(name) & knots.seen(other)
        spread = float(np.ptp(places[other][both], axis=0).max()) if count else 0.0
        if count < _COMMON or spread < _APART:
            raise CalibrationError(
                f"cameras {name} and {other} saw the robot together in {count} places within {spread:.2f} m, expected "
                f"{_COMMON} over {_APART} m. Drive along where both see it; do their recordings begin at the same time?"
            )
        pose = match(places[name][both], places[other][both])
        placed[name] = in_frame(own[name], pose)
        seen = knots.seen(name)
        places[name][seen] = [pose.compose(Pose2(x, y, 0.0))[:2] for x, y in places[name][seen]]
        left.remove(name)
    return {name: placed[name] for name in lenses}
