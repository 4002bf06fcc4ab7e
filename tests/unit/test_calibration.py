"""Calibration: its derivatives, lenses from rendered boards, places from points and drives, and what is refused."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares as oracle

from basestation.calibration.arena import Landmark, fit_arena
from basestation.calibration.board import Board
from basestation.calibration.board_views import BoardFinder, BoardView
from basestation.calibration.bundle import Distance
from basestation.calibration.camera import ALL, Camera, camera_of, project
from basestation.calibration.drive import DriveFit, fit_drive
from basestation.calibration.edges import on_edges
from basestation.calibration.floor_error import floor_error, lens_difference
from basestation.calibration.least_squares import fit
from basestation.calibration.lens import LensFit, fit_lens
from basestation.calibration.lens_prior import LensPrior
from basestation.calibration.shared_map import map_difference
from basestation.calibration.tag_tracks import Knots
from basestation.localization.detector import TagDetector
from basestation.localization.floor_map import FloorMap
from basestation.localization.markers import Marker
from muro_zenoh.errors import CalibrationError, ParameterError
from muro_zenoh.geometry import Bounds, Pose2, TagMount
from muro_zenoh.optics.camera_model import hung, rotation_matrix, rotation_vector
from muro_zenoh.simulation.camera import OverheadCamera
from tests.support.boards import board_pictures

LENS = (-0.1, 0.03, 0.001, -0.0007, 0.0)
SIZE = (640, 360)
TRUTH = hung(*SIZE, position=(0.1, 0.2, 3.0), fov=1.2, tilt=0.1, heading=0.2, distortion=LENS)
BOARD = Board()
NUMBERS = np.diag((0.6, 0.6, 0.8, 0.8, 1e-3, 2e-3, 1e-4, 1e-4, 1e-3)) ** 2


@cache
def views(count: int = 14, seed: int = 7, tilt: float = 0.6, spread: float = 1.0) -> tuple[BoardView, ...]:
    finder = BoardFinder(BOARD)
    found = []
    for k, picture in enumerate(board_pictures(TRUTH, BOARD, count, seed, tilt=tilt, spread=spread)):
        try:
            found.append(finder.find(f"{k:02d}.png", picture))
        except CalibrationError:  # half of it is outside the picture
            continue
    return tuple(found)


def calibrate(given: tuple[BoardView, ...], drop: bool = False) -> LensFit:
    return fit_lens(given, SIZE, height=3.0, drop=drop)


def noisy(lens: Camera, rng: np.random.Generator) -> LensPrior:
    """The lens as a calibration may have found it."""
    wrong = lens.lens + np.sqrt(np.diag(NUMBERS)) * rng.normal(size=9)
    return LensPrior(Camera(lens.width, lens.height, wrong, lens.turn, lens.shift), NUMBERS)


class TestMathematics:
    def test_pixels_are_the_models_and_derivatives_are_differences(self) -> None:
        camera = camera_of(TRUTH)
        points = np.random.default_rng(0).uniform((-1, -0.7, 0.0), (1, 0.7, 0.3), (20, 3))
        pixels, by_camera, by_point = project(camera, points)
        assert pixels == pytest.approx(TRUTH.project(points), abs=1e-9)
        for k in range(ALL):
            step = np.zeros(ALL)
            step[k] = 1e-6
            ahead, behind = (project(camera.adjusted(s), points).pixels for s in (step, -step))
            assert by_camera[:, :, k] == pytest.approx((ahead - behind) / 2e-6, rel=1e-4, abs=1e-4)
        for k in range(3):
            shift = 1e-6 * np.eye(3)[k]
            difference = (project(camera, points + shift).pixels - project(camera, points - shift).pixels) / 2e-6
            assert by_point[:, :, k] == pytest.approx(difference, rel=1e-4, abs=1e-4)

    def test_the_least_squares_are_scipys(self) -> None:
        t = np.linspace(0, 3, 30)
        y = 2.0 * np.exp(-1.3 * t) + 0.1 * np.sin(9 * t)

        def residuals(x: np.ndarray) -> np.ndarray:
            return x[0] * np.exp(x[1] * t) - y

        def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return residuals(x), np.column_stack((np.exp(x[1] * t), x[0] * t * np.exp(x[1] * t)))

        start = np.array((0.5, 0.5))
        assert fit(start, evaluate, np.add).state == pytest.approx(oracle(residuals, start).x, abs=1e-5)

    def test_a_rotation_vector_and_back(self) -> None:
        rng = np.random.default_rng(0)
        for vector in (*rng.normal(size=(20, 3)), np.zeros(3), (math.pi - 1e-9, 0.0, 0.0), (0.0, math.pi, 0.0)):
            turn = rotation_matrix(tuple(vector))
            assert rotation_matrix(rotation_vector(turn)) == pytest.approx(turn, abs=1e-12)


class TestEdges:
    @pytest.mark.parametrize("blur", [0.5, 1.2])
    def test_a_tag_is_as_large_as_it_is_however_blurred(self, blur: float) -> None:
        model = hung(960, 540, position=(0.0, 0.0, 2.0), fov=1.2, distortion=LENS)
        film, mount = OverheadCamera(model, blur=blur), TagMount(7, 0.16)
        rng = np.random.default_rng(0)
        ratios, off = [], []
        for pose in ((0.1, 0.1, 0.3), (0.9, 0.4, 1.0), (-0.8, -0.4, 2.0)):
            picture = film.render(np.array([pose]), [mount], [0.01], rng)
            (found,) = TagDetector().detect(picture)
            sharp, true = on_edges(picture, found), film.tag_corners(np.array(pose), mount)
            assert sharp is not None
            ratios.append(sharp.side / Marker(7, true).side)
            off.append(np.abs(sharp.corners - true).max())
        assert np.mean(ratios) == pytest.approx(1.0, abs=2e-3)
        assert max(off) < 0.15

    def test_a_tag_at_the_edge_of_the_picture_or_without_contrast_is_not_used(self) -> None:
        square = np.array(((0.5, 0.5), (40.5, 0.5), (40.5, 40.5), (0.5, 40.5)))
        picture = np.full((90, 90), 100, dtype=np.uint8)
        assert on_edges(picture, Marker(7, square)) is None
        assert on_edges(picture, Marker(7, square + 20.0)) is None


class TestLens:
    def test_the_focal_length_is_within_half_a_percent_and_the_bound_holds(self) -> None:
        result = calibrate(views())
        assert result.camera.lens[:2] == pytest.approx(TRUTH.focal, rel=5e-3)
        bound = result.floor_error(3.0).bound
        off = np.hypot(*np.moveaxis(lens_difference(result.camera, camera_of(TRUTH), 3.0), 2, 0))
        assert (off <= bound).mean() >= 0.9
        assert np.median(bound) < 2e-3, "it says something"

    def test_a_blurred_view_is_named(self) -> None:
        finder, large = BoardFinder(BOARD), hung(1280, 720, position=(0.0, 0.0, 3.0), fov=1.2, distortion=LENS)
        pictures = board_pictures(large, BOARD, 4, 7, spread=0.3, tilt=0.3, blurred={2: 1.7})
        mixed = [finder.find(f"{k}.png", picture) for k, picture in enumerate(pictures)]
        with pytest.raises(CalibrationError, match=r"^2\.png is blurred: by [12]\.\d px\. .*--drop"):
            fit_lens(mixed, (1280, 720), height=3.0)
        with pytest.raises(CalibrationError, match=r"got 3 good views.*\n  2\.png is blurred"):
            fit_lens(mixed, (1280, 720), height=3.0, drop=True)

    @pytest.mark.parametrize("blur", [3.0, 6.0])
    def test_so_is_one_in_which_the_board_is_not_even_found(self, blur: float) -> None:
        camera = hung(960, 540, position=(0.0, 0.0, 3.0), fov=1.2, distortion=LENS)
        (picture,) = board_pictures(camera, BOARD, 1, 7, spread=0.3, blurred={0: blur})
        with pytest.raises(CalibrationError, match=r"^07\.png: got \d of 40 .*The picture is blurred: by") as refused:
            BoardFinder(BOARD).find("07.png", picture)
        said = re.search(r"by (\d\.\d) px", str(refused.value))
        assert said is not None
        assert float(said[1]) == pytest.approx(blur, rel=0.2)

    def test_a_board_of_which_most_is_outside_is_not_called_blurred(self) -> None:
        camera = hung(960, 540, position=(0.0, 0.0, 3.0), fov=1.2, distortion=LENS)
        (picture,) = board_pictures(camera, BOARD, 1, 7, spread=0.3)
        picture[:, 380:] = 120
        with pytest.raises(CalibrationError, match=r"Much of it is outside the picture|Hold the board flat"):
            BoardFinder(BOARD).find("07.png", picture)

    def test_a_view_that_contradicts_the_others_is_named_however_few_pixels_it_is_off(self) -> None:
        odd = views()[3]
        bent = odd.points.copy()
        bent[:, 0] += 0.003 * (bent[:, 0] / 0.135 - 1.0) ** 2  # a print that is 3 mm too wide at its ends
        mixed = (*views()[:3], BoardView("other.png", odd.ids, bent, odd.pixels, odd.blur), *views()[4:])
        with pytest.raises(CalibrationError, match=r"^other\.png contradicts .* [01]\.\d\d px off"):
            calibrate(mixed)
        result = calibrate(mixed, drop=True)
        assert "other.png" not in result.used
        assert result.camera.lens[0] == pytest.approx(TRUTH.focal[0], rel=5e-3)

    def test_wrong_numbers_of_corners_are_named(self) -> None:
        odd = views()[5]
        for wrong in (odd.points[::-1].copy(), np.roll(odd.points, 1, 0)):
            mixed = (*views()[:5], BoardView("swapped.png", odd.ids, wrong, odd.pixels, odd.blur), *views()[6:])
            with pytest.raises(CalibrationError, match=r"^swapped\.png contradicts"):
                calibrate(mixed)

    def test_views_that_are_alike_are_refused(self) -> None:
        same = tuple(
            BoardView(
                f"{k}.png", v.ids, v.points, v.pixels + np.random.default_rng(k).normal(0, 0.05, v.pixels.shape), 0.9
            )
            for k, v in enumerate(views()[:1] * 12)
        )
        with pytest.raises(CalibrationError, match="alike: got 1 different view among 12"):
            calibrate(same)
        with pytest.raises(CalibrationError, match=r"alike: in none of .* is the board tilted"):
            calibrate(views(tilt=0.01))
        with pytest.raises(CalibrationError, match=r"the board was in \d\d % of the picture only"):
            calibrate(views(spread=0.1))

    def test_too_few_views(self) -> None:
        with pytest.raises(CalibrationError, match="got 5 good views of the board, expected at least 8"):
            calibrate(views()[:5])

    def test_a_stretched_print(self) -> None:
        wide = tuple(BoardView(v.name, v.ids, v.points * (1.05, 1.0, 1.0), v.pixels, v.blur) for v in views())
        with pytest.raises(CalibrationError, match=r"printed with other scales across and down"):
            calibrate(wide)

    def test_another_board(self) -> None:
        finder = BoardFinder(Board(columns=7, rows=5))
        picture = board_pictures(TRUTH, BOARD, 1, 9, spread=0.2)[0]
        with pytest.raises(CalibrationError, match=r"7 x 5 squares.* is it another board"):
            finder.find("a.png", picture)
        with pytest.raises(CalibrationError, match=r"10 x 7 squares.* not where this board has them.*--columns and"):
            BoardFinder(Board(columns=10, rows=7)).find("a.png", picture)
        with pytest.raises(CalibrationError, match=r"got 0 of 40 corners.*Hold the board flat"):
            BoardFinder(BOARD).find("empty.png", np.full((360, 640), 90, dtype=np.uint8))
        with pytest.raises(ParameterError, match=r"below 0\.9 of a square"):
            Board(marker=0.03)


def arena(seed: int = 1) -> tuple[LensPrior, list[Landmark]]:
    rng = np.random.default_rng(seed)
    places = np.array(((-1.2, -0.6), (1.3, -0.6), (1.2, 0.9), (-1.2, 0.9), (0.0, 0.1), (0.6, -0.3)))
    exact = np.insert(places, 2, 0.0, axis=1)
    pixels = TRUTH.project(exact) + rng.normal(0.0, 0.05, (6, 2))
    measured = exact + np.insert(rng.normal(0.0, 0.001, (6, 2)), 2, 0.0, axis=1)
    points = [Landmark(f"tag {k}", pixels[k], measured[k]) for k in range(6)]
    return noisy(camera_of(TRUTH), rng), points


OFF = np.array((0.1, 0.0, 0.0))


class TestArena:
    FLOOR = Bounds(-1.4, 1.4, -0.7, 0.9)

    def test_the_bound_holds(self) -> None:
        covered = []
        for seed in range(12):
            lens, points = arena(seed)
            result = fit_arena(lens, points, sigma_pixels=0.05, sigma_metres=0.001)
            error = floor_error(result.camera, result.covariance, self.FLOOR, 0.15, 0.25)
            x, y = np.meshgrid(error.x, error.y)
            places = np.stack((x, y), axis=-1)
            pixels = FloorMap(TRUTH).to_pixels(places, 0.15)
            off = np.hypot(*np.moveaxis(FloorMap(result.camera.model).to_metres(pixels, 0.15) - places, 2, 0))
            inside = np.isfinite(error.bound)
            covered.append((off <= error.bound)[inside].mean())
            assert error.worst < 0.012
        assert np.mean(covered) >= 0.9

    def test_with_exact_places_the_camera_is_within_3_mm(self) -> None:
        _, points = arena()
        exact = [point._replace(place=np.array((*point.place.round(1)[:2], 0.0))) for point in points]
        lens = LensPrior(camera_of(TRUTH), 1e-4 * NUMBERS)
        result = fit_arena(lens, exact, sigma_pixels=0.05, sigma_metres=0.0005)
        assert result.camera.model.position == pytest.approx(TRUTH.position, abs=3e-3)

    @pytest.mark.parametrize(
        ("change", "problem"),
        [
            (lambda p: [*p[:2], p[2]._replace(place=p[2].place + OFF), *p[3:]], r"^tag 2 is at 1\.20, 0\.90 m"),
            (
                lambda p: [p[0]._replace(place=p[4].place), *p[1:4], p[4]._replace(place=p[0].place), p[5]],
                "tag 0 and tag 4",
            ),
            (lambda p: [p[0]._replace(place=p[1].place), p[1]._replace(place=p[0].place), *p[2:4]], "tag 0 and tag 1"),
            (lambda p: [*p[:3], p[3]._replace(place=p[3].place + OFF)], "With a fifth point"),
            (lambda p: p[:3], "got 3 points"),
            (lambda p: [x._replace(place=x.place * (1, 0, 1)) for x in p], "on a line"),
            (lambda p: [*p, p[0]], "tag 0 and tag 0 are at the same place"),
        ],
    )
    def test_a_wrong_point_is_named(self, change: Callable[[list[Landmark]], list[Landmark]], problem: str) -> None:
        lens, points = arena()
        with pytest.raises(CalibrationError, match=problem):
            fit_arena(lens, change(points), sigma_pixels=0.05, sigma_metres=0.001)


FLOOR = Bounds(-2.1, 2.1, -1.5, 1.5)
PAIR = {
    name: camera_of(hung(960, 480, position=(0.0, y, 3.0), fov=1.36, tilt=0.03, distortion=lens))
    for name, y, lens in (
        ("north", 0.7, (-0.08, 0.012, 4e-4, -3e-4, 0.0)),
        ("south", -0.7, (-0.07, 0.01, 0.0, 4e-4, 0.0)),
    )
}
TAG, HEIGHT, PLACES = 0.16, 0.15, 48


def drive(seed: int = 0) -> Knots:
    """A robot that mows the floor, turning."""
    rng = np.random.default_rng(seed)
    u = np.linspace(0.0, 1.0, PLACES)
    x, y, theta = 1.8 * np.sin(7 * np.pi * u), 1.3 - 2.6 * u, 4 * np.pi * u
    corners = {name: np.full((PLACES, 4, 2), np.nan) for name in PAIR}
    for k in range(PLACES):
        c, s = math.cos(theta[k]), math.sin(theta[k])
        quad = 0.5 * TAG * np.array(((-1, 1), (1, 1), (1, -1), (-1, -1))) @ ((c, s), (-s, c)) + (x[k], y[k])
        for name, camera in PAIR.items():
            pixels = FloorMap(camera.model).to_pixels(quad, HEIGHT)
            if FloorMap(camera.model).margin(pixels).min() > 5.0:
                corners[name][k] = pixels + rng.normal(0.0, 0.08, (4, 2))
    return Knots(80.0 * u, corners)


def place(knots: Knots, seed: int = 0, size: float = TAG, **scale: object) -> DriveFit:
    rng = np.random.default_rng(seed)
    priors = {name: noisy(camera, rng) for name, camera in PAIR.items()}
    return fit_drive(
        priors,
        knots,
        size=size,
        height=HEIGHT,
        sigma_pixels=0.08,
        robot="r1",
        start=Pose2(0.0, 1.3, 0.0),
        floor=FLOOR,
        **(scale or {"heights": {"north": 3.0}}),  # type: ignore[arg-type]  # one of two kinds
    )


def known_distance(metres: float = 2.0) -> Distance:
    ends = np.array(((-1.0, 0.1), (1.0, 0.1)))
    return Distance(metres, 0.0015, {"north": FloorMap(PAIR["north"].model).to_pixels(ends)})


class TestDrive:
    def test_both_cameras_are_placed_in_one_frame_within_3_mm(self) -> None:
        x, y = np.meshgrid(np.arange(-2.0, 2.1, 0.5), np.arange(-1.4, 1.5, 0.4))
        places = np.column_stack((x.ravel(), y.ravel()))
        result = place(drive(), distance=known_distance())
        assert np.hypot(*map_difference(PAIR, result.cameras, places, HEIGHT).T).max() < 3e-3
        assert result.cameras["south"].model.position == pytest.approx((0.0, -0.7, 3.0), abs=0.02)

    def test_the_frame_is_that_of_a_camera_that_is_known(self) -> None:
        moved = place(drive(), heights={"north": 3.0}, known={"north": PAIR["north"]})
        places = np.array(((0.5, 0.5), (-0.5, 1.0)))
        pixels = FloorMap(PAIR["north"].model).to_pixels(places, HEIGHT)
        assert FloorMap(moved.cameras["north"].model).to_metres(pixels, HEIGHT) == pytest.approx(places, abs=4e-3)

    def test_nor_does_the_error_of_the_first_view_turn_it(self) -> None:
        """A heading that is two milliradians off is 4 mm at the arena's end."""
        result = place(drive(), distance=known_distance(), known=PAIR)
        for name, camera in PAIR.items():
            y = np.linspace(0.0, 1.3, 4) * (1.0 if name == "north" else -1.0)
            places = np.column_stack([axis.ravel() for axis in np.meshgrid(np.linspace(-1.9, 1.9, 9), y)])
            pixels = FloorMap(camera.model).to_pixels(places, HEIGHT)
            off = FloorMap(result.cameras[name].model).to_metres(pixels, HEIGHT) - places
            assert np.hypot(*off.T).max() < 2e-3

    def test_one_of_two_known_cameras_that_was_moved_does_not_move_the_map(self) -> None:
        """By 0.3 degrees, 16 mm on the floor."""
        bumped = camera_of(PAIR["south"].model.moved((math.radians(0.3), 0.0, 0.0)))
        with pytest.raises(
            CalibrationError, match=r"of north and south are 1\d mm apart, expected .* --frame north or"
        ):
            place(drive(), distance=known_distance(), known={"north": PAIR["north"], "south": bumped})
        result = place(drive(), distance=known_distance(), known={"north": PAIR["north"]})
        places = np.column_stack([axis.ravel() for axis in np.meshgrid(np.linspace(-1.9, 1.9, 9), (-1.2, -0.6, 0.0))])
        pixels = FloorMap(PAIR["south"].model).to_pixels(places, HEIGHT)
        off = FloorMap(result.cameras["south"].model).to_metres(pixels, HEIGHT) - places
        assert np.hypot(*off.T).max() < 4e-3

    @pytest.mark.parametrize("size", [0.8 * TAG, 1.2 * TAG])
    @pytest.mark.parametrize("scale", [{"heights": {"north": 3.0}}, {"distance": known_distance()}])
    def test_a_tag_of_another_size_is_found(self, size: float, scale: dict[str, object]) -> None:
        with pytest.raises(
            CalibrationError, match=r"the tag of r1 has a side of (158|160|161) mm and not of (128|192) mm"
        ):
            place(drive(), size=size, **scale)

    def test_a_scale_that_rests_on_the_tag_alone_is_refused(self) -> None:
        with pytest.raises(CalibrationError, match=r"Measure the height of a camera"):
            place(drive(), heights={})

    def test_places_that_contradict_the_others_are_left_out(self) -> None:
        knots = drive()
        bad = int(np.flatnonzero(knots.seen("south"))[-3])
        knots.corners["south"][bad, 0] += 20.0
        result = place(knots)
        assert result.left_out == 1

    def test_recordings_that_do_not_begin_together(self) -> None:
        knots = drive()
        knots.corners["south"][:] = np.roll(knots.corners["south"], 3, axis=0)
        with pytest.raises(CalibrationError, match="begin at the same time"):
            place(knots)

    def test_a_drive_in_one_corner_or_without_overlap(self) -> None:
        knots = drive()
        knots.corners["south"][knots.seen("north")] = np.nan
        with pytest.raises(CalibrationError, match="saw the robot together in 0 places"):
            place(knots)
        knots = drive()
        knots.corners["south"][:-10] = np.nan
        with pytest.raises(CalibrationError, match="camera south saw r1 in"):
            place(knots)
        knots = drive()
        knots.corners["north"][:] = knots.corners["north"][np.flatnonzero(knots.seen("north"))[0]]
        with pytest.raises(CalibrationError, match="all views of camera north are alike"):
            place(knots)
