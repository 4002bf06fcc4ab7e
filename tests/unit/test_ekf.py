"""Predict and correct against filterpy, and against their own consistency."""

from __future__ import annotations

import math

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray
from scipy.stats import chi2

from muro_zenoh.estimation import ekf
from muro_zenoh.estimation.ekf import Covariance, Fix, Mean
from muro_zenoh.estimation.filter_settings import FilterSettings

Matrix = NDArray[np.float64]
SETTINGS = FilterSettings()
UPPER = np.triu_indices(5)


def full(P: Covariance) -> Matrix:
    out = np.zeros((5, 5))
    out[UPPER] = P
    return out + np.triu(out, 1).T


def random_state(rng: np.random.Generator) -> tuple[Mean, Covariance]:
    root = rng.normal(size=(5, 5)) * np.array([[0.02], [0.02], [0.05], [0.1], [0.1]])
    P = root @ root.T + 1e-6 * np.eye(5)
    mean = Mean(*rng.normal(size=2), rng.uniform(-3.1, 3.1), *rng.uniform(0.8, 1.2, 2))
    return mean, Covariance(*P[UPPER])


def random_fix(rng: np.random.Generator, mean: Mean) -> tuple[Fix, Matrix]:
    root = rng.normal(size=(3, 3)) * 0.02
    R = root @ root.T + 1e-6 * np.eye(3)
    error = rng.normal(size=3) * 0.02
    fix = Fix(mean.x + error[0], mean.y + error[1], mean.theta + error[2], *R[np.triu_indices(3)])
    return fix, R


def wheels(rng: np.random.Generator) -> list[tuple[float, float, float]]:
    return [(rng.uniform(-0.4, 0.4), rng.uniform(-1.5, 1.5), 0.02) for _ in range(5)]


def end(mean: Mean, pieces: list[tuple[float, float, float]]) -> Matrix:
    stretch = ekf.begin(mean)
    for v, omega, dt in pieces:
        stretch = ekf.drive(stretch, mean, v, omega, dt, SETTINGS)
    return np.array([stretch.x, stretch.y, stretch.theta, mean.s_v, mean.s_omega])


def jacobian(mean: Mean, pieces: list[tuple[float, float, float]]) -> Matrix:
    columns = []
    for i in range(5):
        step = np.zeros(5)
        step[i] = 1e-6
        high, low = (end(Mean(*(np.array(mean) + s)), pieces) for s in (step, -step))
        columns.append((high - low) / 2e-6)
    return np.column_stack(columns)


def process_noise(mean: Mean, pieces: list[tuple[float, float, float]]) -> Matrix:
    """Q as docs/laws.md has it, with every noise of a size of its own: see NOISES."""
    distance = mean.s_v * sum(abs(v) * dt for v, _, dt in pieces)
    angle = mean.s_omega * sum(abs(omega) * dt for _, omega, dt in pieces)
    time = sum(dt for *_, dt in pieces)
    x, y = end(mean, pieces)[:2]
    way = math.atan2(y - mean.y, x - mean.x)  # of the chord; forwards or backwards is the same
    along = np.array([math.cos(way), math.sin(way), 0.0, 0.0, 0.0])
    Q = 0.02**2 * distance * np.outer(along, along)
    Q[0, 0] += 0.004**2 * time
    Q[1, 1] += 0.004**2 * time
    Q[2, 2] += 0.02**2 * angle + 0.03**2 * distance + 0.006**2 * time
    Q[3, 3] += 0.05**2 * sum(dt for v, _, dt in pieces if abs(v) > 0.01)
    Q[4, 4] += 0.05**2 * sum(dt for _, omega, dt in pieces if abs(omega) > 0.03)
    return Q


NOISES = FilterSettings(
    slip=0.02, veer=0.03, drift=0.004, drift_theta=0.006, scale_walk=0.05, v_rest=0.01, omega_rest=0.03
)


