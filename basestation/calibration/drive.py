"""All cameras placed in one frame, from a robot that drove about under them.

A bundle adjustment (Triggs, McLauchlan, Hartley and Fitzgibbon, 2000). Unknown are the cameras, the tag's pose at each
time on the plane at its height, and by how much its print differs from the size that was given. The lenses keep what
their own calibrations know.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from basestation.calibration.camera import ALL, LENS, Camera, project
from basestation.calibration.drive_start import first_guess, in_frame, match, tag_poses
from basestation.calibration.floor_error import FloorError, bound_of, cells_of, floor_slopes, seen
from basestation.calibration.least_squares import Fitted, fit
from basestation.calibration.lens_prior import LensPrior
from basestation.calibration.tag_tracks import Knots
from basestation.localization.floor_map import FloorMap
from muro_zenoh.errors import CalibrationError
from muro_zenoh.geometry import Bounds, Pose2

Array = NDArray[np.float64]

_FEWEST: Final = 12
"""Places of the robot that a camera must have seen."""
_SIZE_OFF: Final = 0.05
"""Greatest relative difference between two measures of the scale: the tag's side, a distance, a camera's height."""
_PRINT: Final = 0.004
"""Relative standard deviation of a tag's side that was measured with a ruler."""
_OUTLIER: Final = 5.0
"""A place is left out when its corners are off by so many times what they are in the middle of all places."""
_ORIGIN: Final = Pose2(0.0, 0.0, 0.0)
_UNIT: Final = np.array(((-0.5, 0.5), (0.5, 0.5), (0.5, -0.5), (-0.5, -0.5)))
_MODEL: Final = 4.0
"""Root mean square error of the corners that no model may exceed, in standard deviations."""


class Distance(NamedTuple):
    """A known distance between two floor tags.

    Attributes:
        metres: between their middles [m].
        sigma: its standard deviation [m].
        pixels: by camera, (2, 2) where it sees their middles [px].
    """

    metres: float
    sigma: float
    pixels: Mapping[str, Array]


@dataclass(frozen=True, slots=True, eq=False)
class DriveFit:
    """Cameras that were placed.

    Attributes:
        cameras: by name.
        covariance: of all their numbers, in the order of ``cameras``.
        pixels: root mean square distance of the corners from where the cameras have them [px].
        inflation: so many times greater than the noise explains is the squared difference between the maps of one half
            of the drive and of the other one; at least 1.
        scale: the tag's true side over the given one.
        left_out: number of places that were left out.
    """

    cameras: dict[str, Camera]
    covariance: Array
    pixels: float
    inflation: float
    scale: float
    left_out: int


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    cameras: tuple[Camera, ...]
    places: Array
    ends: Array
    log_scale: float


