import math

import cv2
import numpy as np
import pytest

from muro_zenoh.geometry import Bounds, TagMount
from muro_zenoh.optics.camera_model import hung, planar
from muro_zenoh.optics.jpeg import encode_jpeg
from muro_zenoh.optics.plane import fit_plane
from muro_zenoh.simulation.arms import Arms
from muro_zenoh.simulation.camera import BODY, OverheadCamera
from muro_zenoh.simulation.tag_print import BLACK, WHITE, corners_in_world
from tests.support.cameras import plane_camera, straight_down_view

WIDTH, HEIGHT = 640, 480
ROOM = Bounds(-1.6, 1.6, -1.2, 1.2)  # 200 px a metre, the world's origin at pixel (319.5, 239.5)


def camera(**settings: object) -> OverheadCamera:
    return OverheadCamera(plane_camera(ROOM, WIDTH, HEIGHT), **settings)  # type: ignore[arg-type]


def picture_of(x: float, y: float, theta: float, mount: TagMount, *, radius: float = 0.2, **settings: object):  # type: ignore[no-untyped-def]
    scene = camera(**settings)
    return scene.render(np.array([[x, y, theta]]), [mount], [radius], np.random.default_rng(0))


class TestStraightDownView:
    def test_world_y_is_up_and_pixel_v_is_down(self) -> None:
        seen = camera().project(np.array([[0.0, 0.0, 0.3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
        assert seen == pytest.approx(np.array([[319.5, 239.5], [519.5, 239.5], [319.5, 39.5]]), abs=1e-4)

    def test_sees_the_whole_rectangle_with_its_margin_for_any_shape(self) -> None:
        for width, height in ((1280, 720), (480, 640)):
            views = straight_down_view(Bounds(0.0, 4.0, 0.0, 3.0), width, height, margin=0.25)
            scale = (views[1].u - views[0].u) / 4.0
            assert (views[0].v - views[3].v) / 3.0 == pytest.approx(scale)  # square pixels
            for view in views:
                # The picture reaches from -0.5 to width - 0.5.
                assert -0.5 + 0.25 * scale - 1e-9 <= view.u <= width - 0.5 - 0.25 * scale + 1e-9
                assert -0.5 + 0.25 * scale - 1e-9 <= view.v <= height - 0.5 - 0.25 * scale + 1e-9


class TestConventions:
    def test_with_yaw_0_the_print_is_upright_for_a_robot_that_faces_x(self) -> None:
        # Its top edge is to the robot's left, +y; its right edge is forwards, +x.
        corners = corners_in_world(np.array([1.0, 2.0, 0.0]), TagMount(0, 0.2, x=0.05, y=0.01))
        assert corners == pytest.approx(np.array([[0.95, 2.11], [1.15, 2.11], [1.15, 1.91], [0.95, 1.91]]))

    def test_a_quarter_turn_of_the_robot_or_of_the_tag_turns_the_print_counter_clockwise(self) -> None:
        turned = [[-0.1, -0.1], [-0.1, 0.1], [0.1, 0.1], [0.1, -0.1]]
        by_robot = corners_in_world(np.array([0.0, 0.0, math.pi / 2]), TagMount(0, 0.2))
        by_mount = corners_in_world(np.array([0.0, 0.0, 0.0]), TagMount(0, 0.2, yaw=math.pi / 2))
        assert by_robot == pytest.approx(np.array(turned))
        assert by_mount == pytest.approx(np.array(turned))

    def test_the_offset_turns_with_the_robot_and_not_with_the_tag(self) -> None:
        mount = TagMount(0, 0.2, x=0.05, y=0.01, yaw=1.0)
        centre = corners_in_world(np.array([1.0, 2.0, math.pi / 2]), mount).mean(axis=0)
        assert centre == pytest.approx([0.99, 2.05])

    @pytest.mark.parametrize(("theta", "turns"), [(0.0, 0), (math.pi / 2, 1), (math.pi, 2), (-math.pi / 2, 3)])
    def test_the_cells_of_the_picture_are_those_of_the_print(self, theta: float, turns: int) -> None:
        size = 0.24  # 48 px: 8 px a cell
        picture = picture_of(0.0, 0.0, theta, TagMount(7, size), noise=0.0, blur=0.0, radius=0.25)
        bits = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), 7, 6)
        left = round(319.5 - 24.0 + 3.5)
        top = round(239.5 - 24.0 + 3.5)
        cells = picture[top : top + 48 : 8, left : left + 48 : 8]
        assert (cells == np.where(np.rot90(bits, turns) > 0, WHITE, BLACK)).all()


class TestRender:
    def test_the_tag_is_where_it_is_projected_to_hundredths_of_a_pixel(self) -> None:
        # The top row and the left column of a tag are all ink. The first moment of the ink along each is its middle.
        scene = camera(noise=0.0)
        mount = TagMount(3, 0.24)
        rng = np.random.default_rng(1)
        off = []
        for _ in range(40):
            pose = np.array([*rng.uniform(-0.1, 0.1, 2), 0.0])
            picture = scene.render(pose[None], [mount], [0.3], rng).astype(float)
            corners = scene.tag_corners(pose, mount)
            for axis in (0, 1):
                across = round(corners[0, 1 - axis] + 4.0)  # the middle of the border's cell
                line = picture[across, :] if axis == 0 else picture[:, across]
                begin = round(corners[0, axis]) - 5  # on the white paper
                ink = (WHITE - line[begin : begin + 59]) / (WHITE - BLACK)
                assert ink.sum() == pytest.approx(48.0, abs=0.02)
                middle = (ink * np.arange(begin, begin + 59)).sum() / ink.sum()
                off.append(middle - (corners[0, axis] + corners[2, axis]) / 2)
        assert np.abs(np.mean(off)) < 0.005
        assert np.abs(off).max() < 0.02

    @pytest.mark.parametrize("strength", [0.5, 3.0, 12.0])
    def test_noise_has_its_strength_and_does_not_change_the_light(self, strength: float) -> None:
        nobody = (np.empty((0, 3)), [], [])
        still = camera(noise=0.0).render(*nobody, np.random.default_rng(0)).astype(float)
        noisy = camera(noise=strength).render(*nobody, np.random.default_rng(0)).astype(float)
        assert (noisy - still).mean() == pytest.approx(0.0, abs=0.02 * strength)
        assert (noisy - still).std() == pytest.approx(
            math.hypot(strength, math.sqrt(1 / 12)), rel=0.03
        )  # and the rounding's

    def test_the_floor_stays_and_the_noise_changes(self) -> None:
        scene = camera()
        rng = np.random.default_rng(0)
        nobody = (np.empty((0, 3)), [], [])
        first, second = scene.render(*nobody, rng), scene.render(*nobody, rng)
        assert (first != second).mean() > 0.8
        assert (camera().render(*nobody, np.random.default_rng(0)) == first).all()

    def test_a_body_covers_its_disc(self) -> None:
        picture = picture_of(0.5, 0.3, 1.0, TagMount(0, 0.1), radius=0.2, noise=0.0)
        v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
        dark = np.abs(picture.astype(int) - BODY) < 4
        far = np.hypot(u - (319.5 + 100.0), v - (239.5 - 60.0))
        assert not dark[far > 42.0].any()
        assert dark[(far > 30.0) & (far < 38.0)].mean() > 0.9  # but for the mark

    def test_what_is_outside_or_at_no_place_is_not_drawn(self) -> None:
        scene = camera(noise=0.0)
        rng = np.random.default_rng(0)
        floor = scene.render(np.empty((0, 3)), [], [], rng)
        lost = np.array([[9.0, 0.0, 0.0], [math.nan, 0.0, 0.0], [1e9, 1e9, 1.0], [0.0, -math.inf, 0.0]])
        with np.errstate(invalid="ignore"):
            assert (scene.render(lost, [TagMount(i, 0.2) for i in range(4)], [0.2] * 4, rng) == floor).all()

    def test_what_is_behind_a_tilted_camera_is_not_drawn(self) -> None:
        # Depth 1 + 0.5 y: the camera stands over y = -2, and what is beyond maps back into the picture, upside down.
        tilted = np.array([[200.0, 0.0, 320.0], [0.0, -200.0, 240.0], [0.0, 0.5, 1.0]])
        scene = OverheadCamera(planar(WIDTH, HEIGHT, tilted), noise=0.0)
        rng = np.random.default_rng(0)
        mount = [TagMount(0, 0.2)]
        floor = scene.render(np.empty((0, 3)), [], [], rng)
        assert (scene.render(np.array([[-5.0, -6.0, 0.0]]), mount, [0.2], rng) == floor).all()
        assert (scene.render(np.array([[0.0, 0.0, 0.0]]), mount, [0.2], rng) != floor).any()

    def test_tags_at_every_edge_are_cut_and_not_moved(self) -> None:
        scene = camera(noise=0.0, blur=0.0)
        mount = TagMount(5, 0.24, x=0.03)
        rng = np.random.default_rng(0)
        shifted = [v._replace(u=v.u + 100, v=v.v + 100) for v in straight_down_view(ROOM, WIDTH, HEIGHT)]
        wide = OverheadCamera(
            fit_plane(shifted, WIDTH + 200, HEIGHT + 200, camera="wide"),
            noise=0.0,
            blur=0.0,
        )
        for place in ((-1.6, 0.1), (1.6, 0.1), (0.1, -1.2), (0.1, 1.2), (1.55, 1.15), (-1.62, -1.24)):
            pose = np.array([[*place, 0.7]])
            cut = scene.render(pose, [mount], [0.2], rng).astype(int)
            whole = wide.render(pose, [mount], [0.2], rng)[100:-100, 100:-100].astype(int)
            inside = (cut < BLACK + 5) | (cut > WHITE - 5)
            assert inside.sum() > 100
            assert np.abs(cut - whole)[inside].max() <= 25  # cells agree; an edge's samples may differ a little

    def test_needs_as_many_of_each_and_a_tag_of_the_family(self) -> None:
        with pytest.raises(ValueError, match="1 poses, 0 mounts"):
            camera().render(np.zeros((1, 3)), [], [0.2], np.random.default_rng(0))
        with pytest.raises(ValueError, match=r"tag 50, expected 0 to 49: DICT_4X4_50"):
            picture_of(0.0, 0.0, 0.0, TagMount(50, 0.2))


class TestALensAndARoom:
    """Against OpenCV's projection: what is drawn is where ``cv2.projectPoints`` has it."""

    MODEL = hung(
        1280,
        720,
        position=(0.1, -0.1, 3.0),
        tilt=0.08,
        sees=Bounds(-2.35, 2.35, -1.75, 1.75),
        distortion=(-0.12, 0.03, 0.001, -0.0007, -0.002),
    )

    def by_opencv(self, places: np.ndarray) -> np.ndarray:
        rotation, _ = cv2.Rodrigues(self.MODEL.view[:, :3])
        lens = np.array(self.MODEL.distortion)
        return cv2.projectPoints(places, rotation, self.MODEL.view[:, 3], self.MODEL.matrix, lens)[0][:, 0]

    def tag_by_opencv(self, pose: np.ndarray, mount: TagMount) -> np.ndarray:
        return self.by_opencv(np.insert(corners_in_world(pose, mount), 2, mount.z, axis=1))

    def ink_by_opencv(self, pose: np.ndarray, mount: TagMount) -> np.ndarray:
        """The centroid of a tag's ink: of its cells, in small pieces, each with the area that it has in the picture."""
        bits = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), mount.id, 6)
        across, down = np.meshgrid(np.linspace(-0.5, 0.5, 49), np.linspace(0.5, -0.5, 49))
        steps = np.stack((across, down), axis=-1).reshape(-1, 2) * mount.size
        c, s = math.cos(pose[2]), math.sin(pose[2])
        places = np.column_stack((steps @ np.array([[c, s], [-s, c]]) + pose[:2], np.full(len(steps), mount.z)))
        nodes = self.by_opencv(places).reshape(49, 49, 2)
        first, second = nodes[1:, 1:] - nodes[:-1, :-1], nodes[1:, :-1] - nodes[:-1, 1:]
        area = 0.5 * np.abs(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
        middles = (nodes[1:, 1:] + nodes[:-1, :-1] + nodes[1:, :-1] + nodes[:-1, 1:]) / 4.0
        ink = area * np.kron(bits == 0, np.ones((8, 8)))
        return (ink[..., None] * middles).sum(axis=(0, 1)) / ink.sum()

    def test_tags_are_within_two_hundredths_of_a_pixel_of_projectpoints(self) -> None:
        scene = OverheadCamera(self.MODEL, noise=0.0, blur=0.0)
        rng = np.random.default_rng(0)
        mount = TagMount(7, 0.16, z=0.2)
        off = []
        for x, y, theta in rng.uniform((-2.0, -1.4, -3.1), (2.0, 1.4, 3.1), (150, 3)).tolist():
            pose = np.array([x, y, theta])
            picture = scene.render(pose[None], [mount], [0.2], rng).astype(float)
            corners = self.tag_by_opencv(pose, mount)
            around = np.zeros((720, 1280), np.uint8)
            paper = corners + 0.22 * (corners - corners.mean(axis=0))  # a third of the quiet zone
            cv2.fillConvexPoly(around, np.rint(paper).astype(np.int32), (1,))
            v, u = np.nonzero(around)
            ink = (WHITE - picture[v, u]).clip(0.0)
            off.append(np.array([(ink * u).sum(), (ink * v).sum()]) / ink.sum() - self.ink_by_opencv(pose, mount))
        assert np.hypot(*np.mean(off, axis=0)) < 0.01
        assert np.hypot(*np.transpose(off)).mean() < 0.02

    def test_edges_are_bent_as_the_lens_bends_them(self) -> None:
        """A large tag's edge is off the line through its corners by what OpenCV says, and the ink ends there."""
        scene = OverheadCamera(self.MODEL, noise=0.0, blur=0.0)
        mount = TagMount(7, 1.2, z=0.2)
        pose = np.array([1.2, 0.0, 0.0])
        picture = scene.render(pose[None], [mount], [0.2], np.random.default_rng(0)).astype(float)
        edge = self.by_opencv(np.array([[1.8, y, 0.2] for y in np.linspace(-0.55, 0.55, 23)]))
        chord = np.interp(edge[:, 1][::-1], edge[[-1, 0], 1], edge[[-1, 0], 0])[::-1]
        assert np.abs(edge[:, 0] - chord).max() > 1.0, "the edge is bent"
        for u, v in edge.tolist():
            line = picture[round(v), round(u) - 8 : round(u) + 9]
            ink = ((WHITE - line) / (WHITE - BLACK)).sum() - 8.0 + round(u) + 0.5 - 1.0
            assert ink == pytest.approx(u - 0.5, abs=0.6)

    def test_what_moves_is_blurred_along_its_way(self) -> None:
        scene = OverheadCamera(self.MODEL, noise=0.0, blur=0.6, exposure=0.03)
        poses, mount = np.array([[0.3, 0.2, 0.0]]), [TagMount(7, 0.16, z=0.2)]
        rng = np.random.default_rng(0)
        corners = self.tag_by_opencv(poses[0], mount[0])
        low, high = corners.min(axis=0).astype(int) - 4, corners.max(axis=0).astype(int) + 5
        window = (slice(low[1], high[1]), slice(low[0], high[0]))
        still = scene.render(poses, mount, [0.2], rng)[window].astype(float)
        moved = scene.render(poses, mount, [0.2], rng, twists=np.array([[0.4, 0.0]]))[window].astype(float)
        along, across = ((np.diff(moved, axis=a) ** 2).sum() / (np.diff(still, axis=a) ** 2).sum() for a in (1, 0))
        assert along < 0.85 * across, "0.4 m/s along x for 30 ms are 2.5 pixels"
        assert moved.mean() == pytest.approx(still.mean(), abs=1.5)

    def test_the_light_is_uneven_on_floor_and_tags_alike(self) -> None:
        bright, dim = (OverheadCamera(self.MODEL, noise=0.0, shade=shade, seed=3) for shade in (0.0, 0.6))
        poses = np.array([[x, 0.0, 0.0] for x in (-1.8, -0.6, 0.6, 1.8)])
        mounts = [TagMount(i, 0.16, z=0.2) for i in range(4)]
        rng = np.random.default_rng(0)
        ratio = dim.render(poses, mounts, [0.2] * 4, rng) / bright.render(poses, mounts, [0.2] * 4, rng).clip(1)
        assert ratio.min() == pytest.approx(0.4, abs=0.05)
        assert ratio.max() > 0.95
        assert dim.render(poses, mounts, [0.2] * 4, rng).mean() < bright.render(poses, mounts, [0.2] * 4, rng).mean()
        again = dim.render(np.empty((0, 3)), [], [], rng)
        assert (again == dim.render(np.empty((0, 3)), [], [], rng)).all(), "nothing of the robots is left"

    def test_an_arm_hides_what_is_under_it_and_is_gone_afterwards(self) -> None:
        scene = OverheadCamera(self.MODEL, noise=0.0)
        rng = np.random.default_rng(0)
        empty = scene.render(np.empty((0, 3)), [], [], rng)
        arm = np.array([[100.0, -5.0], [200.0, -5.0], [260.0, 400.0], [160.0, 400.0]])
        shown = scene.render(np.empty((0, 3)), [], [], rng, cover=arm)
        changed = shown != empty
        assert changed[200, 180]
        assert not changed[:, 300:].any()
        assert (scene.render(np.empty((0, 3)), [], [], rng) == empty).all()

    def test_the_arms_of_a_seed_come_at_the_same_times_and_leave_again(self) -> None:
        times = np.arange(0.0, 120.0, 0.05)
        first, second = (Arms(np.random.default_rng(5), 10.0, 1280, 720) for _ in range(2))
        covers = [first.cover(t) for t in times.tolist()]
        again = [second.cover(t) for t in times.tolist()]
        assert all(
            (a is None) == (b is None) and (a is None or (a == b).all()) for a, b in zip(covers, again, strict=True)
        )
        there = np.array([cover is not None for cover in covers])
        assert 3 <= (np.diff(there.astype(int)) == 1).sum() <= 25
        assert 0.02 < there.mean() < 0.25
        assert Arms(np.random.default_rng(5), 0.0, 1280, 720).cover(1.0) is None


class TestSettings:
    def test_refuses_an_invalid_camera(self) -> None:
        with pytest.raises(ValueError, match="DICT_NOPE"):
            OverheadCamera(planar(10, 10, np.eye(3)), family="DICT_NOPE")
        with pytest.raises(ValueError, match="noise 99"):
            OverheadCamera(planar(10, 10, np.eye(3)), noise=99.0)
        with pytest.raises(ValueError, match="shade 1"):
            OverheadCamera(planar(10, 10, np.eye(3)), shade=1.0)

    def test_a_tag_has_a_size(self) -> None:
        with pytest.raises(ValueError, match=r"size: got -0\.1, expected a number at least 0.001 \[m\]"):
            TagMount(0, -0.1)


def test_jpeg_is_small_and_accurate() -> None:
    picture = picture_of(0.2, 0.1, 0.5, TagMount(0, 0.2))
    data = encode_jpeg(picture, quality=85)
    back = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert len(data) < picture.size / 4
    assert back is not None
    assert np.abs(back.astype(int) - picture).mean() < 2.0
