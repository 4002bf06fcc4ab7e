"""Lenses and calibrations as TOML files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from basestation.calibration.camera import LENS, Camera, camera_of
from basestation.calibration.lens_prior import LensPrior
from muro_zenoh.config.calibration_file import read_calibration_file
from muro_zenoh.config.cameras import calibrated_model
from muro_zenoh.config.sections import CalibrationSettings, LensSettings
from muro_zenoh.errors import CalibrationError
from muro_zenoh.optics.camera_model import rotation_vector

Array = NDArray[np.float64]

_GUESSED = np.array((3.0, 3.0, 3.0, 3.0, 3e-3, 3e-3, 3e-4, 3e-4, 3e-3))
"""Standard deviations of a lens that comes without any, such as one that somebody else calibrated."""


def write_lens(path: Path, camera: Camera, covariance: Array, notes: Sequence[str]) -> None:
    """Write a lens.

    Args:
        path: the file.
        camera: the camera with the lens.
        covariance: (9, 9) of it.
        notes: comments for people, at the top.

    Raises:
        CalibrationError: the file cannot be written.
    """
    _write(path, notes, _lens_lines(camera), covariance)


def write_camera(
    path: Path,
    camera: Camera,
    covariance: Array,
    notes: Sequence[str],
    floor_tags: Mapping[int, Iterable[float]] = MappingProxyType({}),
) -> None:
    """Write the calibration of a camera, as ``calibration = "FILE"`` in the fleet file names it.

    Args:
        path: the file.
        camera: the camera.
        covariance: (15, 15) of it, or (9, 9) of its lens.
        notes: comments for people, at the top.
        floor_tags: x, y, z, the place of each tag on the floor by which it was calibrated, by number [m, world].

    Raises:
        CalibrationError: the file cannot be written.
    """
    rows = ", ".join(_row((number, *where), 4) for number, where in sorted(floor_tags.items()))
    place = (
        f"position = {_row(camera.model.position, 6)} # [m, world]",
        f"rotation = {_row(rotation_vector(camera.turn), 9)} # rotation vector, world to camera [rad]",
        f"floor_tags = [{rows}] # number, x, y, z [m, world]: while they lie there they show whether it was moved",
    )
    _write(path, notes, (*_lens_lines(camera), *place), covariance[:LENS, :LENS])


def read_lens(path: Path) -> LensPrior:
    """A lens, from its own file or from a camera's calibration.

    Args:
        path: the file.

    Raises:
        ConfigError: no such file, or something else in it.
    """
    return lens_of(read_calibration_file(path))


def lens_of(settings: LensSettings) -> LensPrior:
    """A lens.

    Args:
        settings: its file, or a camera's calibration.
    """
    lens = np.array((*settings.focal, *settings.centre, *settings.distortion))
    camera = Camera(settings.width, settings.height, lens, np.eye(3), np.zeros(3))
    return LensPrior(camera, _covariance(settings))


def placed_camera(settings: CalibrationSettings) -> Camera:
    """A camera with its place.

    Args:
        settings: its calibration.
    """
    return camera_of(calibrated_model(settings))


def _covariance(settings: LensSettings) -> Array:
    if not settings.lens_covariance:
        covariance: Array = np.diag(_GUESSED**2)
        return covariance
    return np.array(settings.lens_covariance, dtype=np.float64)


def _lens_lines(camera: Camera) -> tuple[str, ...]:
    return (
        f"width = {camera.width}",
        f"height = {camera.height}",
        f"focal = {_row(camera.lens[:2], 4)} # [px]",
        f"centre = {_row(camera.lens[2:4], 4)} # [px]",
        f"distortion = {_row(camera.lens[4:], 9)} # k1, k2, p1, p2, k3",
    )


def _write(path: Path, notes: Sequence[str], lines: Iterable[str], covariance: Array) -> None:
    rows = ",\n".join(f"  [{', '.join(f'{number:.6e}' for number in row)}]" for row in covariance.tolist())
    comments = [f"# {note}" for note in notes]
    text = "\n".join((*comments, *lines, "# of focal, centre and distortion", f"lens_covariance = [\n{rows},\n]", ""))
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be written ({error.strerror}). Choose another --out") from error


def _row(numbers: Iterable[float], digits: int) -> str:
    return f"[{', '.join(f'{float(number):.{digits}f}' for number in numbers)}]"
