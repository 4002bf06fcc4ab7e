"""Recordings: videos and directories of images, whole and damaged, and `muro localize` on them."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from basestation.offline import Eye, look_through
from basestation.sources.recordings import ImageDirectory, VideoFile, open_recording
from muro_zenoh.cli.main import main
from muro_zenoh.config import parse_scenario
from muro_zenoh.config.cameras import camera_model
from muro_zenoh.errors import CameraError
from muro_zenoh.simulation.camera import OverheadCamera

FLEET = (
    "robots = 2\n[camera.north]\nwidth = 640\nheight = 480\nz = 2.0\nfov = 1.0\n[arena]\nx_min = -1.0\nx_max = 1.0\n"
)
LAB = parse_scenario(
    {
        "robots": 2,
        "camera": {"north": {"width": 640, "height": 480, "z": 2.0, "fov": 1.0}},
        "arena": {"x_min": -1.0, "x_max": 1.0},
    },
    "lab.toml",
    name="lab",
)
RATE = 30.0
"""Of the recordings: not the one that is assumed for images."""


def pose(robot: int, k: int) -> tuple[float, float, float]:
    """Where a robot is in a picture."""
    return (0.3 * (2 * robot - 1) + 0.01 * k, 0.1 - 0.2 * robot, 0.05 * k)


def pictures(count: int) -> list[np.ndarray]:
    lens = OverheadCamera(camera_model("north", LAB.camera["north"], LAB.arena))
    mounts = [robot.mount for robot in LAB.robot.values()]
    rng = np.random.default_rng(0)
    return [lens.render(np.array([pose(0, k), pose(1, k)]), mounts, [0.17, 0.17], rng) for k in range(count)]


@pytest.fixture
def images(tmp_path: Path) -> Path:
    """A directory of twelve images, and the fleet file beside it."""
    (tmp_path / "lab.toml").write_text(FLEET)
    folder = tmp_path / "frames"
    folder.mkdir()
    for k, picture in enumerate(pictures(12)):
        cv2.imwrite(str(folder / f"{k:03d}.png"), picture)
    return folder


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """The same as a video, with the fleet file beside it."""
    (tmp_path / "lab.toml").write_text(FLEET)
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), RATE, (640, 480))
    for picture in pictures(40):
        writer.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


def rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def check(row: dict[str, str]) -> None:
    k = round(float(row["t"]) * RATE)
    x, y, theta = pose(int(row["robot"][1:]) - 1, k)
    assert float(row["x"]) == pytest.approx(x, abs=2e-3)
    assert float(row["y"]) == pytest.approx(y, abs=2e-3)
    assert float(row["theta"]) == pytest.approx(theta, abs=0.02)
    assert 0.0 < float(row["sigma_x"]) < 2e-3


def test_the_poses_of_images(images: Path, tmp_path: Path) -> None:
    out = tmp_path / "poses.csv"
    result = CliRunner().invoke(
        main, ["localize", str(images), "--rate", str(RATE), "--fleet", str(tmp_path / "lab.toml"), "--out", str(out)]
    )
    assert result.exit_code == 0, result.output
    assert "12 pictures, 24 poses" in result.output
    got = rows(out)
    assert len(got) == 24
    for row in got:
        check(row)


def test_the_poses_of_a_video_and_an_annotated_one(video: Path, tmp_path: Path) -> None:
    out, drawn = tmp_path / "poses.csv", tmp_path / "seen.mp4"
    arguments = ["localize", str(video), "--fleet", str(tmp_path / "lab.toml"), "--out", str(out), "--draw", str(drawn)]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    got = rows(out)
    assert len(got) >= 78
    for row in got:
        check(row)
    seen = VideoFile(drawn)
    assert seen.length == 40
    assert seen.rate == pytest.approx(RATE)
    capture = cv2.VideoCapture(str(drawn))
    good, image = capture.read()
    capture.release()
    assert good
    # The axes are in colour where the robots are.
    model = camera_model("north", LAB.camera["north"], LAB.arena)
    (u, v), (ahead_u, ahead_v) = model.project(np.array([[*pose(0, 0)[:2], 0.15], [-0.1, 0.1, 0.15]]))
    half = image[round((v + ahead_v) / 2), round((u + ahead_u) / 2)].astype(int)
    assert half[2] > half[0] + 60, "red"


def test_poses_that_cannot_be_written(images: Path, tmp_path: Path) -> None:
    out = tmp_path / "nowhere" / "poses.csv"
    result = CliRunner().invoke(
        main, ["localize", str(images), "--rate", str(RATE), "--fleet", str(tmp_path / "lab.toml"), "--out", str(out)]
    )
    assert result.exit_code == 1
    assert "poses.csv: cannot be written (No such file or directory). Choose another --out" in result.output


def test_a_damaged_image_is_named_and_the_others_are_used(images: Path) -> None:
    (images / "005.png").write_bytes(b"\x89PNG\r\n but no more")
    looked = list(look_through(ImageDirectory(images, RATE), Eye(LAB, "north")))
    assert len(looked) == 12
    assert [i for i, each in enumerate(looked) if each.shot is None] == [5]
    assert "005.png: got a file that is no image, or a damaged one" in looked[5].complaints[0]
    assert sum(len(each.fixes) for each in looked) == 22


def test_a_video_that_was_cut_off_is_used_as_far_as_it_goes(video: Path) -> None:
    whole = video.read_bytes()
    video.write_bytes(whole[: len(whole) // 2])
    looked = list(look_through(open_recording(video, RATE), Eye(LAB, "north")))
    assert looked[-1].shot is None
    assert "expected 40 as its header says. The file is damaged or was cut off" in looked[-1].complaints[0]
    assert 15 <= sum(each.shot is not None for each in looked) <= 22


def test_what_is_no_recording_is_refused_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "lab.toml").write_text(FLEET)
    (tmp_path / "noise.mp4").write_bytes(np.random.default_rng(0).bytes(5000))
    (tmp_path / "empty").mkdir()
    for what, why in (
        ("noise.mp4", "no video, or a damaged one"),
        ("empty", "no images"),
        ("nowhere.mp4", "no such file"),
    ):
        with pytest.raises(CameraError, match=why):
            open_recording(tmp_path / what, RATE)
        arguments = [
            "localize",
            str(tmp_path / what),
            "--fleet",
            str(tmp_path / "lab.toml"),
            "--out",
            str(tmp_path / "p"),
        ]
        result = CliRunner().invoke(main, arguments)
        assert result.exit_code == 1
        assert why in result.output


def test_pictures_of_another_size_are_refused_with_both_sizes(images: Path, tmp_path: Path) -> None:
    (tmp_path / "lab.toml").write_text(FLEET.replace("640", "800"))
    arguments = [
        "localize",
        str(images),
        "--rate",
        str(RATE),
        "--fleet",
        str(tmp_path / "lab.toml"),
        "--out",
        str(tmp_path / "p.csv"),
    ]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 1
    assert "640 x 480 pixels, expected 800 x 480" in result.output


def test_the_camera_is_asked_for_where_there_are_several(images: Path, tmp_path: Path) -> None:
    (tmp_path / "lab.toml").write_text(FLEET + "[camera.south]\n")
    arguments = [
        "localize",
        str(images),
        "--rate",
        str(RATE),
        "--fleet",
        str(tmp_path / "lab.toml"),
        "--out",
        str(tmp_path / "p.csv"),
    ]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2
    assert "--camera: got nothing, expected one of north, south" in result.output
    assert CliRunner().invoke(main, [*arguments, "--camera", "north"]).exit_code == 0


def test_what_is_not_believed_is_counted(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    shots = pictures(12)
    for k in range(12):
        cv2.imwrite(str(folder / f"{k:03d}.png"), shots[k] if k != 6 else shots[k][:, ::-1])  # once it is mirrored
    looked = list(look_through(ImageDirectory(folder, RATE), Eye(LAB, "north")))
    for k, each in enumerate(looked):
        for fix in each.fixes:
            assert math.dist(fix.pose[:2], pose(int(fix.name[1:]) - 1, k)[:2]) < 3e-3
    assert not looked[6].fixes
