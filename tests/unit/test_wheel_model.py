"""The wheel model against a fine integration of its own equation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from muro_zenoh.estimation.limited_lag import follow_array
from muro_zenoh.estimation.wheel_model import WheelLimits, follow, step_wheels

LIMITS = WheelLimits()
speeds = st.floats(-1.0, 1.0)
steps = st.floats(0.0, 0.1)


def integrate(v: float, target: float, limits: WheelLimits, dt: float) -> float:
    """dv/dt = clip((target - v) / lag) in steps of 10 us."""
    n = max(1, round(dt / 1e-5))
    h = dt / n
    for _ in range(n):
        rate = (target - v) / limits.lag
        falling = v * rate < 0.0
        limit = limits.brake if falling else limits.a_max
        v += h * max(-limit, min(limit, rate))
    return v


@pytest.mark.parametrize(
    ("v", "target", "dt"),
    [(0.0, 0.3, 0.1), (0.3, 0.0, 0.1), (0.3, 0.29, 0.1), (0.2, 0.5, 0.05), (0.05, -0.3, 0.1), (-0.03, 0.02, 0.1)],
)
def test_agrees_with_the_equation_it_states(v: float, target: float, dt: float) -> None:
    got, _ = step_wheels(v, 0.0, target, 0.0, LIMITS, dt)
    assert got == pytest.approx(integrate(v, target, LIMITS, dt), abs=2e-5)


@given(v=speeds, target=speeds, first=steps, second=steps)
def test_two_steps_end_where_one_does(v: float, target: float, first: float, second: float) -> None:
    once, _ = step_wheels(v, 0.0, target, 0.0, LIMITS, first + second)
    half, _ = step_wheels(v, 0.0, target, 0.0, LIMITS, first)
    twice, _ = step_wheels(half, 0.0, target, 0.0, LIMITS, second)
    assert twice == pytest.approx(once, abs=1e-9)


@given(v=speeds, target=speeds, dt=steps)
def test_never_overshoots_nor_exceeds_the_limits(v: float, target: float, dt: float) -> None:
    got, _ = step_wheels(v, 0.0, target, 0.0, LIMITS, dt)
    assert min(v, target) - 1e-12 <= got <= max(v, target) + 1e-12
    assert abs(got) - abs(v) <= LIMITS.a_max * dt + 1e-12
    assert abs(v) - abs(got) <= LIMITS.brake * dt + 1e-12


def test_a_stop_brakes_and_ends_turning_at_least_as_fast() -> None:
    v, omega = 0.4, 1.0
    for _ in range(30):
        before = v, omega
        v, omega = step_wheels(v, omega, 0.0, 0.0, LIMITS, 0.02)
        assert before[0] - v <= LIMITS.brake * 0.02 + 1e-12
    assert v < 0.01
    assert omega < 0.025
    assert LIMITS.alpha_brake == 6.0


def test_no_lag_is_ideal_within_the_acceleration() -> None:
    ideal = WheelLimits(lag=0.0, a_max=1e9, alpha_max=1e9, brake=1e9)
    assert step_wheels(0.0, 0.0, 0.3, -1.0, ideal, 0.01) == pytest.approx((0.3, -1.0))


@given(data=st.lists(st.tuples(speeds, speeds), min_size=1, max_size=8), dt=steps)
def test_arrays_do_what_floats_do(data: list[tuple[float, float]], dt: float) -> None:
    v, target = (np.array(column) for column in zip(*data, strict=True))
    with np.errstate(all="raise", under="ignore"):
        many = follow_array(v, target, np.array(0.5), np.array(1.0), 0.1, dt)
    one = [follow(a, b, 0.5, 1.0, 0.1, dt) for a, b in data]
    np.testing.assert_allclose(many, one, rtol=0.0, atol=1e-12)
    assert all(math.isfinite(value) for value in one)
