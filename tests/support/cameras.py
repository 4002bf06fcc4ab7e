"""Cameras for tests."""

from __future__ import annotations

from muro_zenoh.geometry import Bounds, View
from muro_zenoh.optics.camera_model import CameraModel
from muro_zenoh.optics.plane import fit_plane


def straight_down_view(bounds: Bounds, width: int, height: int, margin: float = 0.0) -> tuple[View, View, View, View]:
    """Four points of a camera that looks straight down and sees a whole rectangle with square pixels.

    Args:
        bounds: the rectangle.
        width: of the picture [px].
        height: of the picture [px].
        margin: minimum visible margin beyond each edge [m].

    Returns:
        The rectangle's corners, from the lower left one counter-clockwise. World y is up, the picture's v down.
    """
    seen = bounds.shrunk(-margin)
    metres_per_pixel = max(seen.width / width, seen.height / height)
    x_mid, y_mid = 0.5 * (bounds.x_min + bounds.x_max), 0.5 * (bounds.y_min + bounds.y_max)
    u_mid, v_mid = 0.5 * (width - 1), 0.5 * (height - 1)
    first, second, third, fourth = (
        View(u_mid + (x - x_mid) / metres_per_pixel, v_mid - (y - y_mid) / metres_per_pixel, x, y)
        for x, y in bounds.corners
    )
    return first, second, third, fourth


def plane_camera(bounds: Bounds, width: int, height: int, margin: float = 0.0) -> CameraModel:
    """A camera that looks straight down and is known on the plane of the tags only, by the four points above."""
    return fit_plane(straight_down_view(bounds, width, height, margin), width, height, camera="test")
