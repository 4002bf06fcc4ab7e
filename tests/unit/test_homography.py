import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from basestation.localization.floor_map import FloorMap
from muro_zenoh.errors import ConfigError
from muro_zenoh.geometry import Bounds, View
from muro_zenoh.optics.plane import fit_plane
from tests.support.cameras import straight_down_view

CORNERS = np.array([[-2.1, -1.5], [2.1, -1.5], [2.1, 1.5], [-2.1, 1.5]])


def tilted(pitch: float, roll: float = 0.1, height: float = 3.0, focal: float = 900.0) -> np.ndarray:
    """Metres to pixels of a pinhole camera over the origin that leans towards +y by ``pitch``."""
    down = np.diag([1.0, -1.0, -1.0])  # camera x right, y down, z towards the floor
    c, s = math.cos(pitch), math.sin(pitch)
    lean = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    cr, sr = math.cos(roll), math.sin(roll)
    turn = np.array([[cr, -sr, 0.0], [sr, cr, 0.0], [0.0, 0.0, 1.0]])
    rotation = turn @ lean @ down
    translation = -rotation @ np.array([0.0, 0.0, height])
    intrinsics = np.array([[focal, 0.0, 639.5], [0.0, focal, 359.5], [0.0, 0.0, 1.0]])
    return intrinsics @ np.column_stack((rotation[:, 0], rotation[:, 1], translation))


def seen(matrix: np.ndarray, places: np.ndarray) -> list[View]:
    h = np.column_stack((places, np.ones(len(places)))) @ matrix.T
    return [View(u, v, x, y) for (u, v), (x, y) in zip((h[:, :2] / h[:, 2:]).tolist(), places.tolist(), strict=True)]


def fitted(views: Sequence[View]) -> FloorMap:
    return FloorMap(fit_plane(views, 1280, 720, camera="north"))


def residual(homography: FloorMap, views: list[View]) -> float:
    """Root mean square of the distance between seen and projected points [px]."""
    table = np.array(views)
    error = homography.to_pixels(table[:, 2:]) - table[:, :2]
    return float(np.sqrt((error**2).sum(axis=1).mean()))


@given(
    pitch=st.floats(-0.6, 0.6),
    roll=st.floats(-math.pi, math.pi),
    x=st.floats(-2.0, 2.0),
    y=st.floats(-1.4, 1.4),
)
def test_four_points_recover_all_positions_of_a_tilted_camera(pitch: float, roll: float, x: float, y: float) -> None:
    matrix = tilted(pitch, roll)
    homography = fitted(seen(matrix, CORNERS))
    (view,) = seen(matrix, np.array([[x, y]]))
    assert homography.to_metres(np.array([view.u, view.v])) == pytest.approx([x, y], abs=2e-5)
    assert homography.to_pixels(np.array([x, y])) == pytest.approx([view.u, view.v], abs=1e-2)


def test_straight_down_the_scale_is_one_everywhere() -> None:
    homography = fitted(straight_down_view(Bounds(-2.1, 2.1, -1.5, 1.5), 1280, 720, margin=0.1))
    assert homography.to_metres(np.array([639.5, 359.5])) == pytest.approx([0.0, 0.0], abs=1e-6)
    far = homography.to_metres(np.array([[0.0, 0.0], [1279.0, 719.0]]))
    assert far[1] - far[0] == pytest.approx(np.array([1279.0, -719.0]) * 3.2 / 720, abs=1e-5)


def test_more_points_than_four_average_their_errors() -> None:
    rng = np.random.default_rng(4)
    grid = np.stack(np.meshgrid(np.linspace(-2.0, 2.0, 7), np.linspace(-1.4, 1.4, 5)), axis=-1).reshape(-1, 2)
    noisy = [
        v._replace(u=v.u + du, v=v.v + dv)
        for v, (du, dv) in zip(seen(tilted(0.4), grid), rng.normal(0.0, 0.5, (35, 2)), strict=True)
    ]
    many = fitted(noisy)
    corners = [noisy[i] for i in (0, 6, 34, 28)]
    four = fitted(corners)
    exact = seen(tilted(0.4), grid)
    pixels, places = np.array(exact)[:, :2], np.array(exact)[:, 2:]

    def error(h: FloorMap) -> float:
        return float(np.sqrt(((h.to_metres(pixels) - places) ** 2).mean()))

    assert error(many) < 0.7 * error(four)
    assert residual(four, corners) == pytest.approx(0.0, abs=1e-3)
    # 70 numbers less the 8 that the fit takes: sqrt(2 * 0.5^2 * 62 / 70) = 0.665.
    assert residual(many, noisy) == pytest.approx(0.665, rel=0.25)


