"""Reads the file of a lens or of a calibrated camera on its own, outside a fleet file."""

from __future__ import annotations

from pathlib import Path

from muro_zenoh.config.files import parse_file
from muro_zenoh.config.origin import Origin
from muro_zenoh.config.reading import read_section
from muro_zenoh.config.sections import CalibrationSettings, LensSettings
from muro_zenoh.errors import ConfigError


def read_calibration_file(path: Path) -> LensSettings:
    """A lens; a :class:`CalibrationSettings` when the file has the camera's place too.

    Args:
        path: the TOML file.

    Raises:
        ConfigError: no such file, or wrong values in it.
    """
    table = parse_file(path)
    origin = Origin(path.name)
    kind = CalibrationSettings if "position" in table or "rotation" in table else LensSettings
    settings = read_section(kind, table, origin, "")
    if len(settings.lens_covariance) not in (0, 9):
        got = f"{len(settings.lens_covariance)} rows"
        raise ConfigError(origin.at("lens_covariance"), got=got, expected="nine rows of nine numbers")
    return settings
