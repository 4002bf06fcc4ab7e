"""Arcs: exact for any turn, and the same for floats and arrays."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from muro_zenoh.arcs import advance, carry, chord
from muro_zenoh.geometry import TWO_PI, Pose2
from tests.unit.test_geometry import assert_same, poses


@given(poses, st.floats(-1.0, 1.0), st.floats(-3.0, 3.0), st.floats(0.0, 3.0), st.floats(0.0, 3.0))
def test_two_steps_are_one(pose: Pose2, v: float, omega: float, first: float, second: float) -> None:
    assert_same(advance(advance(pose, v, omega, first), v, omega, second), advance(pose, v, omega, first + second))


@given(poses, st.floats(-1.0, 1.0), st.floats(-3.0, 3.0), st.floats(0.0, 3.0))
def test_a_step_back_undoes_a_step(pose: Pose2, v: float, omega: float, dt: float) -> None:
    assert_same(advance(advance(pose, v, omega, dt), -v, -omega, dt), pose)


def test_a_whole_turn_ends_where_it_began() -> None:
    start = Pose2(0.3, -0.2, 1.0)
    assert_same(advance(start, 0.2, 0.5, TWO_PI / 0.5), start)


@given(poses, st.floats(-1.0, 1.0), st.floats(0.0, 3.0))
def test_a_tiny_turn_is_a_straight_line(pose: Pose2, v: float, dt: float) -> None:
    for omega in (0.0, 5e-324, 1e-9, 3e-6):
        assert_same(advance(pose, v, omega, dt), advance(pose, v, 0.0, dt), tolerance=3e-5)


@given(st.floats(-math.pi, math.pi), st.floats(0.1, 2.0), st.floats(-6.0, 6.0))
def test_an_arc_keeps_its_distance_from_its_centre(theta: float, radius: float, turn: float) -> None:
    x, y, end = carry(0.0, 0.0, theta, radius * turn, turn, 1.0)
    centre = (-radius * math.sin(theta), radius * math.cos(theta))
    assert math.hypot(x - centre[0], y - centre[1]) == pytest.approx(radius, abs=1e-12)
    assert end == pytest.approx(theta + turn)


@pytest.mark.parametrize("most", [0.01, 0.19, 0.21, 3.0])
def test_floats_and_arrays_agree(most: float) -> None:
    rng = np.random.default_rng(3)
    v, omega = rng.uniform(-1.0, 1.0, 50), rng.uniform(-most, most, 50)
    omega[0] = 0.0
    theta = rng.uniform(-math.pi, math.pi, 50)
    many = np.stack(carry(np.zeros(50), np.ones(50), theta, v, omega, 1.0), axis=-1)
    one = [carry(0.0, 1.0, *row, 1.0) for row in zip(theta.tolist(), v.tolist(), omega.tolist(), strict=True)]
    assert many == pytest.approx(np.array(one), abs=1e-12)


def test_a_chord_is_shorter_than_its_arc() -> None:
    reach, cos, sin = chord(0.0, 1.0, math.pi / 2)
    assert reach == pytest.approx(2.0 / math.pi)
    assert (cos, sin) == pytest.approx((0.0, 1.0))