class _Bundle:
    """The least squares of a drive."""

    def __init__(
        self,
        priors: Mapping[str, LensPrior],
        knots: Knots,
        size: float,
        height: float,
        sigma_pixels: float,
        distance: Distance | None,
    ) -> None:
        self.names = tuple(priors)
        self.priors = tuple(priors.values())
        self.knots = knots
        self.size = size
        self.height = height
        self.sigma = sigma_pixels
        self.distance = distance
        self.count = len(knots.t)
        self.columns = ALL * len(self.names) + 3 * self.count + (4 if distance else 0) + 1

    def solve(self, cameras: Mapping[str, Camera]) -> Fitted[_State]:
        places = np.full((self.count, 3), np.nan)
        for name, camera in reversed(list(cameras.items())):
            there = self.knots.seen(name)
            places[there] = tag_poses(camera, self.knots.corners[name][there], self.height)
        ends = np.zeros((2, 2))
        if self.distance is not None:
            for name, pixels in self.distance.pixels.items():
                ends = FloorMap(cameras[name].model).to_metres(pixels, 0.0)
        start = _State(tuple(cameras[name] for name in self.names), places, ends, 0.0)
        self.anchor = start.places[0].copy()
        return fit(start, self._evaluate, self._adjust)

    def _adjust(self, state: _State, step: Array) -> _State:
        n = len(self.names)
        cameras = tuple(camera.adjusted(step[ALL * k : ALL * (k + 1)]) for k, camera in enumerate(state.cameras))
        after = ALL * n + 3 * self.count
        places = state.places + step[ALL * n : after].reshape(-1, 3)
        ends = state.ends + step[after : after + 4].reshape(2, 2) if self.distance else state.ends
        return _State(cameras, places, ends, state.log_scale + float(step[-1]))

    def _evaluate(self, state: _State) -> tuple[Array, Array]:
        rows: list[Array] = []
        slopes: list[Array] = []
        n = len(self.names)
        size = self.size * math.exp(state.log_scale)
        c, s = np.cos(state.places[:, 2]), np.sin(state.places[:, 2])
        turn = np.stack((np.stack((c, -s), -1), np.stack((s, c), -1)), -2)
        spokes = size * _UNIT @ turn.transpose(0, 2, 1)  # (K, 4, 2)
        corners = np.insert(spokes + state.places[:, None, :2], 2, self.height, axis=2)
        for k, (name, camera) in enumerate(zip(self.names, state.cameras, strict=True)):
            there = np.flatnonzero(self.knots.seen(name))
            found, by_camera, by_point = project(camera, corners[there].reshape(-1, 3))
            rows.append(((found - self.knots.corners[name][there].reshape(-1, 2)) / self.sigma).ravel())
            block = np.zeros((len(there), 8, self.columns))
            block[:, :, ALL * k : ALL * (k + 1)] = by_camera.reshape(-1, 8, ALL)
            flat = by_point[:, :, :2].reshape(-1, 4, 2, 2)
            around = np.stack((-spokes[there, :, 1], spokes[there, :, 0]), axis=-1)
            by_place = np.concatenate((flat, flat @ around[..., None]), axis=-1).reshape(-1, 8, 3)
            for each in range(3):
                block[np.arange(len(there)), :, ALL * n + 3 * there + each] = by_place[:, :, each]
            block[:, :, -1] = (flat @ spokes[there][..., None]).reshape(-1, 8)
            slopes.append(block.reshape(-1, self.columns) / self.sigma)
            rows.append(self.priors[k].whiten @ (camera.lens - self.priors[k].camera.lens))
            prior = np.zeros((LENS, self.columns))
            prior[:, ALL * k : ALL * k + LENS] = self.priors[k].whiten
            slopes.append(prior)
        self._add_distance(state, rows, slopes)
        # The frame is that of the first place: whatever frame it is, the least squares are the same.
        frame = np.zeros((4, self.columns))
        frame[:3, ALL * n : ALL * n + 3] = 1e3 * np.eye(3)
        frame[3, -1] = 1.0 / _PRINT
        rows.append(np.append(1e3 * (state.places[0] - self.anchor), state.log_scale / _PRINT))
        slopes.append(frame)
        return np.concatenate(rows), np.concatenate(slopes)

    def _add_distance(self, state: _State, rows: list[Array], slopes: list[Array]) -> None:
        if self.distance is None:
            return
        at = ALL * len(self.names) + 3 * self.count
        for name, pixels in self.distance.pixels.items():
            k = self.names.index(name)
            found, by_camera, by_point = project(state.cameras[k], np.insert(state.ends, 2, 0.0, axis=1))
            block = np.zeros((2, 2, self.columns))
            block[:, :, ALL * k : ALL * (k + 1)] = by_camera
            for end in range(2):
                block[end, :, at + 2 * end : at + 2 * end + 2] = by_point[end, :, :2]
            rows.append((found - pixels).ravel() / self.sigma)
            slopes.append(block.reshape(4, -1) / self.sigma)
        between = state.ends[1] - state.ends[0]
        length = float(np.hypot(*between))
        row = np.zeros((1, self.columns))
        row[0, at : at + 4] = np.concatenate((-between, between)) / length / self.distance.sigma
        rows.append(np.array([(length - self.distance.metres) / self.distance.sigma]))
        slopes.append(row)

    def off(self, state: _State) -> dict[str, Array]:
        """By camera, (K,) root mean square distance of the corners [px]; NaN where it did not see them."""
        residuals, _ = self._evaluate(state)
        out: dict[str, Array] = {}
        start = 0
        for name in self.names:
            there = self.knots.seen(name)
            count = 8 * int(there.sum())
            off = np.full(self.count, np.nan)
            squares = (self.sigma * residuals[start : start + count]) ** 2
            off[there] = np.sqrt(squares.reshape(-1, 8).sum(axis=1) / 4.0)
            out[name] = off
            start += count + LENS
        return out


