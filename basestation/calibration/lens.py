"""The lens of a camera from views of a board (Zhang, 2000), judged before it is believed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from basestation.calibration.board_views import BoardView
from basestation.calibration.camera import LENS, Camera, project
from basestation.calibration.floor_error import FloorError, lens_difference, lens_error
from basestation.calibration.views_choice import check_views
from muro_zenoh.errors import CalibrationError, ParameterError

Array = NDArray[np.float64]

_CONTRADICTS: Final = 4.0
"""A view contradicts the others when its corners are off by so many times what they are in the middle of all views."""
_FEWEST: Final = 8
"""Views that a calibration needs."""
_UNSURE: Final = 0.005
"""Greatest relative standard deviation of the focal length."""
_OFF: Final = 1.0
"""Greatest root mean square distance of the corners from where the lens has them [px]."""
_STRETCHED: Final = 0.03
"""Pixels are square: focal lengths that differ by more than this come from a print that was stretched."""


@dataclass(frozen=True, slots=True, eq=False)
class LensFit:
    """A lens that was calibrated.

    Attributes:
        camera: the camera with the lens; its place is the board's frame in the first view.
        covariance: (9, 9) of the lens, inflated by ``inflation``.
        pixels: root mean square distance of the corners from where the lens has them [px].
        inflation: so many times greater than the noise explains is the squared difference between the lenses of one
            half of the views and of the other one; at least 1.
        used: names of the views.
        dropped: why other views were left out.
    """

    camera: Camera
    covariance: Array
    pixels: float
    inflation: float
    used: tuple[str, ...]
    dropped: tuple[str, ...]

    def floor_error(self, height: float) -> FloorError:
        """The bound on the error that the lens makes on the floor.

        Args:
            height: of the camera over the floor [m].
        """
        return lens_error(self.camera, self.covariance, height)


def fit_lens(views: Sequence[BoardView], size: tuple[int, int], *, height: float, drop: bool = False) -> LensFit:
    """The lens that sees a board as views show it.

    Args:
        views: of the board.
        size: width and height of the pictures [px].
        height: of the camera over the floor [m], where the halves of the views are compared.
        drop: leave out views that are blurred or contradict the others, instead of refusing the set.

    Raises:
        CalibrationError: too few views, views that are blurred, alike or contradict the others, or a lens that they do
            not determine; with the names of the views and what to do.
    """
    kept, dropped = check_views(views, size, drop=drop)
    while True:
        _need(kept, dropped)
        solved = _solve(kept, size)
        rms = np.array([np.sqrt((r**2).sum(axis=1).mean()) for r in solved.residuals])
        worst = int(rms.argmax())
        if rms[worst] <= _CONTRADICTS * np.median(rms):
            break
        # One at a time: the worst view pulls at the lens, and what it does to the others is gone without it.
        reason = (
            f"{kept[worst].name} contradicts the other views: its corners are {rms[worst]:.2f} px off, "
            f"those of the others {np.median(rms):.2f} px"
        )
        if not drop:
            raise CalibrationError(
                f"{reason}. Was it taken with another board, zoom or focus, or was the board bent? "
                "Remove this picture, or leave out such views with --drop"
            )
        dropped = (*dropped, reason)
        kept = [*kept[:worst], *kept[worst + 1 :]]
    rms_all = float(np.sqrt((np.concatenate(solved.residuals) ** 2).sum(axis=1).mean()))
    _check_result(solved, rms_all)
    inflation = _disagreement(kept, size, height)
    try:
        _ = solved.camera.model
    except ParameterError as error:
        raise CalibrationError(f"these views give no lens that a camera has: {error}") from None
    names = tuple(view.name for view in kept)
    return LensFit(solved.camera, inflation * solved.covariance, rms_all, inflation, names, tuple(dropped))


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    camera: Camera
    covariance: Array
    residuals: list[Array]


def _check_result(solved: _Solved, rms: float) -> None:
    fx, fy = solved.camera.lens[:2].tolist()
    if rms > _OFF:
        raise CalibrationError(
            f"the corners are {rms:.1f} px off in all views, expected below {_OFF:g} px. Is the board flat, on "
            "something stiff, and printed with the same scale across and down? Measure its squares"
        )
    if abs(fx / fy - 1.0) > _STRETCHED:
        raise CalibrationError(
            f"got a focal length of {fx:.0f} px across and {fy:.0f} px down, expected them within "
            f"{100 * _STRETCHED:g} %. Was the board printed with other scales across and down? Measure its squares"
        )
    sigma = float(np.sqrt(solved.covariance[0, 0]) / fx)
    if sigma > _UNSURE:
        raise CalibrationError(
            f"these views determine the focal length to {100 * sigma:.1f} % only, expected {100 * _UNSURE:g} %. "
            "Take more of them: the board tilted by 20 to 45 degrees, and in all corners of the picture"
        )


def _need(views: Sequence[BoardView], dropped: Sequence[str]) -> None:
    if len(views) < _FEWEST:
        why = "".join(f"\n  {reason}" for reason in dropped)
        raise CalibrationError(
            f"got {len(views)} good views of the board, expected at least {_FEWEST}, better 20. "
            f"Take more: sharp, tilted, in all corners of the picture{'. Left out:' if why else ''}{why}"
        )


def _solve(views: Sequence[BoardView], size: tuple[int, int]) -> _Solved:
    points = [view.points.astype(np.float32) for view in views]
    pixels = [view.pixels.astype(np.float32).reshape(-1, 1, 2) for view in views]
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-9)
    _, matrix, bend, turns, shifts = cv2.calibrateCamera(points, pixels, size, None, None, flags=0, criteria=criteria)
    lens = np.array((matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *np.ravel(bend)[:5]))
    information = np.zeros((LENS, LENS))
    residuals = []
    cameras = []
    for view, turn, shift in zip(views, turns, shifts, strict=True):
        camera = Camera(*size, lens, np.asarray(cv2.Rodrigues(turn)[0]), np.ravel(shift))
        seen, by_camera, _ = project(camera, view.points)
        flat = by_camera.reshape(-1, by_camera.shape[-1])
        # The view's own place is eliminated (the Schur complement).
        inner, place = flat[:, :LENS], flat[:, LENS:]
        left = inner - place @ np.linalg.lstsq(place, inner, rcond=None)[0]
        information += left.T @ left
        residuals.append(seen - view.pixels)
        cameras.append(camera)
    free = sum(r.size for r in residuals) - LENS - 6 * len(views)
    noise = sum(float((r**2).sum()) for r in residuals) / max(free, 1)
    scale = np.sqrt(np.diag(information))
    covariance = noise * np.linalg.pinv(information / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale)
    return _Solved(cameras[0], covariance, residuals)


def _disagreement(views: Sequence[BoardView], size: tuple[int, int], height: float) -> float:
    """How much more the lenses of two halves of the views differ than their covariances allow, in squares.

    A wrong model, such as a bent board, has small covariances, but not the same errors in both halves.
    """
    ratios = []
    for halves in ((views[0::2], views[1::2]), (views[: len(views) // 2], views[len(views) // 2 :])):
        first, second = (_solve(half, size) for half in halves)
        try:
            apart = lens_difference(first.camera, second.camera, height)
        except ParameterError:  # half of the views do not even give a lens
            return 9.0
        bound = lens_error(first.camera, first.covariance + second.covariance, height).bound
        # The bound is 2.45 standard deviations of the worse direction.
        ratios.append(float(((apart**2).sum(axis=-1) / (bound**2 / 3.0)).mean()))
    return max(1.0, float(np.mean(ratios)))
