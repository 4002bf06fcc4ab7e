"""`muro camera --show`: what is seen is drawn, once a second where there is no display, and the pictures go on."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from basestation.offline import Eye
from basestation.showing import Screen, Shown
from basestation.sources.source import Shot
from muro_zenoh.config import parse_scenario
from muro_zenoh.config.cameras import camera_model
from muro_zenoh.errors import CameraError
from muro_zenoh.simulation.camera import OverheadCamera

CAMERA = {"width": 640, "height": 480, "z": 2.0, "fov": 1.0}
LAB = parse_scenario({"robots": 1, "camera": {"north": CAMERA}}, "lab.toml", name="lab")


class Pictures:
    """A recording of one robot that stands still."""

    name = "pictures"
    length: int | None = None
    rate = 10.0

    def __init__(self, size: tuple[int, int] = (640, 480)) -> None:
        robot = LAB.robot["r1"]
        eye = OverheadCamera(camera_model("north", LAB.camera["north"], LAB.arena))
        picture = eye.render(np.zeros((1, 3)), [robot.mount], [robot.radius], np.random.default_rng(0))
        self.image = np.ascontiguousarray(picture[: size[1], : size[0]])
        self.t = 0.0
        self.closed = False

    def read(self) -> Shot | None:
        self.t += 0.1
        return Shot(self.image, self.t)

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def headless(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.usefixtures("headless")
def test_without_a_display_a_picture_is_written_every_second(tmp_path: Path) -> None:
    pictures, path = Pictures(), tmp_path / "north.png"
    shown = Shown(pictures, Eye(LAB, "north"), Screen("north", path, clock=lambda: pictures.t))
    written = 0
    for _ in range(31):
        shot = shown.read()
        assert shot is not None
        assert shot.image is pictures.image
        if path.exists():
            written += 1
            drawn = cv2.imread(str(path))
            path.unlink()
    assert 3 <= written <= 4
    assert not list(tmp_path.iterdir()), "no half pictures"
    assert drawn is not None
    assert (np.ptp(drawn.astype(int), axis=2) > 60).sum() > 50, "axes and a name, in colour"
    shown.close()
    assert pictures.closed


def test_an_opencv_without_windows_falls_back_to_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise cv2.error("The function is not implemented")

    monkeypatch.setenv("DISPLAY", ":9")
    monkeypatch.setattr(cv2, "imshow", fails)
    screen = Screen("north", tmp_path / "north.png")
    assert screen.is_due
    screen.show(np.zeros((8, 8, 3), np.uint8))
    assert (tmp_path / "north.png").exists()
    assert not screen.is_due


@pytest.mark.usefixtures("headless")
def test_pictures_of_another_size_are_trouble_of_the_camera(tmp_path: Path) -> None:
    shown = Shown(Pictures((320, 240)), Eye(LAB, "north"), Screen("north", tmp_path / "north.png"))
    with pytest.raises(CameraError, match="camera north: a picture of 320 x 240 pixels, expected 640 x 480"):
        shown.read()
