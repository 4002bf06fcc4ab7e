"""Reads marks, writes calibrations, and draws the heat map of the bound as text."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import cv2

from basestation.calibration.arena import Mark
from muro_zenoh.errors import CameraError
from muro_zenoh.optics.camera_model import CameraModel

_COLUMNS = ("name", "u", "v", "x", "y", "z")


def read_marks(path: Path) -> list[Mark]:
    """Marks of a CSV file with the columns name, u, v [px], x, y and, if not 0, z [m].

    Args:
        path: the file.

    Raises:
        CameraError: no such file, a missing column, a name twice, or a value that is not a finite number.
    """
    try:
        with path.open(newline="") as file:
            rows = list(csv.DictReader(file, skipinitialspace=True))
    except (OSError, UnicodeDecodeError) as error:
        raise CameraError(f"{path}: got {error}, expected a CSV file with {', '.join(_COLUMNS)}") from None
    marks: list[Mark] = []
    for number, row in enumerate(rows, start=2):
        try:
            u, v, x, y, z = (float(row.get(key) or (0.0 if key == "z" else "nothing")) for key in _COLUMNS[1:])
        except ValueError:
            raise CameraError(f"{path}, line {number}: got {row}, expected name, u, v, x, y as numbers") from None
        name = row.get("name") or f"line {number}"
        if not all(map(math.isfinite, (u, v, x, y, z))) or any(mark.name == name for mark in marks):
            raise CameraError(f"{path}, line {number}: got {row}, expected a name of its own and finite numbers")
        marks.append(Mark(name, u, v, x, y, z))
    return marks


def calibration_text(camera: CameraModel, heading: Sequence[str]) -> str:
    """A calibration file.

    Args:
        camera: the calibrated camera.
        heading: lines of comment.
    """
    rotation = cv2.Rodrigues(camera.view[:, :3])[0]
    rows = {
        "focal": camera.focal,
        "centre": camera.centre,
        "distortion": camera.distortion,
        "position": camera.position.tolist(),
        "rotation": rotation.ravel().tolist(),
    }
    lines = [*(f"# {line}" for line in heading), f"width = {camera.width}", f"height = {camera.height}"]
    lines += [f"{key} = [{', '.join(f'{float(number)!r}' for number in row)}]" for key, row in rows.items()]
    return "\n".join(lines) + "\n"


def heat_map(bounds: Sequence[Sequence[float]]) -> str:
    """The bound of each cell in millimetres, from the arena's upper edge down; a dot where the camera does not look.

    Args:
        bounds: rows of cells [m].
    """
    return "\n".join(" ".join(f"{'.' if math.isnan(b) else f'{1e3 * b:.1f}':>6}" for b in row) for row in bounds)
