"""Rendered views of a calibration board."""

from __future__ import annotations

import numpy as np

from basestation.calibration.board import Board
from muro_zenoh.optics.camera_model import CameraModel, rotation_matrix
from muro_zenoh.simulation.board_view import BoardCamera

Picture = np.ndarray
TEXELS = 24  # a square's side


def board_pictures(
    model: CameraModel,
    board: Board,
    count: int,
    seed: int,
    *,
    tilt: float = 0.6,
    spread: float = 1.0,
    blurred: dict[int, float] | None = None,
) -> list[Picture]:
    """Pictures of a board that a hand moves about.

    Args:
        model: the camera.
        board: what is held.
        count: of the pictures.
        seed: of places and noise.
        tilt: of the board, at most [rad].
        spread: how far about, in the picture.
        blurred: standard deviation of the blur by picture [px].
    """
    rng = np.random.default_rng(seed)
    lens, texture = BoardCamera(model), board.picture(TEXELS)
    size = np.array((board.columns, board.rows)) * board.square
    pictures = []
    for k in range(count):
        distance = rng.uniform(0.85, 1.25) * model.focal[0] * size[0] / (0.5 * model.width)
        around = np.array((model.width, model.height)) * 0.5 + spread * 0.28 * rng.uniform(-1, 1, 2) * (
            model.width,
            model.height,
        )
        ray = model.rays(around)
        angles = tilt * rng.uniform(-1, 1, 2)
        turn = rotation_matrix((angles[0], angles[1], 0.0)) @ rotation_matrix((0.0, 0.0, rng.uniform(-0.4, 0.4)))
        middle = distance * np.array((*ray, 1.0))
        shift = middle - turn @ np.array((*(0.5 * size), 0.0))
        blur = (blurred or {}).get(k, 0.7)
        pictures.append(lens.render(texture, board.square / TEXELS, turn, shift, rng, blur=blur))
    return pictures
