"""What it costs to find robots in a picture, and how well it is done, beside OpenCV's detector as it comes.

    python benchmarks/localization.py [--frames N] [--json FILE]

Robots drive through a hall under one calibrated camera with distortion, motion blur, uneven light and noise; their tags
of 16 cm are 0.15 m above the floor. On the same frames, as JPEG of quality 85:

* ``bare``: ``cv2.aruco.ArucoDetector.detectMarkers`` with default parameters, and then the same geometry as ours;
* ``full``: our localizer, the whole picture each time;
* ``cropped``: our localizer as the base station runs it: near the predicted places, the whole picture now and then.

Everything on one thread. ``ms`` is the median processor time of a frame, which a busy machine does not change much; for
``bare`` of ``detectMarkers`` alone. ``error_mm`` is the mean distance between the place found and the place rendered,
``found`` the fraction of robots. The renderer's own time is a row too. The exit code is 1 when a goal is missed:
cropped at most 0.15 of the bare time, full at most 0.6 of it, both with at most half its error.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))

from basestation.localization.detector import TagDetector
from basestation.localization.floor_map import FloorMap
from basestation.localization.frames import decode_frame
from basestation.localization.localizer import Localizer
from basestation.localization.markers import Marker, Picture
from basestation.localization.sightings import Sighting
from benchmarks.support.rows import write
from muro_zenoh.geometry import Bounds, TagMount
from muro_zenoh.optics.camera_model import hung
from muro_zenoh.optics.jpeg import encode_jpeg
from muro_zenoh.simulation.camera import OverheadCamera

Array = NDArray[np.float64]
Result = TypeVar("Result")

RATE = 20.0
RADIUS = 0.177
BARREL = (-0.08, 0.012, 0.0004, -0.0003, 0.0)
LIMITS = {"cropped": 0.15, "full": 0.6}
WORST_ERROR = 0.5


@dataclass(frozen=True)
class Hall:
    """A camera's size [px], and the floor under it [m]."""

    width: int
    height: int
    arena: Bounds


HALLS = {
    "720p": Hall(1280, 720, Bounds(-2.1, 2.1, -1.5, 1.5)),
    "1080p": Hall(1920, 1080, Bounds(-3.0, 3.0, -2.0, 2.0)),
}


@dataclass(frozen=True)
class Row:
    """One method on one kind of frame."""

    frame: str
    tags: int
    method: str
    ms: float
    error_mm: float
    found: float


@dataclass
class Method:
    """Its times [ms] and errors [mm]."""

    name: str
    milliseconds: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    shown: int = 0

    def timed(self, call: Callable[[], Result]) -> Result:
        begin = time.thread_time()
        result = call()
        self.milliseconds.append(1e3 * (time.thread_time() - begin))
        return result

    def judge(self, sightings: list[Sighting], poses: Array) -> None:
        self.shown += len(poses)
        for sighting in sightings:
            x, y, _ = poses[int(sighting.name[1:])]
            self.errors.append(1e3 * math.hypot(sighting.pose.x - x, sighting.pose.y - y))

    def row(self, frame: str, tags: int) -> Row:
        return Row(
            frame,
            tags,
            self.name,
            round(float(np.median(self.milliseconds)), 3),
            round(float(np.mean(self.errors)), 3) if self.errors else math.nan,
            round(len(self.errors) / max(self.shown, 1), 4),
        )


class Bare:
    """OpenCV's detector with default parameters, in the place of ours."""

    family = "DICT_4X4_50"

    def __init__(self) -> None:
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        self._detector = cv2.aruco.ArucoDetector(dictionary, cv2.aruco.DetectorParameters())
        self.milliseconds: list[float] = []

    def detect(self, image: Picture, *, wanted: int = 0, lost: bool = False) -> list[Marker]:
        begin = time.thread_time()
        corners, ids, _ = self._detector.detectMarkers(image)
        self.milliseconds.append(1e3 * (time.thread_time() - begin))
        if ids is None:
            return []
        return [Marker(int(i), quad[0].astype(float)) for i, quad in zip(ids.ravel(), corners, strict=True)]


