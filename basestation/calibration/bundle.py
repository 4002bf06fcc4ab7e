"""The bundle adjustment of a drive: cameras, the tag's poses, and by how much its print differs from its size."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from basestation.calibration.camera import ALL, LENS, Camera, project
from basestation.calibration.drive_start import tag_poses
from basestation.calibration.least_squares import Fitted, fit
from basestation.calibration.lens_prior import LensPrior
from basestation.calibration.tag_tracks import Knots
from basestation.localization.floor_map import FloorMap

Array = NDArray[np.float64]

_PRINT: Final = 0.004
"""Relative standard deviation of a tag's side that was measured with a ruler."""
_UNIT: Final = np.array(((-0.5, 0.5), (0.5, 0.5), (0.5, -0.5), (-0.5, -0.5)))


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
class BundleState:
    """What is unknown.

    Attributes:
        cameras: the cameras.
        places: (K, 3) x [m], y [m], theta [rad] of the tag.
        ends: (2, 2) middles of the floor tags whose distance is known [m].
        log_scale: logarithm of the tag's true side over the given one.
    """

    cameras: tuple[Camera, ...]
    places: Array
    ends: Array
    log_scale: float


class Bundle:
    """The least squares of a drive.

    Args:
        priors: the lenses, by name.
        knots: the drive.
        size: side of the robot's tag [m].
        height: of it above the floor [m].
        sigma_pixels: standard deviation of a corner [px].
        distance: a known distance between two floor tags.
    """

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

    def solve(self, cameras: Mapping[str, Camera]) -> Fitted[BundleState]:
        """Adjust all.

        Args:
            cameras: where to start.
        """
        places = np.full((self.count, 3), np.nan)
        for name, camera in reversed(list(cameras.items())):
            there = self.knots.seen(name)
            places[there] = tag_poses(camera, self.knots.corners[name][there], self.height)
        ends = np.zeros((2, 2))
        if self.distance is not None:
            for name, pixels in self.distance.pixels.items():
                ends = FloorMap(cameras[name].model).to_metres(pixels, 0.0)
        start = BundleState(tuple(cameras[name] for name in self.names), places, ends, 0.0)
        self.anchor = start.places[0].copy()
        return fit(start, self._evaluate, self._adjust)

    def _adjust(self, state: BundleState, step: Array) -> BundleState:
        n = len(self.names)
        cameras = tuple(camera.adjusted(step[ALL * k : ALL * (k + 1)]) for k, camera in enumerate(state.cameras))
        after = ALL * n + 3 * self.count
        places = state.places + step[ALL * n : after].reshape(-1, 3)
        ends = state.ends + step[after : after + 4].reshape(2, 2) if self.distance else state.ends
        return BundleState(cameras, places, ends, state.log_scale + float(step[-1]))

    def _evaluate(self, state: BundleState) -> tuple[Array, Array]:
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

    def _add_distance(self, state: BundleState, rows: list[Array], slopes: list[Array]) -> None:
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

    def off(self, state: BundleState) -> dict[str, Array]:
        """By camera, (K,) root mean square distance of the corners [px]; NaN where it did not see them.

        Args:
            state: of the adjustment.
        """
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
