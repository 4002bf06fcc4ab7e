import math

import numpy as np
import pytest

from basestation.localization.detector import TagDetector
from basestation.localization.floor_map import FloorMap
from basestation.localization.frames import decode_frame
from basestation.localization.localizer import Localizer, fit_squares
from basestation.localization.markers import Marker
from basestation.localization.sightings import Sighting
from muro_zenoh.errors import MessageError
from muro_zenoh.geometry import Bounds, Pose2, TagMount, View, wrap_to_pi
from muro_zenoh.optics.jpeg import encode_jpeg
from muro_zenoh.optics.plane import fit_plane
from muro_zenoh.simulation.camera import OverheadCamera
from muro_zenoh.simulation.tag_print import corners_in_world
from tests.support.cameras import plane_camera

WIDTH, HEIGHT = 1280, 720
CAMERA = plane_camera(Bounds(-2.1, 2.1, -1.5, 1.5), WIDTH, HEIGHT, margin=0.1)  # 225 px a metre: tags of 36 px
# Offsets unlike each other, so that a sign or an order that is wrong shows.
MOUNTS = [TagMount(i, 0.16, x=0.012 * i - 0.05, y=0.04 - 0.009 * i, yaw=0.7 * i - 3.0) for i in range(10)]
TAGS = {mount.id: (f"r{mount.id}", mount) for mount in MOUNTS}


class DrawnMarkers:
    """Replaces the detector: returns the given markers, and counts the calls."""

    family = "DICT_4X4_50"

    def __init__(self) -> None:
        self.markers: list[Marker] = []
        self.wholes = 0
        self.lost = False

    def detect(self, image: np.ndarray, *, wanted: int = 0, lost: bool = False) -> list[Marker]:
        self.wholes += 1
        self.lost = lost
        return list(self.markers)

    def detect_near(self, image: np.ndarray, expected: list[Marker], *, reach: float = 0.4) -> list[Marker]:
        return [m for m in self.markers if any(math.dist(m.centre, e.centre) < reach * e.side for e in expected)]


BLANK = np.zeros((HEIGHT, WIDTH), np.uint8)


def localizer(detector: object = None, **settings: object) -> Localizer:
    return Localizer("north", FloorMap(CAMERA), detector or TagDetector(), TAGS, **settings)  # type: ignore[arg-type]


def drawn(pose: Pose2, mount: TagMount, tag: int | None = None, scale: float = 1.0) -> Marker:
    homography = FloorMap(CAMERA)
    shown = TagMount(mount.id, mount.size * scale, mount.x, mount.y, mount.yaw)
    return Marker(mount.id if tag is None else tag, homography.to_pixels(corners_in_world(np.array(pose), shown)))


def scattered(rng: np.random.Generator) -> np.ndarray:
    while True:
        poses = np.column_stack(
            (rng.uniform(-2.6, 2.6, 10), rng.uniform(-1.4, 1.4, 10), rng.uniform(-math.pi, math.pi, 10))
        )
        apart = np.hypot(*(poses[:, None, :2] - poses[None, :, :2]).T) + 9.0 * np.eye(10)
        if apart.min() > 0.36:
            return poses


def errors(sighting: Sighting, pose: np.ndarray) -> np.ndarray:
    off = np.array(sighting.pose) - pose
    off[2] = wrap_to_pi(off[2])
    return off


