"""``muro calibrate drive`` from two videos of a robot's drive to the cameras' files."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
from click.testing import CliRunner

from basestation.calibration.camera import camera_of
from basestation.calibration.files import placed_camera, write_lens
from basestation.calibration.shared_map import map_difference
from muro_zenoh.cli.main import main
from muro_zenoh.config import load_scenario
from muro_zenoh.optics.camera_model import hung
from muro_zenoh.simulation.camera import OverheadCamera

TRUTH = {
    name: hung(960, 480, position=(0.0, y, 3.0), fov=1.36, tilt=0.03, distortion=(k1, 0.01, 4e-4, -3e-4, 0.0))
    for name, y, k1 in (("north", 0.7, -0.08), ("south", -0.7, -0.07))
}
FLEET = "robots = 1\n" + "".join(f"[camera.{name}]\nwidth = 960\nheight = 480\n" for name in TRUTH)
PICTURES = 330
PHASES = {"north": 0.0, "south": 0.05}
"""When a camera takes its pictures, in periods. The robot drives ten times as fast as it should, so that the videos are
short: as far as it drives in this time it would in half a period."""


def pose(u: float) -> tuple[float, float, float]:
    """Three times across the floor, turning."""
    return 1.8 * math.sin(3 * math.pi * u), 1.25 - 2.5 * u, 4 * math.pi * u


def test_two_videos_become_two_cameras_in_one_frame(tmp_path: Path) -> None:
    (tmp_path / "lab.toml").write_text(FLEET)
    robot = load_scenario(tmp_path / "lab.toml").robot["r1"]
    arguments = ["calibrate", "drive", "r1", "--fleet", str(tmp_path / "lab.toml"), "--height", "north=3.0"]
    rng = np.random.default_rng(3)
    for name, model in TRUTH.items():
        film, path = OverheadCamera(model, seed=1), tmp_path / f"{name}.avi"
        video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (960, 480))
        for k in range(PICTURES):
            where = np.array([pose((k + PHASES[name]) / PICTURES)])
            picture = film.render(where, [robot.mount], [robot.radius], rng)
            video.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
        video.release()
        lens = tmp_path / f"{name}-lens.toml"
        write_lens(lens, camera_of(model), np.diag((0.1, 0.1, 0.3, 0.3, 1e-3, 1e-3, 1e-4, 1e-4, 1e-3)) ** 2, ())
        arguments += ["--recording", f"{name}={path}", "--lens", f"{name}={lens}"]
    start = ",".join(map(str, pose(0.0)))
    arguments += ["--start", start, "--out", str(tmp_path), "--save", str(tmp_path / "seen.csv")]
    result = CliRunner().invoke(main, arguments, prog_name="muro")
    assert result.exit_code == 0, result.output
    assert "at the tags' height the map is wrong by less than" in result.output
    assert len((tmp_path / "seen.csv").read_text().splitlines()) > PICTURES
    calibrated = FLEET
    for name in TRUTH:
        calibrated = calibrated.replace(f"[camera.{name}]\n", f'[camera.{name}]\ncalibration = "{name}.toml"\n')
    (tmp_path / "after.toml").write_text(calibrated)
    found = {}
    for name, camera in load_scenario(tmp_path / "after.toml").camera.items():
        assert camera.calibration is not None
        found[name] = placed_camera(camera.calibration)
    x, y = np.meshgrid(np.arange(-1.8, 1.9, 0.4), np.arange(-1.2, 1.3, 0.4))
    places = np.column_stack((x.ravel(), y.ravel()))
    truth = {name: camera_of(model) for name, model in TRUTH.items()}
    off = np.hypot(*map_difference(found, truth, places, robot.tag_z).T)
    assert off.max() < 5e-3
    # Where it lies is what the first picture of the robot says.
    for name, model in TRUTH.items():
        assert math.dist(found[name].model.position, model.position) < 0.05
