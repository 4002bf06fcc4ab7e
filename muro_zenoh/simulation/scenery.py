"""What a simulated camera's pictures have without any robot: the floor, its light, and the sensor's noise."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]

FLOOR: Final = 165
"""Mean grey level of the floor."""
BANK: Final = 96
"""A noise crop starts at one of 96 rows and columns: 9216 different frames."""


def draw_floor(width: int, height: int, rng: np.random.Generator) -> Picture:
    """Light that falls off towards the corners and one side, and a speckle of two grain sizes.

    Args:
        width: of the picture [px].
        height: of the picture [px].
        rng: draws it.
    """
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    u, v = u / width - 0.5, v / height - 0.5
    floor: NDArray[np.float32] = FLOOR + 25.0 * u - 12.0 * v - 50.0 * (u * u + v * v)
    for grain, strength in ((1.5, 5.0), (12.0, 5.0)):
        speckle = rng.standard_normal((height, width), dtype=np.float32)
        grains = cv2.GaussianBlur(speckle, (0, 0), grain)
        floor += strength / float(grains.std() or 1.0) * grains
    drawn: Picture = np.clip(np.rint(floor), 0, 255).astype(np.uint8)
    return drawn


def draw_light(width: int, height: int, rng: np.random.Generator, shade: float) -> Picture:
    """The light [1/255], with one dark place, somewhere.

    Args:
        width: of the picture [px].
        height: of the picture [px].
        rng: draws it.
        shade: fraction of the light that is missing there.
    """
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    at_u, at_v = rng.uniform(0.0, 1.0, 2) * (width, height)
    reach = 0.35 * width
    dark = np.exp(-0.5 * ((u - at_u) ** 2 + (v - at_v) ** 2) / reach**2)
    light: Picture = np.rint(255.0 * (1.0 - shade * dark)).astype(np.uint8)
    return light


def draw_noise(width: int, height: int, rng: np.random.Generator, noise: float) -> tuple[Picture, Picture] | None:
    """Noise to add and noise to subtract, as bytes: two saturating passes, no signed arithmetic.

    Args:
        width: of the picture [px].
        height: of the picture [px].
        rng: draws it.
        noise: its standard deviation [grey levels].

    Returns:
        Two pictures that are larger than the camera's by ``BANK``; None for no noise.
    """
    if noise <= 0.0:
        return None
    shape = (height + BANK, width + BANK)
    grey = np.rint(noise * rng.standard_normal(shape, dtype=np.float32))
    return grey.clip(0, 255).astype(np.uint8), (-grey).clip(0, 255).astype(np.uint8)
