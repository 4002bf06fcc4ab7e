"""All cameras placed in one frame, from a robot that drove about under them.

A bundle adjustment (Triggs, McLauchlan, Hartley and Fitzgibbon, 2000). Unknown are the cameras, the tag's pose at each
time on the plane at its height, and by how much its print differs from the size that was given. The lenses keep what
their own calibrations know.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from basestation.calibration.bundle import Bundle, BundleState, Distance
from basestation.calibration.camera import ALL, Camera, project
from basestation.calibration.drive_start import first_guess, in_frame, match, tag_poses
from basestation.calibration.floor_error import cells_of, grid, seen
from basestation.calibration.least_squares import Fitted
from basestation.calibration.lens_prior import LensPrior
from basestation.calibration.shared_map import map_difference, misfit_covariance, shared_slopes
from basestation.calibration.tag_tracks import Knots
from basestation.localization.floor_map import FloorMap
from muro_zenoh.errors import CalibrationError
from muro_zenoh.geometry import Bounds, Pose2

Array = NDArray[np.float64]

_FEWEST: Final = 12
"""Places of the robot that a camera must have seen."""
_SIZE_OFF: Final = 0.05
"""Greatest relative difference between two measures of the scale: the tag's side, a distance, a camera's height."""
_OUTLIER: Final = 5.0
"""A place is left out when its corners are off by so many times what they are in the middle of all places."""
_KNOWN_OFF: Final = 0.005
"""Known cameras that differ by more than this, in the middle of the places that one sees, contradict each other [m]."""
_ORIGIN: Final = Pose2(0.0, 0.0, 0.0)
_MODEL: Final = 4.0
"""Root mean square error of the corners that no model may exceed, in standard deviations."""


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
        CalibrationError: a drive that is too short, places that contradict each other, known cameras or measures of the
            scale that do, or a scale that nothing but the tag's size says.
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
    if known:
        _check_known(cameras, known, floor, height)
        # The adjustment kept the frame of the tag's first place, which turns it by that one view's error.
        pose = _frame_of(cameras, knots, known, start, floor, height)
        cameras = {name: in_frame(camera, pose) for name, camera in cameras.items()}
    pixels = float(np.sqrt(np.nanmean(np.concatenate(list(bundle.off(state).values())) ** 2)))
    _check_scale(cameras, state, heights or {}, robot, size, height)
    free = max(len(result.residuals) - bundle.columns, 1)
    misfit = float(result.residuals @ result.residuals) / free
    covariance = misfit_covariance(result.information, max(misfit, 1.0), ALL * len(cameras))
    fitted = DriveFit(cameras, covariance, pixels, 1.0, math.exp(state.log_scale), left_out)
    inflation = _disagreement(priors, bundle, cameras, floor)
    return replace(fitted, covariance=inflation * covariance, inflation=inflation)


def _frame_of(
    cameras: Mapping[str, Camera], knots: Knots, known: Mapping[str, Camera], start: Pose2, floor: Bounds, height: float
) -> Pose2:
    """The pose of the cameras' frame in the world."""
    old, new = [], []
    for name, camera in known.items():
        mine, there = _in_both(cameras[name], camera, floor, height)
        new.append(mine)
        old.append(there)
    if old:
        return match(np.concatenate(old), np.concatenate(new))
    name = next(name for name in cameras if knots.seen(name)[0])
    first = tag_poses(cameras[name], knots.corners[name][:1], height)[0]
    return start.compose(first.inverse())


def _in_both(found: Camera, known: Camera, floor: Bounds, height: float) -> tuple[Array, Array]:
    """Places that a known camera sees, and where the one that was found has them, (N, 2) each."""
    places = grid(*cells_of(floor, 0.25))
    mine = places[seen(known, places, height)]
    pixels = project(known, np.insert(mine, 2, height, axis=1)).pixels
    return mine, FloorMap(found.model).to_metres(pixels, height)


def _check_known(cameras: Mapping[str, Camera], known: Mapping[str, Camera], floor: Bounds, height: float) -> None:
    """Known cameras that do not fit together: one was moved, and would take the whole map with it."""
    frames: dict[str, tuple[Array, Pose2]] = {}
    for name, camera in known.items():
        mine, there = _in_both(cameras[name], camera, floor, height)
        frames[name] = there, match(there, mine)
    apart = {}
    for (a, (places, one)), (b, (others, two)) in combinations(frames.items(), 2):
        points = np.concatenate((places, others)) @ (1.0, 1j)
        moved = [np.exp(1j * frame.theta) * points + complex(frame.x, frame.y) for frame in (one, two)]
        apart[a, b] = float(np.median(np.abs(moved[0] - moved[1])))
    worst = max(apart, key=apart.__getitem__, default=None)
    if worst is not None and apart[worst] > _KNOWN_OFF:
        a, b = worst
        raise CalibrationError(
            f"the calibrations of {a} and {b} are {1e3 * apart[worst]:.0f} mm apart, expected at most "
            f"{1e3 * _KNOWN_OFF:.0f} mm: one of them was moved. Say which one was not, and how the map lies is taken "
            f"from that one: --frame {a} or --frame {b}"
        )


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
    cameras: Mapping[str, Camera], state: BundleState, heights: Mapping[str, float], robot: str, size: float, tag: float
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
) -> tuple[Fitted[BundleState], Bundle, int]:
    left_out = 0
    total = len(knots.t)
    for _ in range(4):
        bundle = Bundle(priors, knots, size, height, sigma, distance)
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
    priors: Mapping[str, LensPrior], bundle: Bundle, cameras: Mapping[str, Camera], floor: Bounds
) -> float:
    """How much more the maps of two halves of the drive differ than their covariances allow, in squares."""
    halves = []
    for rest in (0, 1):
        # Stretches of four places: neighbours have errors in common.
        used = (np.arange(bundle.count) // 4) % 2 == rest
        part = Knots(bundle.knots.t[used], {name: each[used] for name, each in bundle.knots.corners.items()})
        half = Bundle(priors, part, bundle.size, bundle.height, bundle.sigma, bundle.distance)
        result = half.solve(cameras)
        free = max(len(result.residuals) - half.columns, 1)
        misfit = max(float(result.residuals @ result.residuals) / free, 1.0)
        covariance = misfit_covariance(result.information, misfit, ALL * len(cameras))
        halves.append((dict(zip(half.names, result.state.cameras, strict=True)), covariance))
    (first, a), (second, b) = halves
    x, y = cells_of(floor, 0.25)
    places = grid(x, y)
    apart = map_difference(first, second, places, bundle.height)
    slopes, _ = shared_slopes(first, places, bundle.height)
    expected = np.trace(slopes @ (a + b) @ slopes.transpose(0, 2, 1), axis1=1, axis2=2)
    return max(1.0, float(((apart**2).sum(axis=1) / expected).mean()))