def test_pixels_above_the_horizon_and_places_behind_the_camera_are_nowhere() -> None:
    homography = fitted(seen(tilted(1.0), CORNERS + np.array([0.0, 4.0])))
    assert np.isnan(homography.to_metres(np.array([640.0, -600.0]))).all()
    assert np.isfinite(homography.to_metres(np.array([640.0, 700.0]))).all()
    assert np.isnan(homography.to_pixels(np.array([0.0, -30.0]))).all()


def test_more_points_than_four_are_fitted_in_pixels() -> None:
    """Pixels are what has the noise: a fit in metres would trust the far end of the floor as much as the near one."""
    rng = np.random.default_rng(9)
    grid = np.stack(np.meshgrid(np.linspace(-2.0, 2.0, 5), np.linspace(-1.4, 3.0, 6)), axis=-1).reshape(-1, 2)
    exact = np.array(seen(tilted(0.8), grid))
    pixels = exact[:, :2] + rng.normal(0.0, 1.0, (30, 2))
    views = [View(*row) for row in np.column_stack((pixels, grid)).tolist()]

    def error(entries: np.ndarray) -> np.ndarray:
        h = np.column_stack((grid, np.ones(30))) @ np.append(entries, 1.0).reshape(3, 3).T
        return (h[:, :2] / h[:, 2:] - pixels).ravel()

    matrix = tilted(0.8)
    best = least_squares(error, (matrix / matrix[2, 2]).ravel()[:8], x_scale="jac", xtol=1e-14, ftol=1e-14)
    least = math.sqrt(2.0 * best.cost / 30)
    assert residual(fitted(views), views) == pytest.approx(least, rel=1e-4)


@pytest.mark.parametrize("towards", [0.0, 1.0, 2.0, -2.5])
def test_the_world_may_have_its_origin_behind_the_camera(towards: float) -> None:
    """Behind it, or beside it: what the camera has before it is on the floor, and the origin is nowhere."""
    corners = CORNERS + np.array([0.0, 4.0])
    turn = np.array([[math.cos(towards), -math.sin(towards)], [math.sin(towards), math.cos(towards)]])
    views = seen(tilted(1.0), corners)
    behind = turn @ np.array([0.0, -9.0])  # from the camera's foot to the world's origin, in the world's axes
    places = corners @ turn.T - behind
    homography = fitted([view._replace(x=x, y=y) for view, (x, y) in zip(views, places.tolist(), strict=True)])
    for view, place in zip(views, places, strict=True):
        assert homography.to_metres(np.array([view.u, view.v])) == pytest.approx(place, abs=1e-4)
        assert homography.to_pixels(place) == pytest.approx([view.u, view.v], abs=1e-2)
    assert np.isnan(homography.to_pixels(np.zeros(2))).all()


class TestRefusals:
    @pytest.mark.parametrize(
        ("views", "problem"),
        [
            (straight_down_view(Bounds(0, 4, 0, 3), 640, 480)[:3], "3 points"),
            ([View(10 * i, 20 * i, 0.1 * i, 0.2 * i) for i in range(6)], "collinear"),
            ([View(5, 5, 1, 1)] * 4, "collinear"),
            # Three of four in a line.
            ([View(0, 0, 0, 0), View(100, 0, 1, 0), View(200, 0, 2, 0), View(0, 100, 0, -1)], "collinear"),
            # In a line on the floor, yet not in the picture.
            ([View(0, 0, 0, 0), View(100, 0, 1, 0), View(150, 90, 2, 0), View(0, 100, 3, 0)], "collinear"),
            # Nearly so: a tenth of a pixel decides.
            ([View(0, 0, 0, 0), View(500, 0.05, 1, 0), View(1000, 0, 2, 0), View(500, 500, 1, -1)], "collinear"),
            ([View(math.nan, 0, 0, 0), *straight_down_view(Bounds(0, 4, 0, 3), 640, 480)], "nan"),
        ],
    )
    def test_points_without_a_homography_are_refused_with_the_camera(self, views: list[View], problem: str) -> None:
        with pytest.raises(ConfigError, match=problem) as refusal:
            fitted(views)
        assert str(refusal.value).startswith("camera north: points")

    def test_two_swapped_points_are_refused(self) -> None:
        a, b, c, d = straight_down_view(Bounds(0, 4, 0, 3), 640, 480)
        swapped = [a, View(b.u, b.v, c.x, c.y), View(c.u, c.v, b.x, b.y), d]
        with pytest.raises(ConfigError, match="folded"):
            fitted(swapped)

    def test_y_measured_downwards_is_refused(self) -> None:
        mirrored = [view._replace(y=-view.y) for view in straight_down_view(Bounds(0, 4, 0, 3), 640, 480)]
        with pytest.raises(ConfigError, match="mirrored"):
            fitted(mirrored)