def fit_drive(
    priors: Mapping[str, LensPrior],
    knots: Knots,
    *,
    size: float,
    height: float,
    sigma_pixels: float,
    robot: str,
    distance: Distance | None = None,
    heights: Mapping[str, float] | None = None,
    known: Mapping[str, Camera] | None = None,
    start: Pose2 = _ORIGIN,
    floor: Bounds,
) -> DriveFit:
    """Place all cameras in one frame.

    Args:
        priors: their lenses, by name.
        knots: the drive.
        size: side of the robot's tag [m].
        height: of it above the floor [m].
        sigma_pixels: standard deviation of a corner [px].
        robot: its name, for errors.
        distance: a known distance between two floor tags.
        heights: known heights of cameras above the floor, by name [m].
        known: cameras whose places are known from before, by name: they say how the frame lies in the room.
        start: where the tag was when it was seen first; it says so where no camera is known [world].
        floor: where the halves of the drive are compared [world].

    Raises:
        CalibrationError: a drive that is too short, places that contradict each other, measures of the scale that do,
            or a scale that nothing but the tag's size says.
    """
    if distance is None and not heights:
        raise CalibrationError(
            f"nothing but the size of {robot}'s tag says how large all is, and a wrong size cannot be seen. "
            "Measure the height of a camera's lens above the floor (--height north=2.95), or the distance of two "
            "floor tags (--distance 40,41=2.000)"
        )
    _check_drive(priors, knots, robot)
    guess = first_guess({name: prior.camera for name, prior in priors.items()}, knots, size, height)
    pose = _frame_of(guess, knots, known or {}, start, floor, height)
    guess = {name: in_frame(camera, pose) for name, camera in guess.items()}
    _check_roughly(guess, distance, heights or {}, robot, size, height)
    result, bundle, left_out = _without_outliers(priors, knots, size, height, sigma_pixels, distance, guess)
    state = result.state
    cameras = dict(zip(bundle.names, state.cameras, strict=True))
    pixels = float(np.sqrt(np.nanmean(np.concatenate(list(bundle.off(state).values())) ** 2)))
    _check_scale(cameras, state, heights or {}, robot, size, height)
    free = max(len(result.residuals) - bundle.columns, 1)
    misfit = float(result.residuals @ result.residuals) / free
    covariance = misfit_covariance(result.information, max(misfit, 1.0), ALL * len(cameras))
    fitted = DriveFit(cameras, covariance, pixels, 1.0, math.exp(state.log_scale), left_out)
    inflation = _disagreement(priors, bundle, cameras, floor)
    return replace(fitted, covariance=inflation * covariance, inflation=inflation)


def misfit_covariance(information: Array, misfit: float, count: int) -> Array:
    """The covariance of the first numbers of a fit.

    Args:
        information: of all its numbers.
        misfit: sum of squares per degree of freedom.
        count: how many numbers.
    """
    scale = np.sqrt(np.diag(information))
    inverse = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-13, hermitian=True)
    covariance: Array = misfit * (inverse / np.outer(scale, scale))[:count, :count]
    return covariance


def drive_error(
    cameras: Mapping[str, Camera], covariance: Array, floor: Bounds, height: float, cell: float = 0.5
) -> FloorError:
    """The bound of the best camera in each cell. How the frame lies in the room is not in it.

    Args:
        cameras: the cameras.
        covariance: of all their numbers, in this order.
        floor: the floor to judge.
        height: of the tags above it [m].
        cell: side of a cell [m].
    """
    x, y = cells_of(floor, cell)
    columns, rows = np.meshgrid(x, y)
    places = np.column_stack((columns.ravel(), rows.ravel()))
    slopes, index = _stacked(cameras, places, height)
    bound = bound_of(slopes @ covariance @ slopes.transpose(0, 2, 1))
    best = np.full(len(places), np.inf)
    np.minimum.at(best, index, bound)
    best[~np.isfinite(best)] = np.nan
    return FloorError(x, y, best.reshape(len(y), len(x)))


def map_difference(first: Mapping[str, Camera], second: Mapping[str, Camera], places: Array, height: float) -> Array:
    """How far apart two sets of cameras see the same pixels, after their frames were brought together.

    Args:
        first: cameras.
        second: the same cameras elsewhere.
        places: (M, 2) [m, in the frame of the first].
        height: of the tags [m].

    Returns:
        (N, 2) [m]: for each camera, for each place that it sees.
    """
    old, new = [], []
    for name, camera in first.items():
        mine = places[seen(camera, places, height)]
        pixels = project(camera, np.insert(mine, 2, height, axis=1)).pixels
        old.append(mine)
        new.append(FloorMap(second[name].model).to_metres(pixels, height))
    here, there = np.concatenate(old), np.concatenate(new)
    pose = match(there, here)
    c, s = math.cos(pose.theta), math.sin(pose.theta)
    moved = there @ np.array(((c, s), (-s, c))) + (pose.x, pose.y)
    difference: Array = moved - here
    return difference


