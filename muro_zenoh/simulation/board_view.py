"""A calibration board in a camera's picture."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from muro_zenoh.optics.camera_model import CameraModel, rotation_matrix

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

_FINER = 2  # rendered so much finer than the picture, and averaged: edges are grey as in a sensor
_BACKGROUND = 120.0
_DARK, _LIGHT = 30.0, 215.0


class BoardCamera:
    """Renders a flat print that is held into the picture.

    Args:
        model: the camera; the board's places are in the camera's own frame, whatever its place in the world is.
    """

    def __init__(self, model: CameraModel) -> None:
        self.model = model
        rows, columns = np.mgrid[0 : _FINER * model.height, 0 : _FINER * model.width].astype(np.float64)
        fine = np.stack((columns, rows), axis=-1)
        self._rays = model.rays((fine + 0.5) / _FINER - 0.5).astype(np.float32)

    def render(
        self,
        texture: Picture,
        square: float,
        turn: Array,
        shift: Array,
        rng: np.random.Generator,
        *,
        blur: float = 0.7,
        noise: float = 2.5,
    ) -> Picture:
        """The picture of the print.

        Args:
            texture: the print, grey.
            square: side of a texel [m].
            turn: (3, 3) from the board's frame (from its upper left corner, x right, y down) to the camera's.
            shift: (3,) the board's origin in the camera's frame [m].
            rng: draws the noise.
            blur: standard deviation of the optics' blur [px].
            noise: standard deviation of the sensor's noise [grey levels].
        """
        # A texel's centre is at an integer, and its edge half a texel before.
        to_board = np.array(((square, 0.0, 0.5 * square), (0.0, square, 0.5 * square), (0.0, 0.0, 1.0)))
        seen = np.column_stack((turn[:, 0], turn[:, 1], shift)) @ to_board
        texels = cv2.perspectiveTransform(self._rays, np.linalg.inv(seen))
        texels = np.nan_to_num(texels, nan=-1e4).clip(-1e4, 3e4)
        ink = _DARK + (_LIGHT - _DARK) / 255.0 * texture.astype(np.float32)
        fine = cv2.remap(
            ink,
            np.ascontiguousarray(texels[..., 0]),
            np.ascontiguousarray(texels[..., 1]),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=_BACKGROUND,
        )
        size = (self.model.width, self.model.height)
        picture = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)
        if blur > 0.0:
            picture = cv2.GaussianBlur(picture, (0, 0), blur)
        noisy = np.asarray(picture) + rng.normal(0.0, noise, picture.shape)
        exposed: Picture = np.rint(noisy).clip(0, 255).astype(np.uint8)
        return exposed


def hold_board(
    model: CameraModel,
    texture: Picture,
    texel: float,
    count: int,
    seed: int,
    *,
    tilt: float = 0.6,
    spread: float = 1.0,
    blurred: Mapping[int, float] | None = None,
) -> list[Picture]:
    """Pictures of a board that a hand moves about.

    Args:
        model: the camera.
        texture: the print, grey.
        texel: side of one of its texels [m].
        count: of the pictures.
        seed: of places and noise.
        tilt: of the board, at most [rad].
        spread: how far about, 1 for all of the picture.
        blurred: standard deviation of the blur by number of the picture [px]; 0.7 for the others.
    """
    rng = np.random.default_rng(seed)
    lens = BoardCamera(model)
    size = texel * np.array(texture.shape[::-1])
    picture = np.array((model.width, model.height))
    pictures = []
    for k in range(count):
        distance = rng.uniform(1.7, 2.5) * model.focal[0] * size[0] / model.width
        ray = model.rays(0.5 * picture + 0.28 * spread * rng.uniform(-1.0, 1.0, 2) * picture)
        across, down = (tilt * rng.uniform(-1.0, 1.0, 2)).tolist()
        turn = rotation_matrix((across, down, 0.0)) @ rotation_matrix((0.0, 0.0, rng.uniform(-0.4, 0.4)))
        shift = distance * np.array((*ray, 1.0)) - turn @ np.array((*(0.5 * size), 0.0))
        pictures.append(lens.render(texture, texel, turn, shift, rng, blur=(blurred or {}).get(k, 0.7)))
    return pictures
