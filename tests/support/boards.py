"""Rendered views of a calibration board."""

from __future__ import annotations

from typing import Any

import numpy as np

from basestation.calibration.board import Board
from muro_zenoh.optics.camera_model import CameraModel
from muro_zenoh.simulation.board_view import hold_board

_TEXELS = 24  # a square's side


def board_pictures(model: CameraModel, board: Board, count: int, seed: int, **more: Any) -> list[np.ndarray]:
    """Pictures of a board that a hand moves about.

    Args:
        model: the camera.
        board: what is held.
        count: of the pictures.
        seed: of places and noise.
        more: as for ``hold_board``.
    """
    return hold_board(model, board.picture(_TEXELS), board.square / _TEXELS, count, seed, **more)
