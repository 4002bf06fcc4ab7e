"""Locates robots in one camera's pictures.

Picture -> markers [px] -> positions of the corners [m] -> pose of the tag -> pose of the robot's base. No bus, no
clock.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from operator import itemgetter
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from basestation.localization.detector import TagDetector
from basestation.localization.floor_map import FloorMap
from basestation.localization.markers import Marker, Picture
from basestation.localization.sightings import Sighting
from muro_zenoh.errors import MessageError
from muro_zenoh.geometry import Pose2, TagMount

Array = NDArray[np.float64]

_SQUARE = np.array((-0.5 + 0.5j, 0.5 + 0.5j, 0.5 - 0.5j, -0.5 - 0.5j))  # a tag of side 1, as printed, clockwise
_AROUND = np.array(((0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5)))  # [px]
_EDGE = 0.15  # width of the picture's edge, in its shorter side
_CUT = 2.0  # a tag with a corner nearer to the picture's edge than this may be cut off there [px]
_STILL = np.zeros((4, 2))
_COAST = 4  # pictures for which a hidden tag is assumed to keep moving
_SIZE_OFF = 0.3  # relative size error above which a print is not the tag (blur and ink cause 0.05)
_SHAPE_OFF = 0.15  # maximum root mean square error of the corners from a square, in sides


@dataclass(frozen=True, slots=True, eq=False)
class _Track:
    """A recently seen tag: its position (predicted while hidden), the step of each corner per picture [px], pictures
    without it."""

    marker: Marker
    step: Array
    missed: int = 0

    def expected(self) -> Marker:
        return Marker(self.marker.id, self.marker.corners + self.step)

    def unseen(self) -> _Track:
        # A tag that is hidden for a moment keeps moving; after that its motion is unknown.
        goes_on = self.missed < _COAST
        return _Track(self.expected(), self.step if goes_on else _STILL, self.missed + 1)


class Localizer:
    """Finds the robots in one camera's pictures.

    Pictures are searched near the tags' last positions. The whole picture is searched every ``sweep_every`` pictures,
    for new tags; and every ``search_every`` pictures while a recently seen tag is missing, or none is known, so that a
    hidden robot does not cost a whole search each time. One that drove out of the picture is not missing.

    A number that is seen twice (two robots with one tag, a mirror) is in ``duplicate_tags`` and gives no sighting,
    because it is unknown which of the two is the robot.

    Attributes:
        unknown_tags: numbers in the newest whole picture that no robot has.
        duplicate_tags: numbers that are more than once in the newest picture.
        misfit_tags: numbers seen since the newest whole search on something that is not a square of the tag's size,
            with the size seen [m]: a wrong ``tag_size``, or not the tag.
        swept: whether the newest picture was searched as a whole.
        floor_off: how far from its place each tag on the floor was in the newest picture (x, y) [m, world]; empty
            unless that was searched as a whole.

    Args:
        camera: its name.
        floor: from its pixels to metres.
        detector: for the robots' family of tags.
        tags: from a tag's number to the robot's name and the tag's mounting pose.
        floor_tags: x, y, z where tags lie on the floor, by number [m, world]. Those of robots are not used.
        corner_noise: standard deviation of a corner, along each axis [px]. Measured on rendered pictures with tags of
            37 pixels: 0.06, and more where light and lens are worse.
        sweep_every: pictures from one whole search to the next.
        search_every: the same while a recently seen tag is missing.
        remember: number of pictures for which a tag is searched after it was last seen.
    """

    def __init__(
        self,
        camera: str,
        floor: FloorMap,
        detector: TagDetector,
        tags: Mapping[int, tuple[str, TagMount]],
        *,
        floor_tags: Mapping[int, tuple[float, float, float]] = MappingProxyType({}),
        corner_noise: float = 0.1,
        sweep_every: int = 10,
        search_every: int = 3,
        remember: int = 40,
    ) -> None:
        self.camera = camera
        self.floor = floor
        self.detector = detector
        self.tags = dict(tags)
        self._to_base = {tag: mount.pose.inverse() for tag, (_, mount) in self.tags.items()}
        self.unknown_tags: frozenset[int] = frozenset()
        self.duplicate_tags: frozenset[int] = frozenset()
        self.misfit_tags: dict[int, float] = {}
        self.swept = False
        self.floor_off: tuple[tuple[float, float], ...] = ()
        self._floor_tags = {tag: where for tag, where in floor_tags.items() if tag not in self.tags}
        self._corner_noise = corner_noise
        self._sweep_every = sweep_every
        self._search_every = search_every
        self._remember = remember
        self._tracks: list[_Track] = []
        self._since_sweep = sweep_every

    def locate(self, image: Picture) -> list[Sighting]:
        """The robots in a picture, each at most once, in the order of their tags' numbers.

        Args:
            image: (height, width), grey; the next picture of this camera.

        Raises:
            MessageError: a picture of another size than the camera's.
        """
        height, width = image.shape
        model = self.floor.camera
        if (width, height) != (model.width, model.height):
            expected = f"{model.width} x {model.height}, which camera {self.camera} is calibrated for"
            raise MessageError(f"a picture of {width} x {height} pixels, expected {expected}")
        found = self._sightings([marker for marker in self._search(image) if marker.id in self.tags])
        self._follow([marker for marker, _ in found])
        counts = Counter(marker.id for marker, _ in found)
        self.duplicate_tags = frozenset(number for number, count in counts.items() if count > 1)
        single = [(marker.id, sighting) for marker, sighting in found if counts[marker.id] == 1]
        return [sighting for _, sighting in sorted(single, key=itemgetter(0))]

    @property
    def complaints(self) -> tuple[str, ...]:
        """What is wrong with the tags in the newest pictures, for the operator."""
        sees = f"camera {self.camera} sees tag"
        unknown = [f"{sees} {tag}, which no robot has" for tag in sorted(self.unknown_tags)]
        duplicate = [f"{sees} {tag} twice" for tag in sorted(self.duplicate_tags)]
        misfit = [
            f"{sees} {tag} with a side of {size:.3f} m: check its tag_size"
            for tag, size in sorted(self.misfit_tags.items())
        ]
        return (*unknown, *duplicate, *misfit)

    def _search(self, image: Picture) -> list[Marker]:
        lost = self._lost()
        missing = not self._tracks or lost
        self._since_sweep += 1
        self.swept = self._since_sweep >= (self._search_every if missing else self._sweep_every)
        self.floor_off = ()
        if not self.swept:
            return self.detector.detect_near(image, [track.expected() for track in self._tracks])
        self._since_sweep = 0
        markers = self.detector.detect(image, wanted=len(self.tags), lost=lost)
        self.unknown_tags = frozenset(marker.id for marker in markers) - self.tags.keys() - self._floor_tags.keys()
        self.floor_off = self._off_their_places([marker for marker in markers if marker.id in self._floor_tags])
        return markers

    def _off_their_places(self, markers: list[Marker]) -> tuple[tuple[float, float], ...]:
        if not markers:
            return ()
        places = np.array([self._floor_tags[marker.id] for marker in markers])
        corners = np.stack([marker.corners for marker in markers])
        whole = self.floor.margin(corners).min(axis=1) >= _CUT
        middles = self.floor.to_metres(corners, places[:, 2:]).mean(axis=1)
        return tuple((x, y) for x, y in (middles - places[:, :2])[whole].tolist())

    def _lost(self) -> bool:
        """Whether a tag that was seen lately is not, though it cannot have left the picture."""
        hidden = [track.marker.corners for track in self._tracks if track.missed > 0]
        return bool(hidden) and bool((self.floor.margin(np.stack(hidden)).min(axis=1) > _CUT).any())

    def _follow(self, markers: list[Marker]) -> None:
        """Assign markers to tracks, nearest first; the others start new tracks."""
        left: dict[int, list[_Track]] = {}
        for track in self._tracks:
            left.setdefault(track.marker.id, []).append(track)
        tracks: list[_Track] = []
        for marker in markers:
            same = left.get(marker.id)
            step = _STILL
            if same:
                middle = marker.centre
                nearest = (
                    min(same, key=lambda track: math.dist(track.marker.centre, middle)) if len(same) > 1 else same[0]
                )
                same.remove(nearest)
                if nearest.missed == 0 and math.dist(nearest.marker.centre, middle) < marker.side:
                    step = marker.corners - nearest.marker.corners
            tracks.append(_Track(marker, step))
        tracks += [track.unseen() for row in left.values() for track in row if track.missed < self._remember]
        self._tracks = tracks

    def _sightings(self, markers: list[Marker]) -> list[tuple[Marker, Sighting]]:
        if self.swept:
            self.misfit_tags = {}
        if not markers:
            return []
        corners = np.stack([marker.corners for marker in markers])
        # The corners, and four points around the centre for the slope, in one go: it is a third of the time.
        points = np.concatenate((corners, corners.mean(axis=1, keepdims=True) + _AROUND), axis=1)
        heights = np.array([[self.tags[marker.id][1].z] for marker in markers])
        metres = self.floor.to_metres(points, heights.repeat(8, axis=1))
        right, left, below, above = np.moveaxis(metres[:, 4:], 1, 0)
        slopes = np.stack((right - left, below - above), axis=-1).tolist()
        poses, sides, misfits = fit_squares(metres[:, :4])
        edge = _EDGE * min(self.floor.camera.width, self.floor.camera.height)
        margins = self.floor.margin(corners).min(axis=1)
        insides, cuts = (margins / edge).clip(0.0, 1.0).tolist(), (margins < _CUT).tolist()
        sightings = []
        for marker, slope, pose, side, misfit, inside, cut in zip(
            markers, slopes, poses, sides, misfits, insides, cuts, strict=True
        ):
            if cut:
                continue
            name, mount = self.tags[marker.id]
            # Also false for NaN: a tag on the horizon.
            if not (abs(side / mount.size - 1.0) <= _SIZE_OFF and misfit <= _SHAPE_OFF * side):
                self.misfit_tags[marker.id] = side
                continue
            base = pose.compose(self._to_base[marker.id])
            covariance = _covariance(slope, self._corner_noise, mount, base.theta)
            sightings.append((marker, Sighting(name, base, covariance, inside)))
        return sightings


def fit_squares(corners: Array) -> tuple[list[Pose2], list[float], list[float]]:
    """The squares nearest to sets of four corners: least squares over position, rotation and size.

    With the corners as complex numbers w and those of a centred square of side 1 as z, the best a in w = c + a z is
    ``sum(conj(z) (w - mean(w))) / sum(|z|^2)``; its angle is the heading and its modulus the side.

    Args:
        corners: (N, 4, 2) [m, world]: the upper left corner, then clockwise, as printed.

    Returns:
        N each: the poses of the tags in the world, their sides [m], and the root mean square distance of the corners
        from the square [m].
    """
    w = corners[..., 0] + 1j * corners[..., 1]
    centre = w.mean(axis=1)
    spokes = w - centre[:, None]
    turned = (spokes @ _SQUARE.conj()) / 2.0  # sum(|z|^2) of the unit square
    misfit = np.sqrt((np.abs(spokes - turned[:, None] * _SQUARE) ** 2).mean(axis=1))
    columns = (centre.real, centre.imag, np.angle(turned))
    poses = [Pose2(x, y, theta) for x, y, theta in np.column_stack(columns).tolist()]
    return poses, np.abs(turned).tolist(), misfit.tolist()


def _covariance(slope: list[list[float]], corner_noise: float, mount: TagMount, theta: float) -> tuple[float, ...]:
    """Covariance of the base's pose, from independent noise on the tag's four corners.

    The centre has a quarter of a corner's variance; the heading, by the fit above, that of a corner across the radius
    over ``sum(|z|^2) = 2 size^2``. The base is at a distance from the tag's centre, so a heading error moves it.
    """
    (xu, xv), (yu, yv) = slope
    corner = corner_noise * corner_noise
    xx, xy, yy = corner * (xu * xu + xv * xv), corner * (xu * yu + xv * yv), corner * (yu * yu + yv * yv)
    turn = 0.5 * (xx + yy) / (2.0 * mount.size * mount.size)
    c, s = math.cos(theta), math.sin(theta)
    dx, dy = s * mount.x + c * mount.y, s * mount.y - c * mount.x
    off = 0.25 * xy + turn * dx * dy
    return (
        *(0.25 * xx + turn * dx * dx, off, turn * dx),
        *(off, 0.25 * yy + turn * dy * dy, turn * dy),
        *(turn * dx, turn * dy, turn),
    )
