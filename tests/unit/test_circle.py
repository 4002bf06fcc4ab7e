"""The circle laws one call at a time: signs, limits, names, arrays."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from muro_zenoh.control.circle import (
    CIRCLE_LAWS,
    LqrGains,
    PassivityGains,
    circle_law,
    lqr_feedback,
    passivity,
    radius_error,
)
from muro_zenoh.geometry import Circle

ANGLES = st.floats(-math.pi, math.pi)
PLACES = st.floats(-3.0, 3.0)
SPEEDS = st.floats(0.0, 0.5)
LAWS = sorted(CIRCLE_LAWS)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("clockwise", [False, True])
@given(phi=ANGLES, v=SPEEDS)
def test_on_the_circle_along_the_tangent_every_law_gives_the_circles_own_turning_rate(
    name: str, clockwise: bool, phi: float, v: float
) -> None:
    circle = Circle(1.0, -0.5, 0.6, clockwise)
    omega = circle_law(name)(
        1.0 + 0.6 * math.cos(phi), -0.5 + 0.6 * math.sin(phi), phi + circle.sigma * math.pi / 2, v, circle
    )
    assert omega == pytest.approx(circle.sigma * v / 0.6, abs=1e-9)


@pytest.mark.parametrize("name", LAWS)
@given(x=PLACES, y=PLACES, theta=ANGLES, v=SPEEDS)
def test_clockwise_is_the_mirror_image(name: str, x: float, y: float, theta: float, v: float) -> None:
    law = circle_law(name)
    left = law(x, y, theta, v, Circle(0.0, 0.0, 0.6))
    right = law(x, -y, -theta, v, Circle(0.0, 0.0, 0.6, clockwise=True))
    # Half a turn of heading error may go either way round.
    turn = 2.0 * math.pi * (3.0 if name == "vector_field" else lqr_feedback(v, 0.6, LqrGains())[1])
    assert min(abs(left + right), abs(abs(left + right) - turn)) < 1e-6


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("clockwise", [False, True])
def test_arrays_and_floats_agree(name: str, clockwise: bool) -> None:
    rng = np.random.default_rng(5)
    x, y = rng.uniform(-2.0, 2.0, (2, 3, 50))
    theta, v = rng.uniform(-4.0, 4.0, (3, 50)), rng.uniform(0.0, 0.4, (3, 50))
    circle, law = Circle(0.2, 0.1, 0.8, clockwise), circle_law(name)
    arrays = law(x, y, theta, v, circle)
    floats = [law(*row, circle) for row in zip(*(a.ravel().tolist() for a in (x, y, theta, v)), strict=True)]
    np.testing.assert_allclose(arrays.ravel(), floats, atol=1e-12)


@pytest.mark.parametrize("name", LAWS)
@given(theta=ANGLES, v=SPEEDS)
def test_the_laws_are_defined_at_the_centre(name: str, theta: float, v: float) -> None:
    circle = Circle(0.3, 0.4, 0.6)
    assert math.isfinite(circle_law(name)(0.3, 0.4, theta, v, circle))


@given(x=PLACES, y=PLACES, theta=ANGLES, v=SPEEDS)
def test_the_fields_own_turning_is_clamped(x: float, y: float, theta: float, v: float) -> None:
    omega = circle_law("vector_field")(x, y, theta, v, Circle(0.0, 0.0, 0.6))
    assert abs(omega) <= 3.0 + 3.0 * math.pi + 1e-9


def test_passivity_has_the_plus_sign() -> None:
    # Outside the circle and driving outwards, a counter-clockwise robot must turn harder to the left.
    outwards = passivity(1.0, 0.0, 0.0, 0.15, Circle(0.0, 0.0, 0.6), PassivityGains(psi=1.0))
    assert outwards == pytest.approx(0.15 / 0.6 + 0.6)
    mirrored = passivity(1.0, 0.0, 0.0, 0.15, Circle(0.0, 0.0, 0.6, clockwise=True), PassivityGains(psi=1.0))
    assert mirrored == pytest.approx(-outwards)


@given(
    v=st.floats(0.01, 1.0),
    radius=st.floats(0.2, 3.0),
    radial=st.floats(0.01, 0.5),
    heading=st.floats(0.05, 3.0),
    turn=st.floats(0.2, 3.0),
)
def test_the_optimal_gain_is_the_riccati_solution(
    v: float, radius: float, radial: float, heading: float, turn: float
) -> None:
    linalg = pytest.importorskip("scipy.linalg")
    A = np.array([[0.0, -v], [v / radius**2, 0.0]])
    B = np.array([[0.0], [1.0]])
    P = linalg.solve_continuous_are(A, B, np.diag([radial**-2, heading**-2]), np.array([[turn**-2]]))
    K = turn**2 * B.T @ P
    k_e, k_h = lqr_feedback(v, radius, LqrGains(radial, heading, turn))
    assert -k_e == pytest.approx(K[0, 0], rel=1e-5)
    assert k_h == pytest.approx(K[0, 1], rel=1e-5)


def test_lqr_is_its_linear_feedback_to_first_order() -> None:
    circle, law, v = Circle(0.0, 0.0, 0.8), circle_law("lqr"), 0.2
    k_e, k_h = lqr_feedback(v, 0.8, LqrGains())
    step = 1e-6

    def omega(e: float, epsilon: float) -> float:
        return law(0.8 + e, 0.0, math.pi / 2 + epsilon, v, circle)

    assert (omega(step, 0.0) - omega(-step, 0.0)) / (2 * step) == pytest.approx(k_e, rel=1e-6)
    assert (omega(0.0, step) - omega(0.0, -step)) / (2 * step) == pytest.approx(-k_h, rel=1e-6)


def test_radius_error_is_positive_outside() -> None:
    circle = Circle(1.0, 1.0, 0.5)
    assert radius_error(1.0, 2.0, circle) == pytest.approx(0.5)
    np.testing.assert_allclose(radius_error(np.array([1.0]), np.array([1.0]), circle), [-0.5])


def test_an_unknown_law_or_gain_lists_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"'pid'.*vector_field, passivity, lqr"):
        circle_law("pid")
    with pytest.raises(ValueError, match=r"vector_field: got 'psi'.*k_o, k_h"):
        circle_law("vector_field", psi=1.0)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf, "3"])
def test_a_gain_is_a_finite_number_above_0(bad: Any) -> None:
    with pytest.raises(ValueError, match=r"k_h: got .*, expected a number above 0 \[1/s\]"):
        circle_law("vector_field", k_h=bad)
