"""``muro calibrate`` on rendered pictures, from the print to files that a fleet file names."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result

from basestation.calibration.board import Board
from basestation.calibration.board_views import BoardFinder
from basestation.calibration.camera import camera_of
from basestation.calibration.drive import DriveFit
from basestation.calibration.drive_session import DriveSession
from basestation.calibration.files import write_camera
from basestation.calibration.floor_error import FloorError
from basestation.calibration.tag_tracks import COLUMNS
from basestation.localization.detector import TagDetector
from basestation.localization.of_scenario import make_localizer
from muro_zenoh.cli.main import main
from muro_zenoh.config import load_scenario
from muro_zenoh.config.cameras import camera_model
from muro_zenoh.figures.calibration import Tag, sheets
from muro_zenoh.figures.canvas import style
from muro_zenoh.geometry import TagMount
from muro_zenoh.optics.camera_model import hung
from muro_zenoh.simulation.camera import OverheadCamera
from tests.support.boards import board_pictures

TRUTH = hung(960, 540, position=(0.1, 0.2, 2.0), fov=1.2, tilt=0.1, distortion=(-0.1, 0.03, 0.001, -0.0007, 0.0))
PLACES = ((-0.9, -0.1), (1.0, -0.1), (1.0, 0.9), (-0.9, 0.9), (0.0, 0.35))
FLEET = """
robots = 1
[camera.north]
width = 960
height = 540
calibration = "north.toml"
[arena]
x_min = -0.9
x_max = 1.0
y_min = -0.1
y_max = 0.9
"""


def muro(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["calibrate", *map(str, arguments)], prog_name="muro")


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Pictures of the board and of the floor, and the lens found from them."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "views").mkdir()
    for k, picture in enumerate(board_pictures(TRUTH, Board(), 20, 7)):
        cv2.imwrite(str(folder / "views" / f"{k:02d}.png"), picture)
    mounts = [TagMount(40 + k, 0.16) for k in range(len(PLACES))]
    poses = np.array([(*place, 0.4 * k) for k, place in enumerate(PLACES)])
    film = OverheadCamera(TRUTH)
    cv2.imwrite(str(folder / "floor.png"), film.render(poses, mounts, [0.01] * 5, np.random.default_rng(0)))
    result = muro(
        "intrinsics", folder / "views", "--out", folder / "lens.toml", "--height", 2, "--map", folder / "l.png"
    )
    assert result.exit_code == 0, result.output
    assert "on the floor 2 m below, the lens is wrong by less than" in result.output
    assert re.search(r"y +-?\d\.\d\d \| +\d\.\d", result.output), "a table by cell"
    return folder


def tags(*places: tuple[float, float]) -> list[str]:
    return [part for k, (x, y) in enumerate(places) for part in ("--tag", f"{40 + k}={x},{y}")]


class TestLensAndPlace:
    def test_the_camera_is_within_3_mm_and_the_fleet_file_reads_it(self, lab: Path) -> None:
        result = muro(
            "arena",
            lab / "floor.png",
            "--lens",
            lab / "lens.toml",
            "--out",
            lab / "north.toml",
            "--measured",
            0.1,
            *tags(*PLACES),
        )
        assert result.exit_code == 0, result.output
        (lab / "lab.toml").write_text(FLEET)
        scenario = load_scenario(lab / "lab.toml")
        found = camera_model("north", scenario.camera["north"], scenario.arena)
        finder = make_localizer(scenario, "north")
        finder.locate(cv2.imread(str(lab / "floor.png"), cv2.IMREAD_GRAYSCALE))
        assert len(finder.floor_off) == 5
        assert np.hypot(*np.transpose(finder.floor_off)).max() < 2e-3
        assert not finder.unknown_tags
        assert found.focal == pytest.approx(TRUTH.focal, rel=5e-3)
        assert found.position == pytest.approx(TRUTH.position, abs=3e-3)
        assert found.view[:, :3] == pytest.approx(TRUTH.view[:, :3], abs=2e-3)

    def test_the_map_is_a_picture(self, lab: Path) -> None:
        picture = cv2.imread(str(lab / "l.png"))
        assert picture is not None
        assert picture.std() > 10.0

    def test_clicked_points_do_as_well(self, lab: Path) -> None:
        pixels = TRUTH.project(np.insert(np.array(PLACES), 2, 0.0, axis=1))
        given = [f"{u:.1f},{v:.1f}={x},{y}" for (u, v), (x, y) in zip(pixels, PLACES, strict=True)]
        points = [part for point in given for part in ("--point", point)]
        result = muro("arena", lab / "floor.png", "--lens", lab / "lens.toml", "--out", lab / "p.toml", *points)
        assert result.exit_code == 0, result.output
        assert "5 points" in result.output

    def test_a_mislabelled_tag_and_one_of_another_size_are_named(self, lab: Path) -> None:
        wrong = [*PLACES[:2], (1.1, 0.9), *PLACES[3:]]
        start = ("arena", lab / "floor.png", "--lens", lab / "lens.toml", "--out", lab / "w.toml")
        result = muro(*start, *tags(*wrong))
        assert result.exit_code == 1
        assert re.match(r"muro: tag 42 is at (1\.00|0\.99|1\.01), 0\.\d\d m by the other points", result.stderr)
        result = muro(*start, *tags(*PLACES), "--tag-size", 192)
        assert result.exit_code == 1
        assert re.match(r"muro: tag 40 has a side of 1[56]\d mm on the floor, expected 192 mm", result.stderr)
        assert not (lab / "w.toml").exists()

    def test_bad_pictures_are_refused_with_their_names(self, lab: Path, tmp_path: Path) -> None:
        (tmp_path / "few").mkdir()
        for k in range(3):
            (tmp_path / "few" / f"{k}.png").write_bytes((lab / "views" / f"{k:02d}.png").read_bytes())
        (tmp_path / "few" / "cut.png").write_bytes(b"\x89PNG")
        result = muro("intrinsics", tmp_path / "few", "--out", tmp_path / "x.toml")
        assert result.exit_code == 1
        assert "cut.png: got a file that is no image" in result.output
        assert "good views of the board, expected at least 8" in result.stderr
        result = muro("intrinsics", tmp_path / "few", "--out", tmp_path / "x.toml", "--columns", 7, "--rows", 5)
        assert re.search(r"got the board in none of 4 pictures, expected it in 20\. .*another board\?", result.stderr)
        cv2.imwrite(str(tmp_path / "few" / "other.png"), np.zeros((480, 640), np.uint8))
        result = muro("intrinsics", tmp_path / "few", "--out", tmp_path / "x.toml")
        assert "other.png: got 640 x 480 pixels, expected 960 x 540" in result.stderr
        assert not (tmp_path / "x.toml").exists()

    @pytest.mark.parametrize(
        ("arguments", "problem"),
        [
            (
                ["arena", "floor.png", "--lens", "none.toml", "--out", "x", "--tag", "40=1,2"],
                "none.toml: got no such file",
            ),
            (["arena", "floor.png", "--lens", "lens.toml", "--out", "x", "--tag", "40:1,2"], "--tag: got '40:1,2'"),
            (
                ["arena", "floor.png", "--lens", "lens.toml", "--out", "x", "--tag", "40=1,2", "--family", "X"],
                "--family",
            ),
            (
                ["arena", "none.mp4", "--lens", "lens.toml", "--out", "x", "--tag", "40=1,2"],
                "none.mp4: got no such file",
            ),
            (
                ["arena", "floor.png", "--lens", "lens.toml", "--out", "x", "--tag", "40=-0.9,-0.1"],
                "got 1 point with known places",
            ),
            (["intrinsics", "views", "--out", "x", "--marker", "29"], "--marker: got 0.029 m"),
            (["intrinsics", "none", "--out", "x"], "none: got no such file"),
        ],
    )
    def test_wrong_arguments(
        self, lab: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], problem: str
    ) -> None:
        monkeypatch.chdir(lab)
        result = muro(*arguments)
        assert result.exit_code in (1, 2)
        assert problem in result.stderr


class TestPrint:
    def test_the_board_and_tags_are_a_pdf_to_scale(self, tmp_path: Path) -> None:
        (tmp_path / "lab.toml").write_text("robots = 2\n[camera.north]\n")
        result = muro("board", "--pdf", tmp_path / "b.pdf", "--fleet", tmp_path / "lab.toml", "--floor-tag", 40)
        assert result.exit_code == 0, result.output
        assert "4 sheets" in result.output
        content = (tmp_path / "b.pdf").read_bytes()
        boxes = re.findall(rb"/MediaBox \[ ?([\d. ]+) ?\]", content)
        assert len(boxes) == 4
        points = [float(number) * 25.4 / 72.0 for number in boxes[0].split()]
        assert points == pytest.approx([0.0, 0.0, 297.0, 210.0], abs=0.01)

    def test_what_is_printed_is_the_board_and_the_tag_in_millimetres(self) -> None:
        with style():
            first, second = sheets(Board(), [Tag("r1", "DICT_4X4_50", 7, 0.16)], "a4")
            dots = 120.0 / 25.4  # per millimetre
            views = []
            for figure in (first, second):
                figure.set_dpi(120.0)
                figure.canvas.draw()
                views.append(np.asarray(figure.canvas.buffer_rgba())[..., 0].copy())
        view = BoardFinder(Board()).find("the board", views[0])
        assert len(view.ids) == 40
        apart = np.linalg.norm(view.pixels - view.pixels[0], axis=1)
        assert apart == pytest.approx(1e3 * dots * np.linalg.norm(view.points - view.points[0], axis=1), abs=1.2)
        (tag,) = TagDetector().detect(views[1])
        assert tag.id == 7
        assert tag.side == pytest.approx(160.0 * dots, abs=1.0)

    def test_what_is_too_large_for_the_paper(self, tmp_path: Path) -> None:
        result = muro("board", "--pdf", tmp_path / "b.pdf", "--columns", 12)
        assert result.exit_code == 1
        assert "the board is 360 x 180 mm, expected at most 283 x 180 mm" in result.stderr


class TestDrive:
    def test_bad_files_and_arguments(self, lab: Path, tmp_path: Path) -> None:
        (tmp_path / "lab.toml").write_text("robots = 1\n[camera.north]\nwidth = 960\nheight = 540\n")
        start = ("drive", "r1", "--fleet", tmp_path / "lab.toml", "--out", tmp_path, "--from", tmp_path / "seen.csv")
        lens = ("--lens", f"north={lab / 'lens.toml'}")
        assert "seen.csv: got" in muro(*start, *lens).stderr
        (tmp_path / "seen.csv").write_text("a,b\n")
        assert "got the columns a,b, expected t,camera" in muro(*start, *lens).stderr
        (tmp_path / "seen.csv").write_text(",".join(COLUMNS) + "\n1,north,x\n")
        assert "seen.csv, line 2: got '1,north,x'" in muro(*start, *lens).stderr
        (tmp_path / "seen.csv").write_text(",".join(COLUMNS) + "\n1,north,0,1,1,2,1,2,2,1,2\n")
        assert "camera.north: got no lens" in muro(*start).stderr
        assert "nothing but the size of r1's tag" in muro(*start, *lens).stderr
        (tmp_path / "frames").mkdir()
        cv2.imwrite(str(tmp_path / "frames" / "0.png"), np.zeros((480, 640), np.uint8))
        small = (*start[:-2], *lens, "--recording", f"north={tmp_path / 'frames'}")
        assert (
            "north: got pictures of 640 x 480 pixels, expected 960 x 540, which its lens is for" in muro(*small).stderr
        )
        unwritable = (*small, "--save", tmp_path / "nowhere" / "seen.csv")
        (tmp_path / "frames" / "0.png").unlink()
        cv2.imwrite(str(tmp_path / "frames" / "0.png"), np.zeros((540, 960), np.uint8))
        assert (
            "seen.csv: cannot be written (No such file or directory). Choose another --save" in muro(*unwritable).stderr
        )
        (tmp_path / "bare.toml").write_text("robots = 1\n")
        assert (
            "got a fleet without cameras" in muro("drive", "r1", "--fleet", tmp_path / "bare.toml", "--out", "x").stderr
        )
        assert "camera north saw r1 in 0 places" in muro(*start, *lens, "--height", "north=2").stderr
        assert "got 'south', expected one of north" in muro(*start, "--height", "south=2").stderr
        assert "--frame: got 'north', which has no calibration" in muro(*start, *lens, "--frame", "north").stderr
        assert "--distance: got '40'" in muro(*start, *lens, "--distance", "40").stderr
        assert "no camera saw both floor tags 40 and 41" in muro(*start, *lens, "--distance", "40,41=2").stderr

    def test_the_floor_tags_of_a_calibration_are_kept(
        self, lab: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        camera = camera_of(TRUTH)
        write_camera(tmp_path / "north.toml", camera, np.eye(15), (), {40: PLACES[0] + (0.0,), 44: (0.0, 0.35, 0.02)})
        (tmp_path / "lab.toml").write_text(FLEET)
        fitted = DriveFit({"north": camera}, 1e-8 * np.eye(15), 0.05, 1.0, 1.0, 0)
        error = FloorError(np.zeros(1), np.zeros(1), np.full((1, 1), 1e-3))
        monkeypatch.setattr(DriveSession, "load", lambda self, path: [])
        monkeypatch.setattr(DriveSession, "fit", lambda self, rows: (fitted, error))
        given = ("--fleet", tmp_path / "lab.toml", "--from", "seen.csv", "--height", "north=2.0")
        result = muro("drive", "r1", *given, "--out", tmp_path / "after")
        assert result.exit_code == 0, result.output
        (tmp_path / "north.toml").write_bytes((tmp_path / "after" / "north.toml").read_bytes())
        calibration = load_scenario(tmp_path / "lab.toml").camera["north"].calibration
        assert calibration is not None
        assert calibration.floor_places == {40: (-0.9, -0.1, 0.0), 44: (0.0, 0.35, 0.02)}
