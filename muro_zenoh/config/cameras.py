"""From a camera's settings to its model.

Not imported by the package: an agent, which has no pictures, needs no numpy.
"""

from __future__ import annotations

from collections.abc import Mapping

from muro_zenoh.config.sections import CalibrationSettings, CameraSettings
from muro_zenoh.errors import ConfigError, ParameterError
from muro_zenoh.geometry import Bounds
from muro_zenoh.optics.camera_model import NO_DISTORTION, CameraModel, calibrated, hung
from muro_zenoh.optics.plane import fit_plane

_MARGIN = 0.25
"""Margin of floor around the arena that a camera without a place of its own sees [m]."""
_HEIGHT = 3.0
"""Height of such a camera [m]."""


def camera_models(cameras: Mapping[str, CameraSettings], arena: Bounds) -> dict[str, CameraModel]:
    """The models of all cameras, by name.

    Args:
        cameras: their settings.
        arena: the floor.

    Raises:
        ConfigError: points that do not determine a camera, or a lens that no camera has.
    """
    return {name: camera_model(name, settings, arena) for name, settings in cameras.items()}


def camera_model(name: str, settings: CameraSettings, arena: Bounds) -> CameraModel:
    """The model of a camera.

    Args:
        name: of the camera, for errors.
        settings: its settings.
        arena: the floor.

    Raises:
        ConfigError: points that do not determine a camera, or a lens that no camera has.
    """
    width, height = settings.width, settings.height
    if settings.views:
        return fit_plane(settings.views, width, height, camera=name)
    try:
        if settings.calibration is not None:
            return calibrated_model(settings.calibration)
        x, y = 0.5 * (arena.x_min + arena.x_max), 0.5 * (arena.y_min + arena.y_max)
        return hung(
            width,
            height,
            position=(
                x if settings.x is None else settings.x,
                y if settings.y is None else settings.y,
                _HEIGHT if settings.z is None else settings.z,
            ),
            tilt=settings.tilt or 0.0,
            heading=settings.heading or 0.0,
            fov=settings.fov,
            sees=arena.shrunk(-_MARGIN),
            distortion=_five(settings.distortion or NO_DISTORTION),
        )
    except ParameterError as error:
        what = f"camera.{name}.{error.what}"
        raise ConfigError(what, got=error.got, expected=error.expected, hint=error.hint) from None


def calibrated_model(settings: CalibrationSettings) -> CameraModel:
    """The model of a camera that was calibrated.

    Args:
        settings: its calibration.

    Raises:
        ParameterError: a lens that no camera has.
    """
    (fx, fy), (cx, cy) = settings.focal, settings.centre
    (x, y, z), (rx, ry, rz) = settings.position, settings.rotation
    return calibrated(
        settings.width,
        settings.height,
        focal=(fx, fy),
        centre=(cx, cy),
        distortion=_five(settings.distortion),
        position=(x, y, z),
        rotation=(rx, ry, rz),
    )


def _five(distortion: tuple[float, ...]) -> tuple[float, float, float, float, float]:
    k1, k2, p1, p2, k3 = distortion
    return k1, k2, p1, p2, k3
