"""The benchmarks' goals, on fewer starts: a law, gain or filter that loses one shows here first."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import convergence, pursuit
from muro_zenoh.control.circle import circle_law
from muro_zenoh.control.importance import Importance
from muro_zenoh.control.pursuit import pursuit_law
from muro_zenoh.geometry import Circle
from muro_zenoh.simulation.rollout.runs import follow_circle, pursue_ring, settling_time
from muro_zenoh.simulation.rollout.settings import NOISY, LoopSettings


def test_the_default_circle_law_keeps_up_with_dubins() -> None:
    rows = convergence.measure(100, 25.0, ["vector_field"])
    assert [(row["law"], row["default"], row["loop"]) for row in rows] == [
        ("vector_field", True, "clean"),
        ("vector_field", True, "noisy"),
    ]
    for row, median, p90 in zip(rows, (1.03, 1.06), (1.07, 1.15), strict=True):
        assert 1.0 < row["median"] <= median
        assert row["p90"] <= p90
        assert 0.9 < row["median_full"] < row["median"]  # a path is in the band before it ends
        assert row["unsettled"] == 0
    noisy = rows[1]
    assert noisy["s_v_found_s"]["max"] <= 2.0
    assert noisy["s_omega_found_s_of_turning"]["p99"] <= 3.0


def test_the_seeds_law_is_slow() -> None:
    """So that a yardstick which flatters everyone would show."""
    (clean, _) = convergence.measure(25, 60.0, ["passivity"])
    assert clean["median"] > 3.0


def test_the_default_pursuit_law_keeps_up_with_the_bound() -> None:
    for row in pursuit.measure(12, 25.0, ["two_gap"]):
        assert row["default"]
        assert 1.0 <= row["median"] <= 1.15
        assert row["unsettled"] == 0


@pytest.mark.parametrize(
    "settings",
    [
        replace(NOISY, delay=0.15),
        replace(NOISY, wheels=NOISY.wheels._replace(lag=0.2)),
        replace(NOISY, fix_sigma=0.006, fix_sigma_theta=math.radians(1.5)),
        replace(NOISY, period=1.0 / 30.0),
    ],
    ids=["150 ms late", "0.2 s wheels", "three times the noise", "30 Hz"],
)
@pytest.mark.parametrize("clockwise", [False, True])
def test_the_default_circle_law_tolerates_a_worse_loop(settings: LoopSettings, clockwise: bool) -> None:
    circle = Circle(2.1, 1.5, 0.6, clockwise)
    rng = np.random.default_rng(3)
    run = follow_circle(convergence.draw_starts(60), circle, circle_law(), 0.15, settings, rng, 25.0)
    assert np.isfinite(settling_time(run.time, abs(run.radius_error) > 0.03)).all()
    assert np.quantile(abs(run.radius_error[-len(run.time) // 4 :]), 0.95) < 0.01


@pytest.mark.slow
def test_the_whole_loop_achieves_the_desired_density() -> None:
    """36 bins over 180 s after settling, contrast 3: within 15 % (total variation), each trial by itself."""
    wanted = Importance.from_function(lambda angle: 2.0 + math.cos(angle - 1.0))
    assert wanted.contrast == pytest.approx(3.0, rel=1e-3)
    circle = Circle(0.0, 0.0, 0.8)
    phi = np.random.default_rng(1).uniform(0.0, 1.0, (4, 3))
    starts = np.stack((0.8 * np.cos(phi), 0.8 * np.sin(phi), phi + circle.sigma * math.pi / 2), axis=-1)
    law = pursuit_law("importance", importance=wanted)
    run = pursue_ring(starts, circle, law, circle_law(), NOISY, np.random.default_rng(2), 220.0)
    settled = run.time > 40.0
    assert run.radius_error[settled].max() < 0.03
    edges = np.linspace(-math.pi, math.pi, 37)
    asked = np.diff(wanted.mass(edges + 2.0 * math.pi)) / (2.0 * math.pi)
    for trial in range(len(starts)):
        found, _ = np.histogram(run.angle[settled, trial], edges)
        assert 0.5 * np.abs(found / found.sum() - asked).sum() < 0.15
