"""Placing a camera by marks: against the truth and OpenCV, its bound, and bad marks."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from basestation.calibration.arena import Mark, bounds_on_floor, place_camera
from basestation.calibration.files import calibration_text, heat_map, read_marks
from basestation.localization.floor_map import FloorMap
from muro_zenoh.cli.main import main
from muro_zenoh.config import load_scenario
from muro_zenoh.config.cameras import camera_model
from muro_zenoh.errors import CameraError
from muro_zenoh.geometry import Bounds
from muro_zenoh.optics.camera_model import CameraModel, hung

ARENA = Bounds(-2.1, 2.1, -1.5, 1.5)
LENS = (-0.1, 0.02, 4e-4, -3e-4, 0.0)
CORNERS = ((-2.0, -1.4), (0.0, -1.45), (2.0, -1.4), (2.0, 1.4), (0.1, 1.45), (-2.0, 1.4), (0.2, 0.1), (-1.0, 0.3))


def truth(tilt: float = 0.12, heading: float = 0.05) -> CameraModel:
    at = (0.15, -0.1, 3.02)
    return hung(1280, 720, position=at, tilt=tilt, heading=heading, sees=ARENA.shrunk(-0.4), distortion=LENS)


def marks(camera: CameraModel, count: int = 8, noise: float = 0.0, seed: int = 0) -> list[Mark]:
    rng = np.random.default_rng(seed)
    pixels = camera.project(np.array([(x, y, 0.0) for x, y in CORNERS[:count]])) + rng.normal(0.0, noise, (count, 2))
    return [Mark(f"m{i}", *pixels[i].tolist(), *CORNERS[i]) for i in range(count)]


def floor_errors(found: CameraModel, camera: CameraModel) -> np.ndarray:
    """How wrong places are in the cells of the bound [m]."""
    x, y = np.meshgrid(-2.1 + 0.5 * (np.arange(9) + 0.5), 1.5 - 0.5 * (np.arange(6) + 0.5))
    places = np.stack((x, y, np.zeros_like(x)), axis=-1)
    off = FloorMap(found).to_metres(camera.project(places)) - places[..., :2]
    return np.hypot(off[..., 0], off[..., 1])


@pytest.mark.parametrize("count", [4, 8])
def test_exact_marks_give_the_exact_place(count: int) -> None:
    camera = truth()
    wanted = marks(camera, count) if count > 4 else [marks(camera)[i] for i in (0, 2, 3, 5)]
    placed = place_camera(camera.moved((0.2, 0.1, 0.5), (0.3, 0.0, 0.2)), wanted, camera="north")  # it was elsewhere
    assert placed.camera.view == pytest.approx(camera.view, abs=1e-6)
    assert max(placed.errors) < 1e-6


def test_the_bound_covers_the_truth() -> None:
    """Over 20 calibrations in at least 90 % of the cells; and it is not twice as large as it must be."""
    covered, ratios = [], []
    for seed in range(20):
        camera = truth(0.02 * (seed % 8), 0.1 * (seed % 3))
        placed = place_camera(camera, marks(camera, noise=0.5, seed=seed), camera="north")
        errors, bound = floor_errors(placed.camera, camera), np.array(bounds_on_floor(placed, ARENA))
        assert bound.shape == (6, 9)
        seen = np.isfinite(bound) & np.isfinite(errors)
        covered.append((errors[seen] <= bound[seen]).mean())
        ratios.append(np.median(bound[seen]) / np.median(errors[seen]))
        assert errors[seen].max() < 0.015  # in a corner of the arena, for clicks with half a pixel of noise
    assert np.mean(covered) >= 0.9
    assert np.median(ratios) < 5.0


def test_a_mislabelled_mark_is_named_however_many_others_are_right() -> None:
    wrong = marks(truth(), noise=0.3)
    wrong[3] = wrong[3]._replace(x=wrong[3].x - 0.1)
    with pytest.raises(CameraError, match=r"mark m3 is (9\d|10\d|11\d) mm from where the 7 others put it.*mislabelled"):
        place_camera(truth(), wrong, camera="north")


def test_two_swapped_marks_of_five_are_refused_without_a_name() -> None:
    wrong = marks(truth(), 5)
    a, b = wrong[0], wrong[1]
    wrong[:2] = [a._replace(u=b.u, v=b.v), b._replace(u=a.u, v=a.v)]
    with pytest.raises(CameraError, match=r"contradict each other by \d+ mm"):
        place_camera(truth(), wrong, camera="north")


def test_too_few_marks_or_marks_in_a_line_are_refused() -> None:
    with pytest.raises(CameraError, match="got 3 marks, expected at least 4"):
        place_camera(truth(), marks(truth(), 3), camera="north")
    line = [Mark(f"m{i}", 100.0 * i, 300.0 + 0.1 * i, 0.5 * i, 0.0) for i in range(5)]
    with pytest.raises(CameraError, match="in one line"):
        place_camera(truth(), line, camera="north")


def test_the_command_writes_a_calibration_that_the_fleet_file_takes(tmp_path: Path) -> None:
    camera = truth(0.0)
    fov = 2.0 * math.atan(640.0 / camera.focal[0])
    fleet = f"robots = 1\n[camera.north]\nfov = {fov!r}\ndistortion = {list(LENS)}\n"
    (tmp_path / "lab.toml").write_text(fleet)
    rows = [f"{m.name}, {m.u!r}, {m.v!r}, {m.x}, {m.y}" for m in marks(camera)]
    (tmp_path / "marks.csv").write_text("\n".join(["name, u, v, x, y", *rows]) + "\n")
    out = tmp_path / "north.toml"
    arguments = ["calibrate", "arena", str(tmp_path / "lab.toml"), "north", "--marks", str(tmp_path / "marks.csv")]
    result = CliRunner().invoke(main, [*arguments, "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "0.0 mm" in result.output
    (tmp_path / "lab.toml").write_text('robots = 1\n[camera.north]\ncalibration = "north.toml"\n')
    scenario = load_scenario(tmp_path / "lab.toml")
    model = camera_model("north", scenario.camera["north"], scenario.arena)
    assert model.view == pytest.approx(camera.view, abs=1e-6)
    assert CliRunner().invoke(main, [*arguments[:3], "south", *arguments[4:], "--out", str(out)]).exit_code == 2


def test_a_wrong_line_of_the_marks_is_named(tmp_path: Path) -> None:
    path = tmp_path / "marks.csv"
    path.write_text("name,u,v,x,y\na,1,2,3,4\nb,1,two,3,4\n")
    with pytest.raises(CameraError, match=r"marks\.csv, line 3: got .*two"):
        read_marks(path)
    path.write_text("name,u,v,x,y\na,1,2,3,4\na,1,2,3,4\n")
    with pytest.raises(CameraError, match=r"line 3: .* a name of its own"):
        read_marks(path)
    with pytest.raises(CameraError, match="No such file"):
        read_marks(tmp_path / "nothing.csv")


def test_the_heat_map_has_a_number_per_cell() -> None:
    assert heat_map([[0.0012, math.nan], [0.01, 0.0005]]).split() == ["1.2", ".", "10.0", "0.5"]
    assert calibration_text(truth(), ("a",)).startswith("# a\nwidth = 1280\n")
