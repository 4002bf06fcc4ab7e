"""The calibrated camera against OpenCV's projectPoints and undistortPoints, and its settings."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from basestation.localization.floor_map import FloorMap
from muro_zenoh.config import load_scenario, parse_scenario
from muro_zenoh.config.cameras import camera_model
from muro_zenoh.errors import ConfigError, ParameterError
from muro_zenoh.geometry import Bounds
from muro_zenoh.optics.camera_model import CameraModel, calibrated, hung, planar, rotation_matrix

ROOM = Bounds(-2.35, 2.35, -1.75, 1.75)
LENS = (-0.12, 0.03, 0.001, -0.0007, -0.002)


def oracle(model: CameraModel, points: np.ndarray) -> np.ndarray:
    """Pixels of places by OpenCV."""
    rotation, _ = cv2.Rodrigues(model.view[:, :3])
    pixels, _ = cv2.projectPoints(points, rotation, model.view[:, 3], model.matrix, np.array(model.distortion))
    return pixels[:, 0]


def places(rng: np.random.Generator, count: int = 300) -> np.ndarray:
    return np.column_stack((rng.uniform(-2, 2, count), rng.uniform(-1.5, 1.5, count), rng.uniform(0.0, 0.5, count)))


class TestProjection:
    # Whole hundredths: OpenCV's rotation vector of a turn that is nearly half a turn has an error of its own.
    @given(tilt=st.integers(-15, 15), heading=st.integers(-20, 20), strength=st.floats(-1.0, 1.0))
    def test_agrees_with_opencv(self, tilt: int, heading: int, strength: float) -> None:
        lens = (strength * -0.12, strength * 0.03, strength * 1e-3, -7e-4, 0.0)
        model = hung(
            1280, 720, position=(0.1, -0.1, 3.0), tilt=tilt / 100, heading=heading / 100, fov=1.4, distortion=lens
        )
        points = places(np.random.default_rng(1))
        assert model.project(points) == pytest.approx(oracle(model, points), abs=1e-6)

    def test_the_picture_is_the_world_from_above(self) -> None:
        model = hung(1280, 720, position=(1.0, 2.0, 3.0), fov=1.4)
        middle, right, up = model.project(np.array([[1.0, 2.0, 0.0], [1.5, 2.0, 0.0], [1.0, 2.5, 0.0]]))
        assert middle == pytest.approx([639.5, 359.5])
        assert right[0] > middle[0]
        assert up[1] < middle[1]
        turned = hung(1280, 720, position=(1.0, 2.0, 3.0), fov=1.4, heading=math.pi / 2)
        assert turned.project(np.array([1.0, 2.5, 0.0])) == pytest.approx(right), "its right edge points to +y"
        tilted = hung(1280, 720, position=(1.0, 2.0, 3.0), fov=1.4, tilt=math.atan2(0.5, 3.0))
        assert tilted.project(np.array([1.0, 2.5, 0.0])) == pytest.approx(middle), "it leans to the picture's top"

    def test_higher_things_look_further_out(self) -> None:
        model = hung(1280, 720, position=(0.0, 0.0, 3.0), fov=1.4)
        low, high = model.project(np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.3]]))
        assert (high[0] - 639.5) / (low[0] - 639.5) == pytest.approx(3.0 / 2.7)

    def test_what_is_behind_it_or_folded_back_by_the_lens_is_nowhere(self) -> None:
        model = hung(1280, 720, position=(0.0, 0.0, 3.0), fov=1.0, distortion=(-0.3, 0.0, 0.0, 0.0, 0.0))
        assert np.isnan(model.project(np.array([0.0, 0.0, 3.5]))).all()
        # At 60 degrees aside the radius has passed its greatest value, at 1 / sqrt(0.9), and the lens is of no use.
        assert np.isnan(model.project(np.array([3.0 * math.tan(math.radians(60.0)), 0.0, 0.0]))).all()

    def test_a_rotation_vector_is_opencvs(self) -> None:
        rng = np.random.default_rng(0)
        for vector in (*rng.normal(size=(20, 3)), np.zeros(3), np.array([math.pi, 0.0, 0.0])):
            assert rotation_matrix(tuple(vector)) == pytest.approx(cv2.Rodrigues(vector)[0], abs=1e-12)

    def test_it_sees_just_the_rectangle_that_it_shall(self) -> None:
        for tilt in (0.0, 0.15):
            model = hung(1280, 720, position=(0.0, 0.0, 3.0), tilt=tilt, sees=ROOM, distortion=LENS)
            x, y = np.meshgrid(np.linspace(-2.35, 2.35, 21), np.linspace(-1.75, 1.75, 21))
            margin = FloorMap(model).margin(model.project(np.stack((x, y, np.zeros_like(x)), axis=-1)))
            assert (margin > -1e-6).all()
            assert margin.min() < 1.0


class TestTheWayBack:
    def test_rays_undo_the_lens_as_opencv_does(self) -> None:
        model = hung(1280, 720, position=(0.1, -0.1, 3.0), sees=ROOM, distortion=LENS)
        pixels = model.project(places(np.random.default_rng(2)))
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-12)
        expected = cv2.undistortPoints(pixels, model.matrix, np.array(LENS), criteria=criteria)[:, 0]
        assert model.rays(pixels) == pytest.approx(expected, abs=1e-9)

    @pytest.mark.parametrize("tilt", [0.0, 0.2])
    def test_metres_of_opencvs_pixels_on_planes_of_any_height(self, tilt: float) -> None:
        model = hung(1280, 720, position=(0.1, -0.1, 3.0), tilt=tilt, sees=ROOM, distortion=LENS)
        points = places(np.random.default_rng(3))
        metres = FloorMap(model).to_metres(oracle(model, points), points[:, 2])
        assert metres == pytest.approx(points[:, :2], abs=1e-9)

    def test_a_camera_that_is_known_on_one_plane_sees_all_heights_there(self) -> None:
        matrix = np.array([[200.0, 0.0, 320.0], [0.0, -200.0, 240.0], [0.0, 0.0, 1.0]])
        floor = FloorMap(planar(640, 480, matrix))
        for height in (0.0, 0.4):
            assert floor.to_metres(np.array([420.0, 240.0]), height) == pytest.approx([0.5, 0.0])
            assert floor.to_pixels(np.array([0.5, 0.0]), height) == pytest.approx([420.0, 240.0])

    def test_a_bumped_camera_is_the_same_camera_in_another_place(self) -> None:
        model = hung(1280, 720, position=(0.0, 0.0, 3.0), sees=ROOM)
        bumped = model.moved((math.radians(0.3), 0.0, 0.0))
        shift = bumped.project(np.zeros(3)) - model.project(np.zeros(3))
        assert np.abs(shift) == pytest.approx([0.0, model.focal[1] * math.tan(math.radians(0.3))], abs=1e-9)
        assert bumped.position == pytest.approx(model.position)


class TestRefusals:
    def test_a_lens_that_folds_the_picture(self) -> None:
        with pytest.raises(ParameterError, match="one direction"):
            hung(1280, 720, position=(0.0, 0.0, 3.0), fov=2.0, distortion=(-0.3, 0.0, 0.0, 0.0, 0.0))

    def test_no_picture_and_no_numbers(self) -> None:
        with pytest.raises(ParameterError, match="0 x 720"):
            CameraModel(0, 720, np.eye(3, 4))
        with pytest.raises(ParameterError, match="finite 3 x 4"):
            CameraModel(1280, 720, np.full((3, 4), np.nan))
        with pytest.raises(ParameterError, match="focal"):
            CameraModel(1280, 720, np.eye(3, 4), focal=(0.0, 1.0))


CALIBRATION = {
    "width": 1280,
    "height": 720,
    "focal": [610.0, 612.0],
    "centre": [641.0, 357.0],
    "distortion": list(LENS),
    "position": [0.1, -0.1, 3.0],
    "rotation": [3.1, 0.05, 0.02],
}


def lab(camera: dict[str, object]) -> dict[str, object]:
    return {"robots": 1, "camera": {"north": camera}}


class TestSettings:
    def test_a_calibration_is_a_table_or_a_file_beside_the_fleet_file(self, tmp_path: Path) -> None:
        rows = "\n".join(f"{key} = {value}" for key, value in CALIBRATION.items())
        (tmp_path / "north.toml").write_text(rows)
        (tmp_path / "lab.toml").write_text('robots = 1\n[camera.north]\ncalibration = "north.toml"\n')
        (tmp_path / "runs").mkdir()
        (tmp_path / "runs" / "run.toml").write_text('fleet = "../lab.toml"\n')
        inline = parse_scenario(lab({"calibration": CALIBRATION}), "lab.toml", name="lab")
        expected = calibrated(
            1280,
            720,
            focal=(610.0, 612.0),
            centre=(641.0, 357.0),
            distortion=LENS,
            position=(0.1, -0.1, 3.0),
            rotation=(3.1, 0.05, 0.02),
        )
        points = places(np.random.default_rng(4))
        for scenario in (
            inline,
            load_scenario(tmp_path / "lab.toml"),
            load_scenario(tmp_path / "runs" / "run.toml"),
        ):
            model = camera_model("north", scenario.camera["north"], scenario.arena)
            assert model.project(points) == pytest.approx(expected.project(points), nan_ok=True)

    def test_an_error_in_a_calibration_names_its_file_and_key(self, tmp_path: Path) -> None:
        rows = "\n".join(f"{key} = {value}" for key, value in {**CALIBRATION, "focal": [0.0, 600.0]}.items())
        (tmp_path / "north.toml").write_text(rows)
        (tmp_path / "lab.toml").write_text('robots = 1\n[camera.north]\ncalibration = "north.toml"\n')
        with pytest.raises(ConfigError, match=r"^north\.toml: camera\.north\.calibration\.focal: got"):
            load_scenario(tmp_path / "lab.toml")
        (tmp_path / "north.toml").unlink()
        with pytest.raises(ConfigError, match=r"camera\.north\.calibration: got 'north\.toml'.*Leave this line out"):
            load_scenario(tmp_path / "lab.toml")

    def test_by_default_it_sees_the_arena_and_a_margin(self) -> None:
        scenario = parse_scenario(lab({}), "lab.toml", name="lab")
        model = camera_model("north", scenario.camera["north"], scenario.arena)
        corners = np.array([[x, y, 0.15] for x, y in scenario.arena.corners])
        assert FloorMap(model).margin(model.project(corners)).min() > 20.0

    def test_a_camera_hangs_where_it_is_said(self) -> None:
        scenario = parse_scenario(lab({"x": 1.0, "y": 0.5, "z": 2.0, "fov": 1.2}), "lab.toml", name="lab")
        model = camera_model("north", scenario.camera["north"], scenario.arena)
        assert model.position == pytest.approx([1.0, 0.5, 2.0])
        assert 2.0 * math.atan(640.0 / model.focal[0]) == pytest.approx(1.2)

    @pytest.mark.parametrize(
        ("camera", "problem"),
        [
            ({"calibration": CALIBRATION, "z": 3.0}, "got calibration and z"),
            ({"calibration": {**CALIBRATION, "width": 640}}, r"640 x 720 pixels, expected one for .* 1280 x 720"),
            ({"calibration": {"width": 1280}}, "calibration.height: got nothing"),
            ({"calibration": {**CALIBRATION, "focus": 3}}, "calibration.focus: got an unknown key"),
            ({"fov": 4.0}, r"camera\.north\.fov: got 4"),
            ({"distortion": [0.1]}, r"camera\.north\.distortion"),
        ],
    )
    def test_contradictions_are_refused(self, camera: dict[str, object], problem: str) -> None:
        with pytest.raises(ConfigError, match=problem):
            parse_scenario(lab(camera), "lab.toml", name="lab")

    def test_a_lens_that_no_camera_has_is_a_wrong_setting(self) -> None:
        scenario = parse_scenario(lab({"distortion": [-0.9, 0, 0, 0, 0], "fov": 1.5}), "lab.toml", name="lab")
        with pytest.raises(ConfigError, match=r"camera\.north\.distortion: got .* expected a lens"):
            camera_model("north", scenario.camera["north"], scenario.arena)