class TestPoseOfTheBase:
    @pytest.mark.parametrize(
        ("mount", "pose"),
        [
            (TagMount(1, 0.16), Pose2(0.5, 0.25, 0.0)),
            (TagMount(1, 0.16, x=0.1), Pose2(0.5, 0.25, math.pi / 2)),
            (TagMount(1, 0.16, y=-0.05, yaw=math.pi), Pose2(-1.0, 0.8, -2.0)),
            (TagMount(1, 0.16, x=0.03, y=0.07, yaw=-1.1), Pose2(1.7, -1.2, 3.1)),
        ],
    )
    def test_the_mount_is_compensated(self, mount: TagMount, pose: Pose2) -> None:
        detector = DrawnMarkers()
        detector.markers = [drawn(pose, mount)]
        finder = Localizer("north", FloorMap(CAMERA), detector, {1: ("r1", mount)})  # type: ignore[arg-type]
        (sighting,) = finder.locate(BLANK)
        assert sighting.name == "r1"
        assert sighting.pose == pytest.approx(pose, abs=1e-5)

    def test_by_hand(self) -> None:
        # Tag of 36 px whose top edge points to the picture's right: the robot (tag yaw 0) faces down the picture, -y.
        # The tag sits 0.1 m ahead of the axle, so the base is 22.5 px above the tag's centre, at pixel (639.5, 359.5).
        u, v = 639.5, 359.5 + 22.5
        corners = np.array([[u + 18, v - 18], [u + 18, v + 18], [u - 18, v + 18], [u - 18, v - 18]])
        detector = DrawnMarkers()
        detector.markers = [Marker(1, corners)]
        mount = TagMount(1, 0.16, x=0.1)
        finder = Localizer("north", FloorMap(CAMERA), detector, {1: ("r1", mount)})  # type: ignore[arg-type]
        (sighting,) = finder.locate(BLANK)
        assert sighting.pose == pytest.approx(Pose2(0.0, 0.0, -math.pi / 2), abs=1e-5)

    def test_rendered_robots_are_found_within_a_millimetre_after_jpeg(self) -> None:
        rng = np.random.default_rng(11)
        scene = OverheadCamera(CAMERA)
        off, surprise, whole = [], [], 0
        for _ in range(30):
            poses = scattered(rng)
            data = encode_jpeg(scene.render(poses, MOUNTS, [0.177] * 10, rng), 85)
            for mount, pose in zip(MOUNTS, poses, strict=True):
                corners = scene.tag_corners(pose, mount, border=0.02)
                whole += bool((corners > 0.0).all() and (corners < (WIDTH - 1, HEIGHT - 1)).all())
            for sighting in localizer().locate(decode_frame("jpeg", WIDTH, HEIGHT, data)):
                error = errors(sighting, poses[int(sighting.name[1:])])
                off.append(error)
                surprise.append(error @ np.linalg.solve(np.reshape(sighting.covariance, (3, 3)), error))
        table = np.array(off)
        distance, turn = np.hypot(table[:, 0], table[:, 1]), np.degrees(np.abs(table[:, 2]))
        assert len(off) >= 0.99 * whole > 200
        assert np.quantile(distance, 0.95) < 0.8e-3
        assert distance.max() < 3e-3
        assert np.quantile(turn, 0.5) < 0.25
        assert np.quantile(turn, 0.95) < 0.6
        assert np.abs(table[:, :2].mean(axis=0)).max() < 0.1e-3  # half a pixel would be 2.2 mm
        # Three numbers each: a mean of 3 if the covariance were exact; it is cautious about the place.
        assert 0.5 < np.mean(surprise) < 3.0

    def test_a_tilted_camera_near_the_edges(self) -> None:
        rng = np.random.default_rng(3)
        views = [
            View(120, 650, -2.1, -1.5),
            View(1170, 660, 2.1, -1.5),
            View(960, 60, 2.1, 1.5),
            View(330, 70, -2.1, 1.5),
        ]
        camera = fit_plane(views, WIDTH, HEIGHT, camera="south")
        scene = OverheadCamera(camera)
        off, scaled = [], []
        for _ in range(15):
            poses = scattered(rng) * (0.75, 0.95, 1.0)
            picture = scene.render(poses, MOUNTS, [0.1] * 10, rng)
            finder = Localizer("south", FloorMap(camera), TagDetector(), TAGS)
            for sighting in finder.locate(picture):
                error = errors(sighting, poses[int(sighting.name[1:])])
                off.append(error)
                scaled.append(error @ np.linalg.solve(np.reshape(sighting.covariance, (3, 3)), error))
        table = np.array(off)
        assert len(off) > 120
        assert np.quantile(np.hypot(table[:, 0], table[:, 1]), 0.95) < 1.5e-3
        assert np.quantile(np.degrees(np.abs(table[:, 2])), 0.95) < 1.0
        assert 0.5 < np.mean(scaled) < 3.5


class TestCovariance:
    @pytest.mark.parametrize("mount", [TagMount(1, 0.16), TagMount(1, 0.16, x=0.2, y=-0.1, yaw=0.4)])
    def test_it_is_that_of_the_corners_noise(self, mount: TagMount) -> None:
        rng = np.random.default_rng(0)
        pose = Pose2(0.7, -0.4, 2.1)
        detector = DrawnMarkers()
        finder = Localizer(
            "north",
            FloorMap(CAMERA),
            detector,
            {1: ("r1", mount)},
            corner_noise=0.4,  # type: ignore[arg-type]
        )
        clean = drawn(pose, mount)
        off = []
        for _ in range(4000):
            detector.markers = [Marker(1, clean.corners + rng.normal(0.0, 0.4, (4, 2)))]
            (sighting,) = finder.locate(BLANK)
            off.append(errors(sighting, np.array(pose)))
        stated = np.reshape(sighting.covariance, (3, 3))
        spread = np.sqrt(np.diag(stated))
        measured = np.cov(np.transpose(off))
        assert stated == pytest.approx(stated.T)
        assert measured / np.outer(spread, spread) == pytest.approx(stated / np.outer(spread, spread), abs=0.08)