def _stacked(cameras: Mapping[str, Camera], places: Array, height: float) -> tuple[Array, NDArray[np.int64]]:
    """Slopes (N, 2, P) of what each camera sees, without motions of the frame, and the indices of the places."""
    blocks, indices = [], []
    for k, camera in enumerate(cameras.values()):
        mine = np.flatnonzero(seen(camera, places, height))
        block = np.zeros((len(mine), 2, ALL * len(cameras)))
        block[:, :, ALL * k : ALL * (k + 1)] = floor_slopes(camera, places[mine], height)
        blocks.append(block)
        indices.append(mine)
    slopes, index = np.concatenate(blocks), np.concatenate(indices)
    at = places[index]
    frame = np.zeros((len(at), 2, 3))
    frame[:, 0, 0] = frame[:, 1, 1] = 1.0
    frame[:, 0, 2], frame[:, 1, 2] = -at[:, 1], at[:, 0]
    flat, motions = slopes.reshape(2 * len(at), -1), frame.reshape(-1, 3)
    left = flat - motions @ np.linalg.lstsq(motions, flat, rcond=None)[0]
    return left.reshape(slopes.shape), index


def _frame_of(
    cameras: Mapping[str, Camera], knots: Knots, known: Mapping[str, Camera], start: Pose2, floor: Bounds, height: float
) -> Pose2:
    """The pose of the cameras' frame in the world."""
    x, y = cells_of(floor, 0.25)
    columns, rows = np.meshgrid(x, y)
    places = np.column_stack((columns.ravel(), rows.ravel()))
    old, new = [], []
    for name, camera in known.items():
        mine = places[seen(camera, places, height)]
        pixels = project(camera, np.insert(mine, 2, height, axis=1)).pixels
        new.append(mine)
        old.append(FloorMap(cameras[name].model).to_metres(pixels, height))
    if old:
        return match(np.concatenate(old), np.concatenate(new))
    name = next(name for name in cameras if knots.seen(name)[0])
    first = tag_poses(cameras[name], knots.corners[name][:1], height)[0]
    return start.compose(first.inverse())


def _check_drive(priors: Mapping[str, LensPrior], knots: Knots, robot: str) -> None:
    for name, prior in priors.items():
        there = knots.seen(name)
        count = int(there.sum())
        if count < _FEWEST:
            raise CalibrationError(
                f"camera {name} saw {robot} in {count} places, expected at least {_FEWEST}. Drive all over what each "
                f"camera sees, slowly; is the tag's number right?"
            )
        middles = knots.corners[name][there].mean(axis=1) / (prior.camera.width, prior.camera.height)
        part = np.ptp(middles, axis=0)
        if min(part) < 0.25 or max(part) < 0.4:
            raise CalibrationError(
                f"all views of camera {name} are alike: {robot} was in {100 * part[0]:.0f} % of the picture's width "
                f"and {100 * part[1]:.0f} % of its height, expected 40 % and 25 %. Drive into its corners"
            )


def _scale_error(text: str, off: float, robot: str, size: float) -> CalibrationError:
    return CalibrationError(
        f"{text}: {100 * abs(off):.0f} % {'less' if off < 0 else 'more'} than measured. Either that measure is wrong, "
        f"or the tag of {robot} has a side of {1e3 * size / (1.0 + off):.0f} mm and not of {1e3 * size:.0f} mm. "
        "Measure the side of its black square, and correct tag_size"
    )


def _check_roughly(
    guess: Mapping[str, Camera],
    distance: Distance | None,
    heights: Mapping[str, float],
    robot: str,
    size: float,
    tag: float,
) -> None:
    """Compare the measures of the scale before they pull at each other."""
    for name, metres in heights.items():
        hangs = float(guess[name].model.position[2])
        off = (hangs - tag) / (metres - tag) - 1.0
        if abs(off) > 2.0 * _SIZE_OFF:
            got = f"by the size of {robot}'s tag, camera {name} hangs {hangs:.2f} m above the floor"
            raise _scale_error(got, off, robot, size)
    for name, pixels in distance.pixels.items() if distance is not None else ():
        ends = FloorMap(guess[name].model).to_metres(pixels, 0.0)
        length = math.dist(*ends.tolist())
        off = length / distance.metres - 1.0 if distance is not None else 0.0
        if abs(off) > 2.0 * _SIZE_OFF:
            got = f"by the size of {robot}'s tag, the floor tags that camera {name} sees are {length:.2f} m apart"
            raise _scale_error(got, off, robot, size)


