"""A calibration board in a camera's picture."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from muro_zenoh.optics.camera_model import CameraModel

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