class TestWhatIsNoRobot:
    def test_a_tag_that_no_robot_has_is_reported(self) -> None:
        detector = DrawnMarkers()
        detector.markers = [drawn(Pose2(0, 0, 0), MOUNTS[2]), drawn(Pose2(1, 0, 0), MOUNTS[3], tag=44)]
        finder = localizer(detector)
        assert [sighting.name for sighting in finder.locate(BLANK)] == ["r2"]
        assert finder.unknown_tags == {44}

    def test_a_tag_on_the_floor_is_not_reported_but_measured(self) -> None:
        detector = DrawnMarkers()
        lying = TagMount(44, 0.16)
        detector.markers = [drawn(Pose2(0, 0, 0), MOUNTS[2]), drawn(Pose2(1.0, 0.51, 0.4), lying)]
        finder = localizer(detector, floor_tags={44: (1.0, 0.5, 0.0), 2: (0.0, 0.0, 0.0)})
        assert [sighting.name for sighting in finder.locate(BLANK)] == ["r2"]
        assert finder.complaints == ()
        (off,) = finder.floor_off  # the number of a robot is the robot's
        assert off == pytest.approx((0.0, 0.01), abs=1e-4)
        finder.locate(BLANK)
        assert finder.floor_off == (), "not searched as a whole"
        del detector.markers[1]
        finder = localizer(detector, floor_tags={44: (1.0, 0.5, 0.0)})
        finder.locate(BLANK)
        assert finder.floor_off == (), "it was taken away"

    def test_two_robots_with_one_tag_are_reported_and_give_no_sighting(self) -> None:
        detector = DrawnMarkers()
        one, other = drawn(Pose2(0, 0, 0), MOUNTS[2]), drawn(Pose2(1, 0, 0), MOUNTS[2])
        finder = localizer(detector)
        for k in range(25):  # in whole pictures and in crops alike
            detector.markers = [one.moved(k, 0.0), other.moved(0.0, k), drawn(Pose2(-1, 0, 0), MOUNTS[5])]
            assert [sighting.name for sighting in finder.locate(BLANK)] == ["r5"]
            assert finder.duplicate_tags == {2}
        detector.markers = detector.markers[:1]
        assert [sighting.name for sighting in finder.locate(BLANK)] == ["r2"]
        assert finder.duplicate_tags == frozenset()

    @pytest.mark.parametrize("scale", [0.5, 1.6])
    def test_a_print_of_another_size_is_no_tag_and_no_double(self, scale: float) -> None:
        detector = DrawnMarkers()
        detector.markers = [drawn(Pose2(1, 0, 0), MOUNTS[2], scale=scale), drawn(Pose2(0, 0, 0), MOUNTS[2])]
        finder = localizer(detector)
        (sighting,) = finder.locate(BLANK)
        assert sighting.pose.x == pytest.approx(0.0, abs=1e-5)
        assert finder.misfit_tags == pytest.approx({2: 0.16 * scale})

    def test_a_quadrilateral_that_is_no_square_is_no_tag(self) -> None:
        detector = DrawnMarkers()
        marker = drawn(Pose2(0, 0, 0), MOUNTS[2])
        detector.markers = [Marker(2, marker.corners * (1.0, 0.5))]
        finder = localizer(detector)
        assert finder.locate(BLANK) == []
        assert 2 in finder.misfit_tags

    def test_a_picture_that_the_camera_is_not_calibrated_for_is_refused(self) -> None:
        with pytest.raises(MessageError, match="640 x 360 pixels, expected 1280 x 720, which camera north"):
            localizer().locate(BLANK[::2, ::2])