def drive(robots: int, frames: int, arena: Bounds, rng: np.random.Generator) -> list[tuple[Array, Array]]:
    """Poses (robots, 3) and twists (robots, 2) frame by frame: each robot on a circle of its own cell, at up to
    0.4 m/s, never touching another."""
    columns = math.ceil(math.sqrt(1.6 * robots))
    rows = math.ceil(robots / columns)
    cell = np.array([arena.width / columns, arena.height / rows])
    middles = np.array([arena.corners[0] + cell * (i % columns + 0.5, i // columns + 0.5) for i in range(robots)])
    radius = max(float(cell.min()) / 2.0 - RADIUS, 0.02)
    omega = np.minimum(rng.uniform(0.1, 0.4, robots) / radius, 1.5) * rng.choice((-1.0, 1.0), robots)
    start = rng.uniform(-math.pi, math.pi, robots)
    twists = np.column_stack((radius * np.abs(omega), omega))
    phases = [start + omega * k / RATE for k in range(frames)]
    return [
        (
            np.column_stack(
                (middles + radius * np.column_stack((np.cos(p), np.sin(p))), p + np.sign(omega) * math.pi / 2.0)
            ),
            twists,
        )
        for p in phases
    ]


def run(frame: str, robots: int, frames: int) -> list[Row]:
    """Every method on the same frames.

    Args:
        frame: of :data:`HALLS`.
        robots: how many.
        frames: how many.
    """
    hall = HALLS[frame]
    rng = np.random.default_rng(1)
    model = hung(hall.width, hall.height, position=(0.0, 0.0, 3.0), sees=hall.arena.shrunk(-0.25), distortion=BARREL)
    camera = OverheadCamera(model, blur=0.6, noise=3.0, shade=0.3, exposure=0.005, seed=2)
    mounts = [TagMount(i, 0.16, x=-0.03, y=0.02, yaw=0.3, z=0.15) for i in range(robots)]
    radii = [RADIUS] * robots
    tags = {mount.id: (f"r{mount.id}", mount) for mount in mounts}
    floor, detector, bare_detector = FloorMap(model), TagDetector(), Bare()
    bare = Method("bare", bare_detector.milliseconds)
    full, cropped, render = Method("full"), Method("cropped"), Method("render")
    searches = {
        "bare": Localizer("bench", floor, bare_detector, tags, sweep_every=1, search_every=1),
        "full": Localizer("bench", floor, detector, tags, sweep_every=1, search_every=1),
        "cropped": Localizer("bench", floor, detector, tags),
    }
    warm = 3  # frames that fill caches; they are not counted
    for k, (poses, twists) in enumerate(drive(robots, frames + warm, hall.arena, rng)):
        picture = render.timed(partial(camera.render, poses, mounts, radii, rng, twists=twists))
        image = decode_frame("jpeg", hall.width, hall.height, encode_jpeg(picture, 85))
        for method in (bare, full, cropped):
            locate = partial(searches[method.name].locate, image)
            sightings = locate() if method is bare else method.timed(locate)
            if k >= warm:
                method.judge(sightings, poses)
        if k == warm - 1:
            for method in (bare, full, cropped, render):
                method.milliseconds.clear()
    return [method.row(frame, robots) for method in (bare, full, cropped, render)]


def missed(rows: list[Row]) -> list[str]:
    """The goals that were not met.

    Args:
        rows: of one run.
    """
    bare = {(row.frame, row.tags): row for row in rows if row.method == "bare"}
    problems = []
    for row in rows:
        if row.method in LIMITS:
            base = bare[row.frame, row.tags]
            if row.ms > LIMITS[row.method] * base.ms:
                problems.append(f"{row.frame}, {row.tags} tags, {row.method}: {row.ms / base.ms:.2f} of the bare time")
            if not row.error_mm <= WORST_ERROR * base.error_mm:
                problems.append(f"{row.frame}, {row.tags} tags, {row.method}: {row.error_mm / base.error_mm:.2f} error")
    return problems


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=200, help="how many pictures of each kind (200)")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    rows = [row for frame in HALLS for robots in (10, 20) for row in run(frame, robots, given.frames)]
    print(f"OpenCV {cv2.__version__}, {given.frames} frames of each kind, one thread")
    print(f"{'frame':8}{'tags':>5}  {'method':10}{'ms':>8}{'of bare':>9}{'error mm':>10}{'of bare':>9}{'found':>8}")
    base = rows[0]
    for row in rows:
        base = row if row.method == "bare" else base
        line = f"{row.frame:8}{row.tags:5}  {row.method:10}{row.ms:8.2f}{row.ms / base.ms:9.2f}"
        if row.method != "render":
            line += f"{row.error_mm:10.3f}{row.error_mm / base.error_mm:9.2f}{row.found:8.3f}"
        print(line)
    problems = missed(rows)
    print("\n".join(f"missed: {problem}" for problem in problems) or "all goals met")
    write(given.json, [asdict(row) for row in rows if row.method != "render"])
    sys.exit(bool(problems))


if __name__ == "__main__":
    main()
