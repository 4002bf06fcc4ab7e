"""The built-in scenarios in lock step, with a lab's noise, hidden drive errors and the filter; judged as runs are."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from muro_zenoh.behaviours import table
from muro_zenoh.behaviours.interface import Behaviour, BehaviourKind, Deployment
from muro_zenoh.config import Scenario, find_scenario, make_behaviour, read_parameters
from muro_zenoh.control.circle import CircleLaw
from muro_zenoh.planning.density import Peaks
from muro_zenoh.scoring.density import density_error
from muro_zenoh.scoring.deployment import Deployed, score_deployment
from muro_zenoh.scoring.goals import score_goals, score_tracking
from muro_zenoh.scoring.observed import Body, Moment, Planned
from muro_zenoh.simulation.rollout.behave import BehaviourRun, run_behaviours
from muro_zenoh.simulation.rollout.runs import pursue_ring, settling_time
from muro_zenoh.simulation.rollout.settings import NOISY
from muro_zenoh.simulation.starts import random_starts

LOOP = replace(NOISY, omega_max=1.5)  # as the robots of the scenarios have it
EVERY = 4  # of the plant's moves: ten a second, as a run is sampled


def starts_of(scenario: Scenario, rng: np.random.Generator) -> np.ndarray:
    count = len(scenario.robots)
    return random_starts(rng, count, scenario.arena, np.full(count, 0.177))


def kind_of(scenario: Scenario) -> BehaviourKind:
    kind = table.find(scenario.behaviour.name)
    assert isinstance(kind, BehaviourKind)
    return kind


def parameters_of(scenario: Scenario) -> Any:
    return read_parameters(kind_of(scenario), scenario.behaviour.parameters, scenario.name)


def behaviours_of(scenario: Scenario) -> list[Behaviour]:
    """What the agents of a scenario run."""
    return [
        make_behaviour(kind_of(scenario), scenario.behaviour_of(name).parameters, scenario.vehicle(name), "test")
        for name in scenario.robots
    ]


def run(scenario: Scenario, seed: int, seconds: float) -> BehaviourRun:
    rng = np.random.default_rng(seed)
    return run_behaviours(starts_of(scenario, rng), behaviours_of(scenario), None, LOOP, rng, seconds)


def bodies(run: BehaviourRun, robot: int) -> list[Moment]:
    samples = zip(run.time[::EVERY], run.pose[::EVERY, robot], run.twist[::EVERY, robot], strict=True)
    return [Moment(float(t), Body(*pose.tolist(), *twist.tolist())) for t, pose, twist in samples]


def test_dubins() -> None:
    scenario = find_scenario("dubins", 8, {})
    done = run(scenario, 1, scenario.duration)
    v_min = parameters_of(scenario).ride.profile.v_min
    errors: list[float] = []
    for k, name in enumerate(scenario.robots):
        track = bodies(done, k)
        for row in score_goals(scenario.goals[name], track):
            assert row.reached_s is not None
            assert row.distance_m <= 0.05
            assert row.theta is None or row.heading_rad <= 0.1745
        tracked = score_tracking([Planned(t, path) for t, path in done.paths[k]], track)
        errors += tracked.errors
        assert tracked.peak is not None
        assert tracked.peak >= 2 * v_min
    assert np.quantile(errors, 0.95) <= 0.03


def test_point_forward_steering() -> None:
    scenario = find_scenario("steer", 8, {})
    done = run(scenario, 1, scenario.duration)
    for k, name in enumerate(scenario.robots):
        for row in score_goals(scenario.goals[name], bodies(done, k)):
            assert row.reached_s is not None
            assert row.distance_m <= 0.05


def deployed(seed: int, peaks: tuple[tuple[float, float, float, float], ...], seconds: float) -> Deployed:
    overrides = {"behaviour.peaks": [list(peak) for peak in peaks]} if peaks else {}
    scenario = find_scenario("coverage", None, overrides)
    wanted = parameters_of(scenario)
    assert isinstance(wanted.density(), Peaks) == bool(peaks)
    done = run(scenario, seed, seconds)
    tracks = [bodies(done, k) for k in range(len(scenario.robots))]
    fleet = [(row[0].t, {f"r{k}": moment.body for k, moment in enumerate(row)}) for row in zip(*tracks, strict=True)]
    floor = scenario.vehicle("r1").arena
    return score_deployment(Deployment(floor, wanted.density(), wanted.hold_time), fleet, len(tracks))


def test_coverage() -> None:
    found = deployed(1, (), 130.0)
    assert found.rounds > 3
    assert found.distance is not None
    assert found.distance <= 0.03
    assert found.gain is not None
    assert found.gain < 0.02
    assert found.rise is not None
    assert found.rise <= 0.02


def test_coverage_gathers_where_the_density_is_high() -> None:
    peak = ((1.0, 0.5, 0.6, 3.0),)
    begin, later = deployed(3, peak, 15.0), deployed(3, peak, 40.0)
    assert begin.cost is not None
    assert later.cost is not None
    assert later.cost < 0.9 * begin.cost
    assert later.rise is not None
    assert later.rise <= 0.02


@pytest.mark.parametrize(("robots", "window"), [(1, 76.0), (3, 51.0), (5, 51.0)])
def test_importance(robots: int, window: float) -> None:
    scenario = find_scenario("importance", robots, {})
    wanted = parameters_of(scenario)
    law = wanted.pursuit_law()
    circle = scenario.circle
    rng = np.random.default_rng(1)
    starts = starts_of(scenario, rng)[None]
    done = pursue_ring(starts, circle, law, CircleLaw(wanted.law), LOOP, rng, window + 20.0)
    (settled,) = settling_time(done.time, done.radius_error > 0.03)
    assert settled <= 20.0
    angles = done.angle[done.time > 20.0].ravel()
    places = [(circle.x + math.cos(a), circle.y + math.sin(a)) for a in angles.tolist()]
    error = density_error(places, circle, law.importance)
    assert error is not None
    assert error <= 0.15, error