class TestSearch:
    def test_a_robot_in_view_is_seen_in_every_picture(self) -> None:
        rng = np.random.default_rng(2)
        scene = OverheadCamera(CAMERA)
        finder = localizer()
        whole = 0
        for k in range(40):  # 2 s at 20 Hz: 0.4 m/s and 1.5 rad/s
            poses = np.array([[-1.0 + 0.02 * k, 0.5, 0.075 * k], [1.0, -0.5 + 0.02 * k, -0.075 * k], [0.0, -1.0, 1.0]])
            seen = {
                sighting.name: sighting for sighting in finder.locate(scene.render(poses, MOUNTS[:3], [0.177] * 3, rng))
            }
            assert seen.keys() == {"r0", "r1", "r2"}
            for i in range(3):
                assert np.hypot(*errors(seen[f"r{i}"], poses[i])[:2]) < 3e-3
            whole += finder.swept
        assert whole == 4

    def test_a_hidden_robot_does_not_cost_a_whole_search_each_time(self) -> None:
        detector = DrawnMarkers()
        finder = localizer(detector, sweep_every=10, search_every=3, remember=30)
        still, hidden = drawn(Pose2(0, 0, 0), MOUNTS[1]), drawn(Pose2(1, 0, 0), MOUNTS[2])
        detector.markers = [still, hidden]
        finder.locate(BLANK)
        detector.markers = [still]
        detector.wholes = 0
        for _ in range(24):
            finder.locate(BLANK)
        assert 7 <= detector.wholes <= 8
        # When it comes back elsewhere, it is found within search_every pictures.
        detector.markers = [still, drawn(Pose2(-1.5, 1, 0), MOUNTS[2])]
        assert any(len(finder.locate(BLANK)) == 2 for _ in range(3))

    def test_a_robot_that_drove_out_of_the_picture_is_not_searched_for(self) -> None:
        detector = DrawnMarkers()
        finder = localizer(detector, sweep_every=10, search_every=3)
        still, leaving = drawn(Pose2(0, 0, 0), MOUNTS[1]), drawn(Pose2(0, 1.0, 0), MOUNTS[2])
        for _ in range(40):
            leaving = leaving.moved(0.0, -4.0)
            inside = bool((leaving.corners[:, 1] > 2.5).all())
            detector.markers = [still, leaving] if inside else [still]
            finder.locate(BLANK)
        detector.wholes = 0
        for _ in range(30):
            finder.locate(BLANK)
        assert detector.wholes == 3
        assert not detector.lost

    def test_a_robot_lost_in_the_middle_of_the_picture_may_be_for_the_light(self) -> None:
        detector = DrawnMarkers()
        finder = localizer(detector, sweep_every=10, search_every=3)
        detector.markers = [drawn(Pose2(0, 0, 0), MOUNTS[1]), drawn(Pose2(0, 1.0, 0), MOUNTS[2])]
        finder.locate(BLANK)
        assert not detector.lost
        del detector.markers[1]
        for _ in range(12):
            finder.locate(BLANK)
        assert detector.lost

    def test_a_robot_that_left_is_forgotten(self) -> None:
        detector = DrawnMarkers()
        finder = localizer(detector, sweep_every=10, search_every=3, remember=30)
        still = drawn(Pose2(0, 0, 0), MOUNTS[1])
        detector.markers = [still, drawn(Pose2(1, 0, 0), MOUNTS[2])]
        finder.locate(BLANK)
        detector.markers = [still]
        for _ in range(40):
            finder.locate(BLANK)
        detector.wholes = 0
        for _ in range(30):
            finder.locate(BLANK)
        assert detector.wholes == 3

    def test_a_robot_hidden_for_a_moment_is_found_where_it_reappears(self) -> None:
        detector = DrawnMarkers()
        finder = localizer(detector, sweep_every=1000, search_every=1000)
        marker = drawn(Pose2(0, 0, 0), MOUNTS[1])
        for k in range(12):  # 10 px a picture; hidden for three of them, 40 px later, a side and more
            detector.markers = [] if 5 <= k < 8 else [marker.moved(10.0 * k, 0.0)]
            assert len(finder.locate(BLANK)) == len(detector.markers)

    def test_an_empty_floor_then_a_robot(self) -> None:
        detector = DrawnMarkers()
        finder = localizer(detector, search_every=3)
        assert finder.locate(BLANK) == []
        detector.markers = [drawn(Pose2(0, 0, 0), MOUNTS[1])]
        assert any(finder.locate(BLANK) for _ in range(3))


def test_fit_squares_is_the_least_squares_similarity() -> None:
    rng = np.random.default_rng(8)
    corners = corners_in_world(np.array([0.3, -0.2, 2.5]), TagMount(0, 0.2)) + rng.normal(0.0, 0.01, (4, 2))
    (pose,), (side,), (misfit,) = fit_squares(corners[None])
    # Against the linear problem [x, y] = c + [[a, -b], [b, a]] z.
    z = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]])
    rows = np.concatenate([[[p, -q, 1.0, 0.0], [q, p, 0.0, 1.0]] for p, q in z])
    (a, b, cx, cy), residual, _, _ = np.linalg.lstsq(rows, corners.ravel())
    assert pose == pytest.approx(Pose2(cx, cy, math.atan2(b, a)))
    assert side == pytest.approx(math.hypot(a, b))
    assert misfit == pytest.approx(math.sqrt(residual[0] / 4.0))
