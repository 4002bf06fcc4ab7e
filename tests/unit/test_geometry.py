"""Poses and angles."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from muro_zenoh.errors import ParameterError
from muro_zenoh.geometry import (
    STILL,
    TWO_PI,
    Bounds,
    Circle,
    Pose2,
    TagMount,
    Twist2,
    ccw_gap,
    wrap_to_pi,
)

angles = st.floats(-1e3, 1e3)
places = st.floats(-10.0, 10.0)
poses = st.builds(Pose2, places, places, st.floats(-math.pi, math.pi))
NEAR = 1e-9


def apart(a: float, b: float) -> float:
    """The angle between two angles."""
    return abs(math.remainder(a - b, TWO_PI))


def assert_same(a: Pose2, b: Pose2, tolerance: float = 1e-8) -> None:
    assert (a.x, a.y) == pytest.approx((b.x, b.y), abs=tolerance)
    assert apart(a.theta, b.theta) < tolerance


@given(angles)
def test_a_wrapped_angle_is_the_same_angle_in_the_half_open_circle(angle: float) -> None:
    wrapped = wrap_to_pi(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)


@pytest.mark.parametrize("turns", [-3, -1, 0, 1, 3])
def test_half_a_turn_is_plus_pi(turns: int) -> None:
    assert wrap_to_pi(math.pi) == math.pi
    assert wrap_to_pi(-math.pi) == math.pi
    assert wrap_to_pi(0.5 + turns * TWO_PI) == pytest.approx(0.5)


@given(angles, angles)
def test_a_gap_leads_from_one_angle_to_the_other(start: float, end: float) -> None:
    gap = ccw_gap(start, end)
    assert 0.0 <= gap < TWO_PI
    assert apart(start + gap, end) < NEAR


@given(st.floats(-math.pi, math.pi), st.floats(-math.pi, math.pi))
def test_the_gaps_there_and_back_make_a_turn(a: float, b: float) -> None:
    total = ccw_gap(a, b) + ccw_gap(b, a)
    assert total == pytest.approx(TWO_PI) or total == pytest.approx(0.0, abs=NEAR)


def test_a_gap_is_never_a_whole_turn() -> None:
    assert ccw_gap(0.0, -1e-18) == 0.0
    assert ccw_gap(1.0, 1.0) == 0.0


@given(poses)
def test_a_pose_and_its_inverse_cancel(pose: Pose2) -> None:
    still = Pose2(0.0, 0.0, 0.0)
    assert_same(pose.compose(pose.inverse()), still)
    assert_same(pose.inverse().compose(pose), still)


@given(poses, poses, poses)
def test_composition_is_associative(a: Pose2, b: Pose2, c: Pose2) -> None:
    assert_same(a.compose(b).compose(c), a.compose(b.compose(c)))


@given(poses, poses)
def test_composition_keeps_distances(frame: Pose2, pose: Pose2) -> None:
    there = frame.compose(pose)
    assert math.dist(frame[:2], there[:2]) == pytest.approx(math.hypot(pose.x, pose.y), abs=NEAR)
    assert -math.pi < there.theta <= math.pi


def test_forwards_is_along_the_heading() -> None:
    assert_same(Pose2(1.0, 2.0, math.pi / 2).compose(Pose2(1.0, 0.5, 0.1)), Pose2(0.5, 3.0, math.pi / 2 + 0.1))


def test_the_circles_direction() -> None:
    assert Circle(0.0, 0.0, 1.0).sigma == 1.0
    assert Circle(0.0, 0.0, 1.0, clockwise=True).sigma == -1.0


@pytest.mark.parametrize("radius", [0.0, -1.0, math.nan, math.inf])
def test_a_circle_has_a_radius(radius: float) -> None:
    with pytest.raises(ParameterError, match=r"radius: got .*, expected a number at least 0.001 \[m\]"):
        Circle(0.0, 0.0, radius)


FLOOR = Bounds(-2.0, 1.0, 0.0, 1.5)


@given(places, places)
def test_what_is_inside_is_clear_of_the_walls(x: float, y: float) -> None:
    clearance = min(x + 2.0, 1.0 - x, y, 1.5 - y)
    assert FLOOR.holds(x, y, slack=0.0) == (clearance >= 0.0)
    assert FLOOR.holds(*FLOOR.nearest(x, y), slack=0.0)
    assert FLOOR.shrunk(0.2).holds(x, y) == (clearance >= 0.2 - 1e-9)


def test_a_floor_shrunk_by_more_than_its_size_contains_nothing() -> None:
    assert (FLOOR.width, FLOOR.height) == (3.0, 1.5)
    assert not FLOOR.shrunk(0.8).holds(-0.5, 0.75)
    assert not FLOOR.holds(math.nan, 0.5)
    with pytest.raises(ParameterError, match="x_max: got nan"):
        Bounds(0.0, math.nan, 0.0, 1.0)


def test_still_is_still() -> None:
    assert Twist2(0.0, 0.0) == STILL


def test_a_tags_frame_in_the_base_frame() -> None:
    mount = TagMount(3, 0.16, x=-0.03, y=0.02, yaw=3 * math.pi / 2)
    assert_same(mount.pose, Pose2(-0.03, 0.02, -math.pi / 2))
