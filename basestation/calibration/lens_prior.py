"""What the calibration of a lens knows of it, for what comes after."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from basestation.calibration.camera import LENS, Camera

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class LensPrior:
    """A lens with its covariance.

    Args:
        camera: the camera with the lens; its place makes no difference.
        covariance: (9, 9) of the lens.

    Attributes:
        whiten: (9, 9), makes a difference from this lens unit normal.
    """

    camera: Camera
    covariance: Array
    whiten: Array = field(init=False)

    def __post_init__(self) -> None:
        scale = np.sqrt(np.maximum(np.diag(self.covariance), 1e-24))
        correlation = self.covariance / np.outer(scale, scale) + 1e-9 * np.eye(LENS)
        object.__setattr__(self, "whiten", np.linalg.inv(np.linalg.cholesky(correlation)) / scale)
