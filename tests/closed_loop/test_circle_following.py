"""Circular path following, closed through the ideal unicycle: every law converges, from anywhere, both ways."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from muro_zenoh.control.circle import CIRCLE_LAWS, CircleLaw, circle_law, passivity, radius_error
from muro_zenoh.elementwise import Array
from muro_zenoh.geometry import Circle

DT = 0.05
OMEGA_MAX = 1.0


def drive(
    law: CircleLaw, start: tuple[Array, Array, Array], v: float, circle: Circle, seconds: float
) -> tuple[Array, Array, Array]:
    x, y, theta = start
    speed = np.full_like(x, v)
    for _ in range(round(seconds / DT)):
        omega = np.clip(law(x, y, theta, speed, circle), -OMEGA_MAX, OMEGA_MAX)
        mid = theta + 0.5 * omega * DT
        x, y, theta = x + v * DT * np.cos(mid), y + v * DT * np.sin(mid), theta + omega * DT
    return x, y, theta


def assert_on_circle(place: tuple[Array, Array, Array], circle: Circle) -> None:
    x, y, theta = place
    assert np.abs(radius_error(x, y, circle)).max() < 0.01
    tangent = np.arctan2(y - circle.y, x - circle.x) + circle.sigma * math.pi / 2
    assert np.cos(theta - tangent).min() > 0.99


def starts(count: int, seed: int) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    return rng.uniform(0.0, 4.2, count), rng.uniform(0.0, 3.0, count), rng.uniform(-math.pi, math.pi, count)


@pytest.mark.parametrize(("name", "seconds"), [("vector_field", 30.0), ("lqr", 30.0), ("passivity", 150.0)])
@pytest.mark.parametrize("clockwise", [False, True])
def test_every_law_converges_from_random_starts_with_saturated_turning(
    name: str, seconds: float, clockwise: bool
) -> None:
    circle = Circle(2.1, 1.5, 0.6, clockwise)
    assert_on_circle(drive(circle_law(name), starts(200, 4), 0.15, circle, seconds), circle)


@pytest.mark.parametrize("name", ["vector_field", "lqr"])
@settings(max_examples=40)
@given(
    x=st.floats(-3.0, 3.0),
    y=st.floats(-3.0, 3.0),
    theta=st.floats(-math.pi, math.pi),
    v=st.floats(0.1, 0.3),
    radius=st.floats(0.5, 1.5),
    clockwise=st.booleans(),
)
def test_converges_from_anywhere(
    name: str, x: float, y: float, theta: float, v: float, radius: float, clockwise: bool
) -> None:
    circle = Circle(0.0, 0.0, radius, clockwise)
    start = (np.array([x]), np.array([y]), np.array([theta]))
    assert_on_circle(drive(circle_law(name), start, v, circle, 8.0 / v + 12.0), circle)


@pytest.mark.parametrize("name", sorted(CIRCLE_LAWS))
def test_leaves_the_centre(name: str) -> None:
    circle = Circle(0.0, 0.0, 0.6)
    start = (np.zeros(8), np.zeros(8), np.arange(8) * math.pi / 4)
    assert_on_circle(drive(circle_law(name), start, 0.15, circle, 120.0), circle)


@pytest.mark.parametrize("name", ["vector_field", "lqr"])
def test_at_rest_it_turns_to_the_heading_it_would_drive_in(name: str) -> None:
    circle = Circle(0.0, 0.0, 0.6)
    x, y, theta = drive(circle_law(name), (np.full(9, 0.6), np.zeros(9), np.linspace(-3.0, 3.0, 9)), 0.0, circle, 10.0)
    np.testing.assert_allclose((x, y), (np.full(9, 0.6), np.zeros(9)))
    assert np.cos(theta - math.pi / 2).min() > 0.999


@pytest.mark.parametrize("name", ["vector_field", "lqr"])
def test_follows_a_centre_that_moves(name: str) -> None:
    law = circle_law(name)
    x, y, theta = np.array([0.6]), np.array([0.0]), np.array([math.pi / 2])
    circle = Circle(0.0, 0.0, 0.6)
    errors = []
    for step in range(1500):
        circle = Circle(0.02 * DT * step, 0.0, 0.6)
        x, y, theta = drive(law, (x, y, theta), 0.15, circle, DT)
        errors.append(float(radius_error(x, y, circle)[0]))
    assert max(map(abs, errors)) < 0.03
    far = Circle(2.0, 1.0, 0.6)
    assert_on_circle(drive(law, (x, y, theta), 0.15, far, 40.0), far)


def test_the_other_sign_of_the_passivity_law_diverges() -> None:
    circle = Circle(0.0, 0.0, 0.6)
    x, y, theta = starts(50, 9)
    x, y = x - 2.1, y - 1.5
    v = np.full_like(x, 0.15)
    for _ in range(round(60.0 / DT)):
        plus = passivity(x, y, theta, v, circle, circle_law("passivity").gains)
        omega = np.clip(2.0 * 0.15 / 0.6 - plus, -OMEGA_MAX, OMEGA_MAX)
        mid = theta + 0.5 * omega * DT
        x, y, theta = x + 0.15 * DT * np.cos(mid), y + 0.15 * DT * np.sin(mid), theta + omega * DT
    assert (np.abs(radius_error(x, y, circle)) > 0.1).mean() > 0.9


@pytest.mark.parametrize("clockwise", [False, True])
def test_the_fields_heading_error_falls_as_the_formula_says(clockwise: bool) -> None:
    # With the exact feed-forward the heading error obeys d/dt = -k_h error, whatever the place.
    circle, v, k_o, k_h = Circle(0.0, 0.0, 0.6, clockwise), 0.15, 15.0, 3.0
    law = circle_law("vector_field", k_o=k_o, k_h=k_h)

    def field(x: float, y: float) -> float:
        return math.atan2(y, x) + circle.sigma * (math.pi / 2 + math.atan(k_o * (math.hypot(x, y) - 0.6)))

    rng = np.random.default_rng(2)
    dt = 1e-6
    for _ in range(200):
        rho, phi, error = rng.uniform(0.4, 2.0), rng.uniform(-3.0, 3.0), rng.uniform(-2.0, 2.0)
        x, y = float(rho * math.cos(phi)), float(rho * math.sin(phi))
        theta = field(x, y) + float(error)
        omega = law(x, y, theta, v, circle)
        chi_rate = (field(x + v * math.cos(theta) * dt, y + v * math.sin(theta) * dt) - field(x, y)) / dt
        if abs(chi_rate) < 3.0:
            assert omega - chi_rate == pytest.approx(-k_h * error, abs=2e-4)
