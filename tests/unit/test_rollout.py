"""The lock-step rollout: repeatable, and the same filter as the agent's."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from muro_zenoh.control.circle import circle_law
from muro_zenoh.estimation.ekf import Fix
from muro_zenoh.estimation.pose_filter import PoseFilter
from muro_zenoh.geometry import Circle, Pose2, State
from muro_zenoh.planning.dubins import plan
from muro_zenoh.simulation.noise import GaussianRows, gaussian
from muro_zenoh.simulation.rollout.fleet import Fleet
from muro_zenoh.simulation.rollout.runs import follow_circle, settling_time
from muro_zenoh.simulation.rollout.settings import CLEAN, NOISY, LoopSettings
from muro_zenoh.simulation.rollout.yardstick import equal_spacing_bound, shortest_tangent_path

CIRCLE = Circle(0.0, 0.0, 0.6)


def starts(n: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform((-2.0, -1.5, -math.pi), (2.0, 1.5, math.pi), (n, 3))


@pytest.mark.parametrize("settings", [CLEAN, NOISY])
def test_the_same_seed_gives_the_same_bits(settings: LoopSettings) -> None:
    runs = [
        follow_circle(starts(7), CIRCLE, circle_law(), 0.15, settings, np.random.default_rng(3), 5.0) for _ in range(2)
    ]
    np.testing.assert_array_equal(runs[0].radius_error, runs[1].radius_error)
    other = follow_circle(starts(7), CIRCLE, circle_law(), 0.15, NOISY, np.random.default_rng(4), 5.0)
    assert not np.array_equal(runs[0].radius_error[-1], other.radius_error[-1])


@pytest.mark.parametrize("delay", [0.0, 0.05, 0.08, 0.13])
def test_its_filter_is_the_agents(delay: float) -> None:
    """The agent's filter, with the fixes and commands of one robot of a rollout, gives the rollout's estimate."""
    settings = replace(NOISY, delay=delay)
    fleet = Fleet(starts(3), settings, np.random.default_rng(1))
    robot = 1
    agent = PoseFilter(settings.filter, settings.wheels)
    seen: list[State] = []
    received: Fix | None = None
    covariance = (settings.fix_sigma**2, 0, 0, 0, settings.fix_sigma**2, 0, 0, 0, settings.fix_sigma_theta**2)

    def policy(t: float, now: State) -> tuple[np.ndarray, np.ndarray]:
        seen.append(now)
        return np.full(3, 0.2), np.full(3, 0.4 * math.sin(t))

    def watch(t: float, pose: np.ndarray) -> None:
        agent.twist(t, *fleet.plant.odometry_twist[robot])

    agent.twist(0.0, 0.0, 0.0)
    for _ in range(60):
        t = fleet.time
        fleet.step(policy, watch)
        captured = fleet.time - fleet.fix_age
        if fleet.newest_fix is not received:
            received = z = fleet.newest_fix
            assert z is not None
            agent.fix(captured, z.x[robot], z.y[robot], z.theta[robot], covariance)
        # What the law saw at t was under the command before it.
        t = max(t, captured)  # rounding
        now = agent.at(t)
        assert now is not None
        ahead = agent.look_ahead(now, t, settings.wheels.lag)
        expected = State(*(column[robot] for column in seen[-1]))
        assert math.remainder(ahead.theta - expected.theta, math.tau) == pytest.approx(0.0, abs=1e-9)
        assert ahead._replace(theta=0.0) == pytest.approx(expected._replace(theta=0.0), abs=1e-9)
        agent.command(t, *fleet.command[robot])
    newest = agent.at(fleet.time)
    assert newest is not None
    final = agent.at(newest.t_fix)
    assert final is not None
    assert fleet.filter is not None
    assert final.s_v == pytest.approx(fleet.filter.mean.s_v[robot], abs=1e-9)
    assert final.s_omega == pytest.approx(fleet.filter.mean.s_omega[robot], abs=1e-9)
    assert final.sigma_v == pytest.approx(math.sqrt(fleet.filter.cov.vv[robot]), rel=1e-9)


def test_commands_are_calibrated_then_limited() -> None:
    settings = replace(NOISY, v_max=0.3, omega_max=0.5)
    fleet = Fleet(starts(50), settings, np.random.default_rng(0))
    for _ in range(80):
        fleet.step(lambda t, seen: (np.full(50, 0.2), np.full(50, 0.3)))
        assert (abs(fleet.command) <= (0.3 + 1e-12, 0.5 + 1e-12)).all()
    np.testing.assert_allclose(fleet.plant.twist, [[0.2, 0.3]] * 50, rtol=0.06)
    fleet.step(lambda t, seen: (np.full(50, 9.0), np.full(50, -9.0)))
    np.testing.assert_allclose(fleet.command, [[0.3, -0.5]] * 50)


def test_invalid_settings_are_refused() -> None:
    with pytest.raises(ValueError, match=r"period 0\.5 s"):
        LoopSettings(period=0.5)
    with pytest.raises(ValueError, match=r"delay -1\.0 s"):
        LoopSettings(delay=-1.0)


def test_gaussian_noise_is_gaussian() -> None:
    noise = gaussian(np.random.default_rng(0), 3, 200_000)
    assert noise.shape == (3, 200_000)
    np.testing.assert_allclose(noise.mean(axis=1), 0.0, atol=0.01)
    np.testing.assert_allclose(np.cov(noise), np.eye(3), atol=0.01)
    np.testing.assert_allclose((noise**4).mean(axis=1), 3.0, atol=0.06)
    assert 4.0 < abs(noise).max() < 6.5


def test_rows_of_noise_never_repeat() -> None:
    rows = GaussianRows(np.random.default_rng(0), 5)
    drawn = np.concatenate([rows.take(3).copy() for _ in range(5000)])
    assert len(np.unique(drawn)) == drawn.size


def test_settling_time_is_the_last_time_outside() -> None:
    time = np.array([1.0, 2.0, 3.0, 4.0])
    outside = np.array([[1, 1, 0], [0, 1, 0], [1, 1, 0], [0, 1, 0]], dtype=bool)
    assert list(settling_time(time, outside)) == [3.0, math.inf, 0.0]


def test_the_tangent_path_is_no_longer_than_any_dubins_path_to_the_circle() -> None:
    poses = starts(20)
    reference = shortest_tangent_path(poses, CIRCLE, 0.15, 1.0)
    rng = np.random.default_rng(1)
    for pose, full, enters in zip(poses, reference.full, reference.enters, strict=True):
        assert 0.0 <= enters < full
        best = math.inf
        for angle in rng.uniform(-math.pi, math.pi, 200):
            tangent = Pose2(0.6 * math.cos(angle), 0.6 * math.sin(angle), angle + math.pi / 2)
            best = min(best, plan(Pose2(*pose), tangent, 0.15).length / 0.15)
        assert full <= best * 1.002
        assert full > 0.8 * best


def test_the_spacing_bound_of_robots_that_are_even_is_zero() -> None:
    even = np.linspace(0.0, math.tau, 5, endpoint=False) + 1.0
    assert equal_spacing_bound(even, False, 1.1, 0.05, 0.4) == pytest.approx(0.0, abs=1e-12)
    # two side by side: one has half a turn more to go
    assert equal_spacing_bound(np.array([0.0, 0.0]), True, 1.0, 0.0, 0.5) == pytest.approx(math.pi / 0.5)