def _check_scale(
    cameras: Mapping[str, Camera], state: _State, heights: Mapping[str, float], robot: str, size: float, tag: float
) -> None:
    for name, metres in heights.items():
        hangs = float(cameras[name].model.position[2])
        off = (hangs - tag) / (metres - tag) - 1.0
        if abs(off) > _SIZE_OFF:
            got = f"by the size of {robot}'s tag, camera {name} hangs {hangs:.2f} m above the floor"
            raise _scale_error(got, off, robot, size)
    off = math.exp(-state.log_scale) - 1.0
    if abs(off) > _SIZE_OFF:
        raise _scale_error(f"by the size of {robot}'s tag, all is {100 + 100 * off:.0f} % as large", off, robot, size)


def _without_outliers(
    priors: Mapping[str, LensPrior],
    knots: Knots,
    size: float,
    height: float,
    sigma: float,
    distance: Distance | None,
    guess: Mapping[str, Camera],
) -> tuple[Fitted[_State], _Bundle, int]:
    left_out = 0
    total = len(knots.t)
    for _ in range(4):
        bundle = _Bundle(priors, knots, size, height, sigma, distance)
        result = bundle.solve(guess)
        off = bundle.off(result.state)
        middle = float(np.nanmedian(np.concatenate(list(off.values()))))
        if middle > _MODEL * sigma:
            raise CalibrationError(
                f"the corners of the tag are {middle:.2f} px off all over the drive. Do the recordings begin at the "
                "same time, is the tag level and at tag_z, and are these the cameras' lens files?"
            )
        limit = _OUTLIER * max(middle, sigma)
        corners = {name: each.copy() for name, each in knots.corners.items()}
        bad = 0
        for name, each in off.items():
            with np.errstate(invalid="ignore"):
                wrong = each > limit
            corners[name][wrong] = np.nan
            bad += int(wrong.sum())
        if not bad:
            return result, bundle, left_out
        left_out += bad
        if left_out > 0.2 * total:
            worst = int(np.nanargmax(np.fmax.reduce(list(off.values()))))
            raise CalibrationError(
                f"{left_out} of {total} places contradict the others, such as that at {knots.t[worst]:.2f} s. Do the "
                "recordings begin at the same time, does another robot have the same tag, and is it fixed well?"
            )
        knots = _kept(Knots(knots.t, corners))
    raise CalibrationError("the places of the drive contradict each other. Record another one")


def _kept(knots: Knots) -> Knots:
    used = np.any([knots.seen(name) for name in knots.corners], axis=0)
    return Knots(knots.t[used], {name: each[used] for name, each in knots.corners.items()})


def _disagreement(
    priors: Mapping[str, LensPrior], bundle: _Bundle, cameras: Mapping[str, Camera], floor: Bounds
) -> float:
    """How much more the maps of two halves of the drive differ than their covariances allow, in squares."""
    halves = []
    for rest in (0, 1):
        # Stretches of four places: neighbours have errors in common.
        used = (np.arange(bundle.count) // 4) % 2 == rest
        part = Knots(bundle.knots.t[used], {name: each[used] for name, each in bundle.knots.corners.items()})
        half = _Bundle(priors, part, bundle.size, bundle.height, bundle.sigma, bundle.distance)
        result = half.solve(cameras)
        free = max(len(result.residuals) - half.columns, 1)
        misfit = max(float(result.residuals @ result.residuals) / free, 1.0)
        covariance = misfit_covariance(result.information, misfit, ALL * len(cameras))
        halves.append((dict(zip(half.names, result.state.cameras, strict=True)), covariance))
    (first, a), (second, b) = halves
    x, y = cells_of(floor, 0.25)
    columns, rows = np.meshgrid(x, y)
    places = np.column_stack((columns.ravel(), rows.ravel()))
    apart = map_difference(first, second, places, bundle.height)
    slopes, _ = _stacked(first, places, bundle.height)
    expected = np.trace(slopes @ (a + b) @ slopes.transpose(0, 2, 1), axis1=1, axis2=2)
    return max(1.0, float(((apart**2).sum(axis=1) / expected).mean()))