@pytest.mark.parametrize("seed", range(20))
def test_predict_agrees_with_filterpy_on_the_numerical_jacobian(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mean, P = random_state(rng)
    # at the end the wheels hardly drive, and then hardly turn: such a scale cannot be seen, and does not walk
    pieces = [*wheels(rng), (0.009, 0.9, 0.03), (0.3, 0.029, 0.02)]
    stretch = ekf.begin(mean)
    for v, omega, dt in pieces:
        stretch = ekf.drive(stretch, mean, v, omega, dt, NOISES)
    got_mean, got = ekf.predict(mean, P, stretch, NOISES)

    oracle = KalmanFilter(dim_x=5, dim_z=3)
    oracle.x, oracle.P = np.array(mean).reshape(5, 1), full(P)
    oracle.predict(F=jacobian(mean, pieces), Q=process_noise(mean, pieces))
    np.testing.assert_allclose(full(got), oracle.P, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(np.array(got_mean)[[0, 1, 3, 4]], end(mean, pieces)[[0, 1, 3, 4]], atol=1e-12)


def test_the_noises_are_those_of_the_laboratory() -> None:
    """A robot that drives 0.2 m/s and turns 0.5 rad/s for a second, from a pose and scales that are known."""
    mean, P = Mean(0.0, 0.0, 0.0, 1.0, 1.0), Covariance(*np.zeros(15))
    stretch = ekf.drive(ekf.begin(mean), mean, 0.2, 0.0, 1.0, SETTINGS)
    _, straight = ekf.predict(mean, P, stretch, SETTINGS)
    _, turned = ekf.predict(mean, P, ekf.drive(ekf.begin(mean), mean, 0.0, 0.5, 1.0, SETTINGS), SETTINGS)
    assert straight.xx == pytest.approx(0.01**2 * 0.2 + 0.001**2)
    assert straight.yy == pytest.approx(0.001**2)
    assert straight.tt == pytest.approx(0.01**2 * 0.2 + 0.003**2)
    assert turned.tt == pytest.approx(0.01**2 * 0.5 + 0.003**2)
    assert (straight.vv, straight.ww) == pytest.approx((0.003**2, 0.0))
    assert (turned.vv, turned.ww) == pytest.approx((0.0, 0.003**2))


@pytest.mark.parametrize("seed", range(20))
def test_correct_agrees_with_filterpy(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    mean, P = random_state(rng)
    fix, R = random_fix(rng, mean)
    settings = FilterSettings(gate=1e9, scale_gate=1e9, scale_min=0.01, scale_max=9.0)
    got_mean, got, nis = ekf.correct(mean, P, fix, True, True, settings)

    oracle = KalmanFilter(dim_x=5, dim_z=3)
    oracle.x, oracle.P, oracle.R, oracle.H = np.array(mean).reshape(5, 1), full(P), R, np.eye(3, 5)
    oracle.update(np.array(fix[:3]).reshape(3, 1))
    np.testing.assert_allclose(full(got), oracle.P, rtol=0.0, atol=1e-12)
    expected = oracle.x[:, 0]
    expected[2] = math.remainder(expected[2], math.tau)
    np.testing.assert_allclose(got_mean, expected, rtol=0.0, atol=1e-10)
    assert nis == pytest.approx((oracle.y.T @ np.linalg.inv(oracle.S) @ oracle.y).item())


def test_a_frozen_scale_keeps_its_value_and_an_honest_covariance() -> None:
    rng = np.random.default_rng(3)
    mean, P = random_state(rng)
    fix, R = random_fix(rng, mean)
    settings = FilterSettings(gate=1e9, scale_gate=1e9)
    after, got, _ = ekf.correct(mean, P, fix, False, True, settings)
    assert after.s_v == mean.s_v
    H = np.eye(3, 5)
    before = full(P)
    K = before @ H.T @ np.linalg.inv(H @ before @ H.T + R)
    K[3] = 0.0
    joseph = (np.eye(5) - K @ H) @ before @ (np.eye(5) - K @ H).T + K @ R @ K.T
    np.testing.assert_allclose(full(got), joseph, rtol=0.0, atol=1e-14)


def test_a_fix_that_only_just_passes_moves_the_pose_and_not_the_scales() -> None:
    mean, P = ekf.start(Fix(0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 1e-6, 0.0, 1e-4), SETTINGS)
    stretch = ekf.drive(ekf.begin(mean), mean, 0.3, 0.5, 0.05, SETTINGS)
    mean, P = ekf.predict(mean, P, stretch, SETTINGS)
    off = math.sqrt(15.0 * (P.yy + 1e-6))
    fix = Fix(mean.x, mean.y + off, mean.theta, 1e-6, 0.0, 0.0, 1e-6, 0.0, 1e-4)
    after, _, nis = ekf.correct(mean, P, fix, True, True, SETTINGS)
    assert 11.3 < nis < 21.1
    assert (after.s_v, after.s_omega) == (mean.s_v, mean.s_omega)
    assert after.y > mean.y


def test_the_heading_innovation_is_wrapped() -> None:
    mean, P = ekf.start(Fix(0.0, 0.0, math.pi - 0.01, 1e-6, 0.0, 0.0, 1e-6, 0.0, 1e-4), SETTINGS)
    after, _, nis = ekf.correct(
        mean, P, Fix(0.0, 0.0, -math.pi + 0.01, 1e-6, 0.0, 0.0, 1e-6, 0.0, 1e-4), True, True, SETTINGS
    )
    assert nis == pytest.approx(0.02**2 / 2e-4)
    assert abs(after.theta) == pytest.approx(math.pi)


def test_scales_stay_within_their_bounds() -> None:
    mean, P = random_state(np.random.default_rng(0))
    huge = P._replace(vv=100.0, ww=100.0, xv=P.xx * 50.0, xw=-P.xx * 50.0)
    fix = Fix(mean.x + 0.1, mean.y, mean.theta, 1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-4)
    after, _, _ = ekf.correct(mean, huge, fix, True, True, FilterSettings(gate=1e9, scale_gate=1e9))
    assert (after.s_v, after.s_omega) == (1.5, 0.5)


def test_arrays_do_what_floats_do() -> None:
    rng = np.random.default_rng(7)
    states = [random_state(rng) for _ in range(6)]
    fixes = [random_fix(rng, mean)[0] for mean, _ in states]
    inputs = [(0.3, 0.4), (0.0, 0.0), (-0.2, 1.0), (0.2, 0.0), (0.0, -0.7), (0.1, 0.1)]
    mean = Mean(*np.array([m for m, _ in states]).T)
    P = Covariance(*np.array([p for _, p in states]).T)
    v, omega = np.array(inputs).T
    stretch = ekf.drive(ekf.begin(mean), mean, v, omega, 0.05, SETTINGS)
    mean_many, P_many = ekf.predict(mean, P, stretch, SETTINGS)
    fix = Fix(*np.array(fixes).T)
    mean_many, P_many, nis_many = ekf.correct(mean_many, P_many, fix, stretch.moved_v, stretch.moved_w, SETTINGS)
    for i, (state, one_fix, one_input) in enumerate(zip(states, fixes, inputs, strict=True)):
        one = ekf.drive(ekf.begin(state[0]), state[0], *one_input, 0.05, SETTINGS)
        mean_one, P_one = ekf.predict(*state, one, SETTINGS)
        mean_one, P_one, nis = ekf.correct(mean_one, P_one, one_fix, one.moved_v, one.moved_w, SETTINGS)
        np.testing.assert_allclose([m[i] for m in mean_many], mean_one, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose([p[i] for p in P_many], P_one, rtol=1e-9, atol=1e-12)
        assert nis_many[i] == pytest.approx(nis)
        assert all(isinstance(value, float) for value in (*mean_one, *P_one))


def test_nees_lies_within_its_chi_square_band() -> None:
    """Monte Carlo of 400 robots: the errors are as large as the filter says, averaged and at each end."""
    rng = np.random.default_rng(11)
    n, steps, dt = 400, 120, 0.05
    settings = FilterSettings(scale_walk=0.0, scale_sigma=0.1)
    r = np.array([0.002, 0.002, 0.0087])
    s_v, s_omega = 1.0 + 0.1 * rng.normal(size=(2, n))
    x, y, theta = rng.normal(size=n), rng.normal(size=n), rng.uniform(-3.0, 3.0, n)
    zero = np.zeros(n)

    def measure() -> Fix:
        z = np.stack((x, y, theta)) + r[:, None] * rng.normal(size=(3, n))
        return Fix(z[0], z[1], z[2], zero + r[0] ** 2, zero, zero, zero + r[1] ** 2, zero, zero + r[2] ** 2)

    mean, P = ekf.start(measure(), settings)
    averages = []
    for k in range(steps):
        v, omega = zero + 0.2, zero + 0.5 * math.sin(0.15 * k)
        d, turn = s_v * v * dt, s_omega * omega * dt
        a = settings.slip * np.sqrt(abs(d)) * rng.normal(size=n)
        heading = np.sqrt(
            settings.slip**2 * abs(turn) + settings.veer**2 * abs(d) + settings.drift_theta**2 * dt
        ) * rng.normal(size=n)
        chord = d * np.sinc(turn / 2.0 / math.pi) + a
        x = x + chord * np.cos(theta + turn / 2.0) + settings.drift * math.sqrt(dt) * rng.normal(size=n)
        y = y + chord * np.sin(theta + turn / 2.0) + settings.drift * math.sqrt(dt) * rng.normal(size=n)
        theta = theta + turn + heading

        stretch = ekf.drive(ekf.begin(mean), mean, v, omega, dt, settings)
        mean, P = ekf.predict(mean, P, stretch, settings)
        new_mean, new_P, nis = ekf.correct(mean, P, measure(), stretch.moved_v, stretch.moved_w, settings)
        ok = nis <= settings.gate
        mean = Mean(*(np.where(ok, a, b) for a, b in zip(new_mean, mean, strict=True)))
        P = Covariance(*(np.where(ok, a, b) for a, b in zip(new_P, P, strict=True)))
        wrapped = np.mod(theta - mean.theta + math.pi, math.tau) - math.pi
        error = np.stack((x - mean.x, y - mean.y, wrapped, s_v - mean.s_v, s_omega - mean.s_omega), axis=1)
        cov = np.zeros((n, 5, 5))
        cov[:, UPPER[0], UPPER[1]] = np.stack(P, axis=1)
        cov[:, UPPER[1], UPPER[0]] = np.stack(P, axis=1)
        averages.append(float(np.mean(np.einsum("ni,nij,nj->n", error, np.linalg.inv(cov), error))))
    low, high = chi2.ppf([0.001, 0.999], 5 * n) / n
    inside = np.mean([low <= value <= high for value in averages])
    assert inside >= 0.95, (low, high, averages[::10])
    assert 4.8 <= float(np.mean(averages)) <= 5.2
