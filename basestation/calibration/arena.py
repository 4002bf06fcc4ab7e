"""Where a camera hangs, from points with known places: floor tags, or points that were clicked."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from basestation.calibration.camera import ALL, LENS, Camera, project
from basestation.calibration.floor_error import floor_slopes
from basestation.calibration.least_squares import fit
from basestation.calibration.lens_prior import LensPrior
from basestation.localization.floor_map import FloorMap
from muro_zenoh.errors import CalibrationError
from muro_zenoh.wording import counted

Array = NDArray[np.float64]

_WRONG: Final = 9.0
"""Greatest sum of squared residuals per degree of freedom that measuring by hand may have: three times its accuracy."""
_LEAST_WRONG: Final = 0.25
"""A point is to blame when without it the sum of squares falls below this part."""
_SIZE_OFF: Final = 0.06
"""Greatest relative error of a floor tag's side; blur and ink make less."""


class Landmark(NamedTuple):
    """A point with a known place.

    Attributes:
        name: of it, for people.
        pixel: (2,) where it is seen [px].
        place: (3,) where it is [m, world].
    """

    name: str
    pixel: Array
    place: Array


@dataclass(frozen=True, slots=True, eq=False)
class ArenaFit:
    """A camera that was placed.

    Attributes:
        camera: the camera; its lens was adjusted, too, within what its calibration left open.
        covariance: (15, 15) of its numbers, inflated by ``inflation``.
        off: (N,) how far from its place on the floor each point is seen [m].
        inflation: so many times greater than expected are the squared errors of points that the fit did not see; at
            least 1.
    """

    camera: Camera
    covariance: Array
    off: Array
    inflation: float


def fit_arena(lens: LensPrior, points: Sequence[Landmark], *, sigma_pixels: float, sigma_metres: float) -> ArenaFit:
    """The place of a camera.

    Args:
        lens: the camera's lens.
        points: at least four, well apart and not on a line.
        sigma_pixels: standard deviation of where a point is seen [px].
        sigma_metres: of how its place was measured [m].

    Raises:
        CalibrationError: too few points, points on a line, or one with another place than was given; with its name.
    """
    if len(points) < 4:
        names = ", ".join(point.name for point in points) or "none"
        raise CalibrationError(
            f"got {counted(len(points), 'point')} with known places in the picture ({names}), expected at least 4, "
            "better 6. Are the tags uncovered, flat and lit, and their numbers and --family right?"
        )
    _check_shape(points)
    problem = _Problem(lens, sigma_pixels, sigma_metres)
    try:
        camera, covariance, misfit = problem.solve(points)
    except CalibrationError as error:
        swapped = _swaps(problem, points)
        raise CalibrationError(f"{min(swapped)[1]}. Check their numbers") if swapped else error from None
    off = _off(camera, points)
    if misfit > _WRONG:
        _blame(problem, points, misfit, off)
    return _inflated(problem, points, camera, covariance, misfit, off)


def check_sides(camera: Camera, corners: dict[str, Array], sizes: dict[str, float], heights: dict[str, float]) -> None:
    """Refuse floor tags that are not as large as was said.

    Args:
        camera: the placed camera.
        corners: (4, 2) of each tag [px].
        sizes: of their sides [m].
        heights: of them above the floor [m].

    Raises:
        CalibrationError: a tag with another side; with its name.
    """
    for name, quad in corners.items():
        side = side_on_floor(camera, quad, heights[name])
        if abs(side / sizes[name] - 1.0) > _SIZE_OFF:
            raise CalibrationError(
                f"{name} has a side of {1e3 * side:.0f} mm on the floor, expected {1e3 * sizes[name]:.0f} mm: the side "
                "of its black square. Measure it: is the print scaled, are the places in metres, or is it --tag-size?"
            )


def side_on_floor(camera: Camera, quad: Array, height: float) -> float:
    """Mean side of a square that lies level.

    Args:
        camera: the placed camera.
        quad: (4, 2) its corners, one after the other [px].
        height: of it above the floor [m].
    """
    places = FloorMap(camera.model).to_metres(quad, height)
    return float(np.hypot(*(places - np.roll(places, 1, axis=0)).T).mean())


class _Problem:
    """The least squares of points and of the lens's own calibration."""

    def __init__(self, lens: LensPrior, sigma_pixels: float, sigma_metres: float) -> None:
        self.lens = lens.camera
        self.prior = lens.whiten
        self.sigma_pixels = sigma_pixels
        self.sigma_metres = sigma_metres

    def solve(self, points: Sequence[Landmark]) -> tuple[Camera, Array, float]:
        """Camera, covariance of its numbers, and the sum of squares per degree of freedom."""
        places = np.array([point.place for point in points])
        pixels = np.array([point.pixel for point in points])
        result = fit(self._start(places, pixels), lambda c: self._evaluate(c, places, pixels), Camera.adjusted)
        scale = np.sqrt(np.diag(result.information))
        covariance = np.linalg.pinv(result.information / np.outer(scale, scale), hermitian=True)
        free = max(2 * len(points) - 6, 1)
        squares = float(result.residuals @ result.residuals)
        return result.state, covariance / np.outer(scale, scale), squares / free

    def weights(self, by_point: Array) -> Array:
        """(N, 2, 2): they make the error of a point's pixel and of its measured place a unit normal variable."""
        flat = by_point[:, :, :2]
        noise = self.sigma_pixels**2 * np.eye(2) + self.sigma_metres**2 * flat @ flat.transpose(0, 2, 1)
        return np.linalg.inv(np.linalg.cholesky(noise)).astype(np.float64)

    def _evaluate(self, camera: Camera, places: Array, pixels: Array) -> tuple[Array, Array]:
        seen, by_camera, by_point = project(camera, places)
        weights = self.weights(by_point)
        residuals = (weights @ (seen - pixels)[..., None]).ravel()
        slopes = (weights @ by_camera).reshape(-1, ALL)
        prior = np.concatenate((self.prior, np.zeros((LENS, ALL - LENS))), axis=1)
        return (
            np.concatenate((residuals, self.prior @ (camera.lens - self.lens.lens))),
            np.concatenate((slopes, prior)),
        )

    def _start(self, places: Array, pixels: Array) -> Camera:
        """The better of OpenCV's solutions, for pixels without the lens."""
        rays = self.lens.model.rays(pixels)
        _, turns, shifts, _ = cv2.solvePnPGeneric(places, rays, np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP)
        found: list[tuple[bool, float, int, Camera]] = []
        for turn, shift in zip(turns, shifts, strict=True):
            rotation = np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64)
            camera = Camera(self.lens.width, self.lens.height, self.lens.lens, rotation, np.ravel(shift))
            ahead = (places @ rotation.T + camera.shift)[:, 2] > 0.0
            above = float(-(rotation.T @ camera.shift)[2]) > float(places[:, 2].mean())
            if ahead.all():
                off = float(np.hypot(*(project(camera, places).pixels - pixels).T).mean())
                found.append((not above, off, len(found), camera))
        if not found:
            raise CalibrationError(
                "no camera sees the points like this. Are x and y swapped, or the places mirrored? "
                "Seen from above, y is to the left of x"
            )
        return min(found)[3]


