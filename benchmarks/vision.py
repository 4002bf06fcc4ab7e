"""What a picture costs and how well robots are found in it: renderer, JPEG, detector, localizer.

    python benchmarks/vision.py [--frames N] [--robots N] [--large] [--json FILE]

Ten robots drive through 4.2 x 3 m under a camera of 1280 x 720 pixels that sees it with a margin; tags of 16 cm are 36
pixels wide. With ``--large`` the camera has 1920 x 1080 pixels and the floor 6 x 6 m, as in ``benchmarks/scale.py``;
tags are 26 pixels wide. One thread. Times are medians and 95th percentiles over the frames; errors are against the
places rendered.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from basestation.localization.frames import decode_frame
from basestation.localization.homography import Homography
from basestation.localization.localizer import Localizer
from basestation.localization.markers import Marker, TagDetector
from basestation.localization.sightings import Sighting
from muro_zenoh.geometry import Bounds, TagMount, straight_down_view, wrap_to_pi
from muro_zenoh.simulation.camera import OverheadCamera, encode_jpeg

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Hall:
    """A camera's size [px], and the floor under it [m]."""

    width: int
    height: int
    arena: Bounds


SMALL = Hall(1280, 720, Bounds(-2.1, 2.1, -1.5, 1.5))
LARGE = Hall(1920, 1080, Bounds(-3.0, 3.0, -3.0, 3.0))
RATE = 20.0
Result = TypeVar("Result")


@dataclass
class Stage:
    """Times of one stage [ms], and the errors of what it found."""

    name: str
    milliseconds: list[float] = field(default_factory=list)
    distances: list[float] = field(default_factory=list)  # [mm]
    turns: list[float] = field(default_factory=list)  # [degrees]
    missed: int = 0

    def timed(self, call: Callable[[], Result]) -> Result:
        begin = time.perf_counter()
        result = call()
        self.milliseconds.append(1e3 * (time.perf_counter() - begin))
        return result

    def judge(self, sightings: list[Sighting], poses: Array) -> None:
        self.missed += len(poses) - len(sightings)
        for sighting in sightings:
            x, y, theta = poses[int(sighting.name[1:])]
            self.distances.append(1e3 * math.hypot(sighting.pose.x - x, sighting.pose.y - y))
            self.turns.append(math.degrees(abs(wrap_to_pi(sighting.pose.theta - theta))))

    def row(self) -> dict[str, Any]:
        row: dict[str, Any] = {"stage": self.name, "ms": _quantiles(self.milliseconds)}
        if self.distances:
            row |= {
                "place_error_mm": _quantiles(self.distances),
                "heading_error_deg": _quantiles(self.turns),
                "found": len(self.distances),
                "missed": self.missed,
            }
        return row


def _quantiles(values: list[float]) -> dict[str, float]:
    p50, p95, top = np.quantile(values, (0.5, 0.95, 1.0)).tolist()
    return {"p50": round(p50, 4), "p95": round(p95, 4), "max": round(top, 4)}


