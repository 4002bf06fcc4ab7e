"""Cyclic pursuit against its formulas: spacing, steady speed, settling over its bound, density."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from muro_zenoh.control.importance import Importance
from muro_zenoh.control.pursuit import PursuitLaw, pursue, pursuit_law, pursuit_speed
from muro_zenoh.control.ring import RingRobot, gaps_ahead
from muro_zenoh.control.ring_arrays import array_gaps
from muro_zenoh.elementwise import Array
from muro_zenoh.geometry import Circle
from muro_zenoh.simulation.rollout.yardstick import equal_spacing_bound

TWO_PI = 2.0 * math.pi
DT = 0.05


def spin(law: PursuitLaw, angles: Array, radius: float, clockwise: bool, seconds: float) -> Array:
    sigma = -1.0 if clockwise else 1.0
    for _ in range(round(seconds / DT)):
        gap, behind, count = array_gaps(angles, clockwise)
        angles = angles + sigma * pursuit_speed(law, gap, behind, count, angles, radius, clockwise) / radius * DT
    return angles


@pytest.mark.parametrize(("name", "seconds"), [("two_gap", 60.0), ("normalised", 150.0), ("proportional", 150.0)])
@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("robots", [2, 5, 10])
def test_every_law_spreads_a_bunch_evenly(name: str, seconds: float, clockwise: bool, robots: int) -> None:
    start = np.random.default_rng(7).uniform(0.0, math.pi / 3, (20, robots))
    # The seed's gain must be matched to the ring, so that its steady speed is 0.2 m/s.
    matched = {"gain": 0.2 * robots / (TWO_PI * 1.1)} if name == "proportional" else {}
    law = pursuit_law(name, v_min=0.02, **matched)
    gap, _, _ = array_gaps(spin(law, start, 1.1, clockwise, seconds), clockwise)
    assert np.abs(gap - TWO_PI / robots).max() < 0.1


def test_the_seeds_law_stalls_when_its_steady_speed_is_out_of_reach() -> None:
    law = pursuit_law("proportional", gain=0.3, v_max=0.4)
    gap, _, _ = array_gaps(spin(law, np.array([[0.0, 0.5]]), 1.1, False, 300.0), False)
    assert np.abs(gap - math.pi).max() > 1.5


@settings(max_examples=25)
@given(
    angles=st.lists(st.floats(-math.pi, math.pi), min_size=1, max_size=8),
    clockwise=st.booleans(),
    radius=st.floats(0.6, 1.2),
)
def test_two_gap_converges_from_anywhere(angles: list[float], clockwise: bool, radius: float) -> None:
    end = spin(pursuit_law(), np.array([angles]), radius, clockwise, 90.0)
    gap, behind, count = array_gaps(end, clockwise)
    assert np.abs(gap - TWO_PI / len(angles)).max() < 0.05
    speed = pursuit_speed(pursuit_law(), gap, behind, count, end, radius, clockwise)
    assert speed == pytest.approx(np.full_like(speed, 0.2), abs=0.02)


def test_the_seeds_discrete_form_converges_for_gains_between_0_and_1() -> None:
    # theta(t+1) = theta(t) + k gap(t), unsaturated: gaps become equal, the steady step is k 2 pi / N.
    for k in (0.1, 0.5, 0.9):
        law = pursuit_law("proportional", gain=k / DT, v_min=0.0, v_max=1e6, cruise=1.0)
        angles = np.sort(np.random.default_rng(1).uniform(0.0, 1.0, (1, 6)))
        end = spin(law, angles, 1.0, False, 400 * DT)
        gap, _, _ = array_gaps(end, False)
        np.testing.assert_allclose(gap, TWO_PI / 6, atol=1e-4)
        np.testing.assert_allclose(spin(law, end, 1.0, False, DT) - end, k * TWO_PI / 6, atol=1e-4)


def least_time_to_even(angles: Array, radius: float, v_min: float, v_max: float, tolerance: float) -> float:
    """Least T in which robots, in their order, can have every gap within ``tolerance`` of even: a linear programme.

    Of each robot's end, its angle less its place in an even ring, and of T.
    """
    robots = angles.size
    offset = np.sort(angles) - TWO_PI / robots * np.arange(robots)
    one = np.eye(robots)
    apart = np.roll(one, -1, axis=1) - one
    rows = [
        np.column_stack((-one, np.full(robots, v_min / radius))),
        np.column_stack((one, np.full(robots, -v_max / radius))),
        np.column_stack((apart, np.zeros(robots))),
        np.column_stack((-apart, np.zeros(robots))),
    ]
    limits = np.concatenate((-offset, offset, np.full(2 * robots, tolerance)))
    free = [(None, None)] * robots + [(0.0, None)]
    found = linprog(np.append(np.zeros(robots), 1.0), A_ub=np.vstack(rows), b_ub=limits, bounds=free)
    assert found.success
    return float(found.x[-1])


@pytest.mark.parametrize("tolerance", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("clockwise", [False, True])
def test_the_bound_is_the_least_time_of_a_linear_programme(tolerance: float, clockwise: bool) -> None:
    rng = np.random.default_rng(5)
    for robots, spread in ((2, 1.0), (5, 3.0), (10, 1.0), (10, TWO_PI)):
        angles = rng.uniform(0.0, spread, robots)
        bound = equal_spacing_bound(-angles if clockwise else angles, clockwise, 1.1, 0.05, 0.4, tolerance)
        assert bound == pytest.approx(least_time_to_even(angles, 1.1, 0.05, 0.4, tolerance), abs=1e-6)


def test_two_gap_is_within_15_percent_of_the_bound_from_a_bunch() -> None:
    rng = np.random.default_rng(11)
    radius, law = 1.1, pursuit_law(v_min=0.05, v_max=0.4)
    starts = np.sort(rng.uniform(0.0, math.pi / 3, (20, 10)), axis=1)
    bounds = [least_time_to_even(row, radius, 0.05, 0.4, 0.1) for row in starts]
    last, now = np.zeros(20), starts
    for step in range(round(40.0 / DT)):
        gap, _, _ = array_gaps(now, False)
        last[np.abs(gap - TWO_PI / 10).max(axis=1) > 0.1] = (step + 1) * DT
        now = spin(law, now, radius, False, DT)
    assert (last >= bounds).all()
    assert np.median(last / bounds) <= 1.15


def run_agents(
    circle: Circle, angles: dict[str, float], law: PursuitLaw, seconds: float, age: float = 0.0
) -> dict[str, float]:
    """Each robot computes its own step from the same snapshot, as agents do."""
    orders: dict[str, tuple[str, ...]] = dict.fromkeys(angles, ())
    speeds = dict.fromkeys(angles, law.cruise)
    past = [dict(angles)]
    lag = round(age / DT)
    for _ in range(round(seconds / DT)):
        seen = past[max(len(past) - 1 - lag, 0)]
        ring = {}
        for name in angles:
            a = seen[name]
            x, y = circle.x + circle.radius * math.cos(a), circle.y + circle.radius * math.sin(a)
            ring[name] = RingRobot(x, y, a + circle.sigma * math.pi / 2, speeds[name], min(lag, len(past) - 1) * DT)
        steps = {name: pursue(name, ring, circle, orders[name], law) for name in angles}
        orders = {name: step.order for name, step in steps.items()}
        speeds = {name: step.speed for name, step in steps.items()}
        angles = {name: a + circle.sigma * speeds[name] / circle.radius * DT for name, a in angles.items()}
        past.append(dict(angles))
    return angles


@pytest.mark.parametrize("clockwise", [False, True])
def test_the_ring_spreads_again_when_a_robot_leaves_and_when_one_joins(clockwise: bool) -> None:
    circle = Circle(2.0, 1.5, 0.8, clockwise)
    names = ["r1", "r2", "r3", "r4", "r5"]
    angles = run_agents(circle, {n: 0.2 * k for k, n in enumerate(names)}, pursuit_law(), 30.0)
    del angles["r3"]
    angles = run_agents(circle, angles, pursuit_law(), 30.0)
    spread = gaps_ahead(angles, clockwise)
    assert max(abs(g - TWO_PI / 4) for g in spread.values()) < 0.02
    angles["r9"] = angles["r1"]
    angles = run_agents(circle, angles, pursuit_law(), 30.0)
    spread = gaps_ahead(angles, clockwise)
    assert max(abs(g - TWO_PI / 5) for g in spread.values()) < 0.02


def test_positions_150_ms_old_do_not_bias_the_speed() -> None:
    circle = Circle(0.0, 0.0, 0.8)
    start = {f"r{k}": 0.3 * k for k in range(5)}
    before = run_agents(circle, start, pursuit_law(), 40.0, age=0.15)
    after = run_agents(circle, before, pursuit_law(), 10.0, age=0.15)
    mean = np.mean([after[n] - before[n] for n in start]) * 0.8 / 10.0
    assert mean == pytest.approx(0.2, rel=0.02)
    spread = gaps_ahead(after, False)
    assert max(abs(g - TWO_PI / 5) for g in spread.values()) < 0.1


@pytest.mark.parametrize("robots", [1, 3, 5])
@pytest.mark.parametrize("clockwise", [False, True])
def test_the_time_averaged_density_follows_the_importance(robots: int, clockwise: bool) -> None:
    wanted = Importance.from_function(lambda a: 2.0 + math.cos(a - 1.0))
    law = pursuit_law("importance", importance=wanted)
    angles = spin(law, np.random.default_rng(3).uniform(0.0, 1.0, (1, robots)), 0.8, clockwise, 60.0)
    bins = np.zeros(36)
    for _ in range(round(180.0 / DT)):
        angles = spin(law, angles, 0.8, clockwise, DT)
        np.add.at(bins, (np.mod(angles, TWO_PI) / TWO_PI * 36).astype(int).ravel() % 36, 1.0)
    edges = np.linspace(0.0, TWO_PI, 37)
    asked = np.diff(wanted.mass(edges)) / TWO_PI
    assert 0.5 * np.abs(bins / bins.sum() - asked).sum() < 0.05
