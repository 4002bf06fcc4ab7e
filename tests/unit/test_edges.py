"""Tags that are found again by their sides: exact where they are as expected, and nothing where they are not."""

from __future__ import annotations

import numpy as np
import pytest

from basestation.localization.edges import EdgeReader
from basestation.localization.markers import Marker
from muro_zenoh.geometry import Bounds, TagMount
from muro_zenoh.simulation.camera import OverheadCamera
from tests.support.cameras import plane_camera

CAMERA = plane_camera(Bounds(-2.1, 2.1, -1.5, 1.5), 1280, 720, margin=0.1)  # 225 px a metre: tags of 36 px
MOUNT = TagMount(7, 0.16)
READER = EdgeReader("DICT_4X4_50")


def scene(x: float = 0.3, y: float = -0.2, theta: float = 0.5) -> tuple[np.ndarray, Marker]:
    """A picture of one robot, and its tag as it is in it."""
    eye = OverheadCamera(CAMERA, seed=1)
    pose = np.array((x, y, theta))
    picture = eye.render(pose[None], [MOUNT], [0.177], np.random.default_rng(3))
    return picture, Marker(MOUNT.id, eye.tag_corners(pose, MOUNT))


@pytest.mark.parametrize("theta", np.linspace(-3.0, 3.0, 7).tolist())
def test_corners_are_within_a_fifth_of_a_pixel_wherever_within_a_pixel_they_are_expected(theta: float) -> None:
    picture, truth = scene(theta=theta)
    for step in ((0.0, 0.0), (1.0, 0.6), (-0.8, 1.0)):
        (found,) = READER.find_again(picture, [truth.moved(*step)])
        assert found is not None
        assert np.abs(found.corners - truth.corners).max() < 0.2
        assert np.abs(np.subtract(found.centre, truth.centre)).max() < 0.08


def test_a_tag_is_either_not_found_or_in_its_true_place_however_wrong_the_place_expected() -> None:
    """At the end of its reach half of a side would be seen, and the tag be found a pixel off."""
    picture, truth = scene()
    found = 0
    for u in np.arange(-9.0, 9.1, 0.75):
        for v in np.arange(-9.0, 9.1, 0.75):
            (seen,) = READER.find_again(picture, [truth.moved(float(u), float(v))])
            if seen is not None:
                found += 1
                assert np.abs(seen.corners - truth.corners).max() < 0.3, (u, v)
    assert found > 12


def test_another_number_or_orientation_in_its_place_is_not_the_tag() -> None:
    picture, truth = scene()
    others = [Marker(number, truth.corners) for number in range(50) if number != MOUNT.id]
    turned = [Marker(MOUNT.id, np.roll(truth.corners, turn, axis=0)) for turn in (1, 2, 3)]
    assert READER.find_again(picture, [*others, *turned]) == [None] * 52


def test_a_tag_that_is_covered_cut_off_dim_or_not_there_is_not_found() -> None:
    picture, truth = scene()
    u, v = (int(middle) for middle in truth.centre)
    covered = picture.copy()
    covered[v + 9 :, u + 9 :] = 128
    dim = (100.0 + 0.06 * picture).astype(np.uint8)
    for image in (covered, dim, np.full_like(picture, 90), np.random.default_rng(0).integers(0, 255, picture.shape)):
        assert READER.find_again(image.astype(np.uint8), [truth]) == [None]
    cut, shown = np.ascontiguousarray(picture[:, : u + 8]), np.ascontiguousarray(picture[:, : u + 60])
    assert READER.find_again(cut, [truth]) == [None]
    assert READER.find_again(shown, [truth]) != [None]
    assert READER.find_again(picture, []) == []


def test_small_tags_are_left_to_the_detector() -> None:
    """Between cells of three pixels a side cannot be told from the print."""
    picture, truth = scene()
    small = picture[::2, ::2].copy()
    assert READER.find_again(small, [Marker(truth.id, 0.5 * truth.corners)]) == [None]