def drive(robots: int, frames: int, arena: tuple[float, float, float, float], rng: np.random.Generator) -> list[Array]:
    """Poses (robots, 3) frame by frame, each robot on a circle of its own cell, at up to 0.4 m/s, never touching."""
    columns = math.ceil(math.sqrt(1.6 * robots))
    rows = math.ceil(robots / columns)
    cell = np.array([arena.width / columns, arena.height / rows])
    middles = np.array([arena.corners[0] + cell * (i % columns + 0.5, i // columns + 0.5) for i in range(robots)])
    radius = max(float(cell.min()) / 2.0 - 0.177, 0.02)
    omega = np.minimum(rng.uniform(0.1, 0.4, robots) / radius, 1.5) * rng.choice((-1.0, 1.0), robots)
    start = rng.uniform(-math.pi, math.pi, robots)
    phases = [start + omega * k / RATE for k in range(frames)]
    return [
        np.column_stack(
            (middles + radius * np.column_stack((np.cos(p), np.sin(p))), p + np.sign(omega) * math.pi / 2.0)
        )
        for p in phases
    ]


def run(hall: Hall, robots: int, frames: int, quality: int = 85) -> tuple[list[Stage], float]:
    """Every stage on the same frames; and the mean size of a JPEG [kB]."""
    rng = np.random.default_rng(1)
    size = hall.width, hall.height
    views = straight_down_view(hall.arena, *size, margin=0.1)
    camera = OverheadCamera.from_views(*size, views)
    mounts = [TagMount(i, 0.16, x=-0.03, y=0.02, yaw=0.3) for i in range(robots)]
    tags = {mount.id: (f"r{mount.id}", mount) for mount in mounts}
    homography = Homography.fit(views, camera="bench")
    detector = TagDetector()
    two_windows = TagDetector(windows=(9, 19), contrast=7.0)
    tracking = Localizer("bench", homography, detector, tags)
    wholes = Localizer("bench", homography, detector, tags, sweep_every=1, search_every=1)
    render, encode, decode = Stage("render"), Stage("JPEG encode"), Stage("JPEG decode")
    whole, wide, near = Stage("detect, whole"), Stage("detect, whole, windows 9..19"), Stage("detect, near")
    located, located_whole = Stage("locate (detect to pose)"), Stage("locate, whole each time")
    bytes_sent = 0
    # A first pass over a few frames fills caches; it is not counted.
    warm = camera.render(drive(robots, 1, hall.arena, rng)[0], mounts, [0.177] * robots, rng)
    for _ in range(3):
        detector.detect(decode_frame("jpeg", *size, encode_jpeg(warm)))
    for poses in drive(robots, frames, hall.arena, rng):
        picture = render.timed(partial(camera.render, poses, mounts, [0.177] * robots, rng))
        data = encode.timed(partial(encode_jpeg, picture, quality))
        image = decode.timed(partial(decode_frame, "jpeg", *size, data))
        bytes_sent += len(data)
        expected = [
            Marker(mount.id, camera.tag_corners(pose, mount) + rng.uniform(-6.0, 6.0, 2))
            for pose, mount in zip(poses, mounts, strict=True)
        ]
        whole.timed(partial(detector.detect, image))
        wide.timed(partial(two_windows.detect, image))
        near.timed(partial(detector.detect_near, image, expected))
        located.judge(located.timed(partial(tracking.locate, image)), poses)
        located_whole.judge(located_whole.timed(partial(wholes.locate, image)), poses)
    return [render, encode, decode, whole, wide, near, located, located_whole], bytes_sent / frames / 1e3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=400, help="how many pictures (400)")
    parser.add_argument("--robots", type=int, default=10, help="how many robots (10)")
    parser.add_argument("--large", action="store_true", help="1920 x 1080 pixels over 6 x 6 m")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    hall = LARGE if given.large else SMALL
    stages, kilobytes = run(hall, given.robots, given.frames)
    rows = [stage.row() for stage in stages]
    print(
        f"OpenCV {cv2.__version__}, {given.robots} robots, {given.frames} frames of {hall.width} x {hall.height}, ",
        end="",
    )
    print(f"JPEG {kilobytes:.0f} kB")
    print(f"{'':30}{'ms p50':>8}{'p95':>8}{'mm p50':>9}{'p95':>8}{'deg p50':>9}{'p95':>8}{'found':>8}{'missed':>8}")
    for row in rows:
        line = f"{row['stage']:30}{row['ms']['p50']:8.2f}{row['ms']['p95']:8.2f}"
        if "found" in row:
            place, turn = row["place_error_mm"], row["heading_error_deg"]
            line += f"{place['p50']:9.2f}{place['p95']:8.2f}{turn['p50']:9.2f}{turn['p95']:8.2f}"
            line += f"{row['found']:8d}{row['missed']:8d}"
        print(line)
    if given.json:
        head = {
            "opencv": cv2.__version__,
            "width": hall.width,
            "height": hall.height,
            "robots": given.robots,
            "frames": given.frames,
            "jpeg_kb": kilobytes,
        }
        given.json.write_text(json.dumps(head | {"rows": rows}, indent=2) + "\n")


if __name__ == "__main__":
    main()