def _check_shape(points: Sequence[Landmark]) -> None:
    places = np.array([point.place[:2] for point in points])
    _, (long, short), _ = np.linalg.svd(places - places.mean(axis=0), full_matrices=False)
    if not short > 0.1 * long:
        raise CalibrationError(
            "the points are on a line or nearly so, expected them all over the floor that the camera sees. "
            "Lay them into the corners"
        )
    for first, second in itertools.combinations(points, 2):
        if math.dist(first.place, second.place) < 0.05 or math.dist(first.pixel, second.pixel) < 5.0:
            raise CalibrationError(
                f"{first.name} and {second.name} are at the same place, expected each point at a place of its own"
            )


def _off(camera: Camera, points: Sequence[Landmark]) -> Array:
    """How far from its place each point is seen, at its height [m]."""
    places = np.array([point.place for point in points])
    seen, _, by_point = project(camera, places)
    pixels = np.array([point.pixel for point in points])
    off: Array = np.hypot(*np.linalg.solve(by_point[:, :, :2], (pixels - seen)[..., None])[..., 0].T)
    return off


def _blame(problem: _Problem, points: Sequence[Landmark], misfit: float, off: Array) -> None:
    """Name the point that does not fit, or the two that were swapped."""
    fits = _swaps(problem, points)
    if len(points) > 4:
        for k, point in enumerate(points):
            rest = [*points[:k], *points[k + 1 :]]
            try:
                camera, _, left = problem.solve(rest)
            except CalibrationError:
                continue
            # With few points left there are few to contradict each other.
            if left < max(_WRONG / 2.0, 1.0):
                x, y = _seen_at(camera, point)
                told = f"{point.place[0]:.2f}, {point.place[1]:.2f} m"
                fits.append((left, f"{point.name} is at {x:.2f}, {y:.2f} m by the other points, expected {told}"))
    table = ", ".join(f"{point.name} {1e3 * each:.0f} mm" for point, each in zip(points, off, strict=True))
    if not fits or min(fits)[0] > _LEAST_WRONG * misfit:
        more = "With a fifth point the wrong one could be named. " if len(points) == 4 else ""
        raise CalibrationError(
            f"the points contradict each other: {table} off. {more}Measure their places again, in metres, and check "
            "which is which; is it the right lens file?"
        )
    raise CalibrationError(f"{min(fits)[1]}. Check its number, and measure it again. (All together: {table} off)")


def _swaps(problem: _Problem, points: Sequence[Landmark]) -> list[tuple[float, str]]:
    """The pairs of points that fit when their places are swapped, with the sum of squares that is left."""
    fits = []
    for i, j in itertools.combinations(range(len(points)), 2):
        swapped = list(points)
        swapped[i] = points[i]._replace(place=points[j].place)
        swapped[j] = points[j]._replace(place=points[i].place)
        try:
            left = problem.solve(swapped)[2]
        except (CalibrationError, np.linalg.LinAlgError):
            continue
        if left < _WRONG / 2.0:
            names = f"{points[i].name} and {points[j].name}"
            fits.append((left, f"the places of {names} are swapped: with the other's place each, all fit"))
    return fits


def _seen_at(camera: Camera, point: Landmark) -> tuple[float, float]:
    x, y = FloorMap(camera.model).to_metres(point.pixel, point.place[2]).tolist()
    return x, y


def _inflated(
    problem: _Problem, points: Sequence[Landmark], camera: Camera, covariance: Array, misfit: float, off: Array
) -> ArenaFit:
    """The fit with the covariance that points which it did not see allow (leave one out)."""
    ratios = [misfit]
    if len(points) > 4:
        for k, point in enumerate(points):
            other, spread, _ = problem.solve([*points[:k], *points[k + 1 :]])
            place = point.place[None]
            slopes = floor_slopes(other, place[:, :2], float(point.place[2]))[0]
            _, _, by_point = project(other, place)
            weight = problem.weights(by_point)[0]
            own = np.linalg.inv(weight @ by_point[0, :, :2])
            expected = slopes @ spread @ slopes.T + own @ own.T
            ratios.append(float(_off(other, [point])[0] ** 2 / np.trace(expected)))
    inflation = max(1.0, misfit, float(np.mean(ratios[1:] or ratios)))
    return ArenaFit(camera, inflation * covariance, off, inflation)
