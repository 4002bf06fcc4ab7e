"""Point-forward steering: the page's table of wheel speeds, the point that it moves, reversing."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from muro_zenoh.arcs import advance
from muro_zenoh.control.point_forward import (
    REVERSE_LIMIT,
    GoToGoal,
    steer_to_angle,
    turning_gain,
    wheel_speeds,
)
from muro_zenoh.geometry import Pose2

ANGLES = st.floats(-math.pi, math.pi)


@given(theta=ANGLES, phi=ANGLES, ahead=st.floats(0.05, 0.5))
def test_the_point_ahead_moves_as_commanded(theta: float, phi: float, ahead: float) -> None:
    v, omega = steer_to_angle(theta, phi, 0.3, ahead)
    moves = (
        v * math.cos(theta) - ahead * omega * math.sin(theta),
        v * math.sin(theta) + ahead * omega * math.cos(theta),
    )
    assert moves == pytest.approx((0.3 * math.cos(phi), 0.3 * math.sin(phi)), abs=1e-12)


@given(alpha=ANGLES, K=st.floats(0.5, 1.0))
def test_wheel_speeds_are_the_pages(alpha: float, K: float) -> None:
    wheel_base = 0.23
    v, omega = steer_to_angle(0.0, alpha, 0.2, wheel_base / (2.0 * K))
    left, right = wheel_speeds(v, omega, wheel_base)
    assert right == pytest.approx(0.2 * (math.cos(alpha) + K * math.sin(alpha)), abs=1e-12)
    assert left == pytest.approx(0.2 * (math.cos(alpha) - K * math.sin(alpha)), abs=1e-12)
    assert wheel_speeds(v, omega, wheel_base, 0.035).right == pytest.approx(right / 0.035)
    assert turning_gain(wheel_base, wheel_base / (2.0 * K)) == pytest.approx(K)


def test_what_the_page_reads_off_its_figure() -> None:
    def wheels(alpha: float) -> tuple[float, float]:
        v, omega = steer_to_angle(0.0, alpha, 1.0, 0.5)  # K = 1 with L = 1
        return wheel_speeds(v, omega, 1.0)

    assert wheels(math.pi / 2) == pytest.approx((-1.0, 1.0))  # pivots
    assert wheels(math.pi / 4)[0] == pytest.approx(0.0)  # about the left wheel
    assert wheels(-math.pi / 4)[1] == pytest.approx(0.0)
    assert wheels(3 * math.pi / 4)[1] == pytest.approx(0.0)
    for alpha in np.linspace(0.01, 3.13, 50):
        assert wheels(alpha)[1] > wheels(alpha)[0]
        assert wheels(-alpha)[1] < wheels(-alpha)[0]


@pytest.mark.parametrize(("reverse_from", "backwards"), [(math.pi, True), (math.pi / 2, False), (REVERSE_LIMIT, False)])
def test_reversing_is_allowed_forbidden_or_limited(reverse_from: float, backwards: bool) -> None:
    v, omega = steer_to_angle(0.0, 3.0, 0.2, 0.1, reverse_from)
    assert (v < 0.0) == backwards
    assert omega > 0.0
    if not backwards:
        assert (v, omega) == pytest.approx((0.0, 2.0))
    # Within the page's limit the robot still backs away while it turns.
    assert (steer_to_angle(0.0, 2.0, 0.2, 0.1, reverse_from)[0] < 0.0) == (reverse_from > 2.0)


@pytest.mark.parametrize("reverse_from", [math.pi, math.pi / 2, REVERSE_LIMIT])
def test_arrays_and_floats_agree(reverse_from: float) -> None:
    theta, phi = np.random.default_rng(1).uniform(-7.0, 7.0, (2, 200))
    v, omega = steer_to_angle(theta, phi, np.full(200, 0.2), 0.1, reverse_from)
    pairs = [steer_to_angle(a, b, 0.2, 0.1, reverse_from) for a, b in zip(theta.tolist(), phi.tolist(), strict=True)]
    np.testing.assert_allclose(np.stack([v, omega], axis=1), pairs, atol=1e-12)


@pytest.mark.parametrize("reverse_from", [math.pi / 2, REVERSE_LIMIT, math.pi])
@given(x=st.floats(-2.0, 2.0), y=st.floats(-2.0, 2.0), theta=ANGLES)
def test_go_to_goal_arrives_and_stops(reverse_from: float, x: float, y: float, theta: float) -> None:
    law, pose, backed = GoToGoal(reverse_from=reverse_from), Pose2(0.0, 0.0, theta), False
    for _ in range(800):
        twist = law.twist(pose, x, y)
        backed |= twist.v < -1e-9
        pose = advance(pose, twist.v, min(max(twist.omega, -2.0), 2.0), 0.05)
    assert math.hypot(pose.x - x, pose.y - y) <= 0.02
    assert law.twist(pose, x, y) == (0.0, 0.0)
    if reverse_from == math.pi / 2:
        assert not backed


@pytest.mark.parametrize(
    ("changes", "what"),
    [({"speed": 0.0}, "speed"), ({"ahead": -1.0}, "ahead"), ({"reverse_from": 1.0}, "at least 1.57")],
)
def test_an_invalid_goal_law_is_refused(changes: dict[str, float], what: str) -> None:
    with pytest.raises(ValueError, match=what):
        GoToGoal(**changes)
