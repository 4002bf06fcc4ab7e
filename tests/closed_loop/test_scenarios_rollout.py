"""The built-in scenarios in lock step, with a lab's noise, hidden drive errors and the filter; judged as runs are."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from agents.tasks.coverage import CoverageParameters
from agents.tasks.dubins import DubinsParameters
from agents.tasks.pursuit import PursuitParameters
from agents.tasks.steer import SteerParameters
from muro_zenoh.config import Scenario, find_scenario, parameters_as
from muro_zenoh.control.point_forward import GoToGoal
from muro_zenoh.planning.bounds import Bounds
from muro_zenoh.planning.density import Peaks
from muro_zenoh.planning.destination import Destination
from muro_zenoh.scoring.density import density_error
from muro_zenoh.scoring.deployment import Deployed, Deployment, score_deployment
from muro_zenoh.scoring.goals import score_goals, score_tracking
from muro_zenoh.scoring.observed import Body, Moment, Planned
from muro_zenoh.simulation.rollout.drives import DriveRun, deploy, ride_to_goals, steer_to_goals
from muro_zenoh.simulation.rollout.runs import pursue_ring, settling_time
from muro_zenoh.simulation.rollout.settings import NOISY
from muro_zenoh.simulation.starts import random_starts

LOOP = replace(NOISY, omega_max=1.5)  # as the robots of the scenarios have it
EVERY = 4  # of the plant's moves: ten a second, as a run is sampled


def starts_of(scenario: Scenario, rng: np.random.Generator) -> np.ndarray:
    count = len(scenario.robots)
    return random_starts(rng, count, scenario.arena.bounds, np.full(count, 0.177))


def bounds_of(scenario: Scenario) -> Bounds:
    a = scenario.arena
    return Bounds(a.x_min, a.x_max, a.y_min, a.y_max)


def destinations(scenario: Scenario) -> list[list[Destination]]:
    return [[Destination(*row) for row in scenario.goals[name]] for name in scenario.robots]


def bodies(run: DriveRun, robot: int) -> list[Moment]:
    samples = zip(run.time[::EVERY], run.pose[::EVERY, robot], run.twist[::EVERY, robot], strict=True)
    return [Moment(float(t), Body(*pose.tolist(), *twist.tolist())) for t, pose, twist in samples]


def test_dubins() -> None:
    scenario = find_scenario("dubins", 8, {})
    wanted = parameters_as(DubinsParameters, scenario.behaviour.parameters, "dubins")
    ride = wanted.ride(scenario.robot["r1"], bounds_of(scenario))
    rng = np.random.default_rng(1)
    starts = starts_of(scenario, rng)
    run = ride_to_goals(starts, destinations(scenario), ride, wanted.pause, LOOP, rng, scenario.duration)
    errors: list[float] = []
    for k, name in enumerate(scenario.robots):
        track = bodies(run, k)
        for row in score_goals(scenario.goals[name], track):
            assert row.reached_s is not None
            assert row.distance_m <= 0.05
            assert row.theta is None or row.heading_rad <= 0.1745
        tracked = score_tracking([Planned(t, path) for t, path in run.paths[k]], track)
        errors += tracked.errors
        assert tracked.peak is not None
        assert tracked.peak >= 2 * wanted.v_min
    assert np.quantile(errors, 0.95) <= 0.03


def test_point_forward_steering() -> None:
    scenario = find_scenario("steer", 8, {})
    p = parameters_as(SteerParameters, scenario.behaviour.parameters, "steer")
    law = GoToGoal(p.speed, p.ahead, p.slope, p.tolerance, p.reverse_from)
    rng = np.random.default_rng(1)
    starts = starts_of(scenario, rng)
    run = steer_to_goals(starts, destinations(scenario), law, p.pause, LOOP, rng, scenario.duration)
    for k, name in enumerate(scenario.robots):
        for row in score_goals(scenario.goals[name], bodies(run, k)):
            assert row.reached_s is not None
            assert row.distance_m <= 0.05


def deployed(seed: int, peaks: tuple[tuple[float, float, float, float], ...], seconds: float) -> Deployed:
    scenario = find_scenario("coverage", None, {})
    wanted = parameters_as(CoverageParameters, scenario.behaviour.parameters, "coverage")
    floor = bounds_of(scenario)
    density = Peaks(peaks, wanted.floor) if peaks else None
    ride = wanted.ride(scenario.robot["r1"], floor)
    rng = np.random.default_rng(seed)
    starts = starts_of(scenario, rng)
    run = deploy(starts, floor, density, ride, wanted.hold_time, wanted.stay_within, LOOP, rng, seconds)
    tracks = [bodies(run, k) for k in range(len(starts))]
    fleet = [(row[0].t, {f"r{k}": moment.body for k, moment in enumerate(row)}) for row in zip(*tracks, strict=True)]
    return score_deployment(Deployment(floor, density, wanted.hold_time), fleet, len(starts))


def test_coverage() -> None:
    found = deployed(1, (), 130.0)
    assert found.rounds > 3
    assert found.distance is not None
    assert found.distance <= 0.03
    assert found.gain is not None
    assert found.gain < 0.02
    assert found.rise is not None
    assert found.rise <= 0.02


def test_coverage_gathers_where_it_matters() -> None:
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
    wanted = parameters_as(PursuitParameters, scenario.behaviour.parameters, "importance")
    law = wanted.pursuit_law()
    assert law.importance is not None
    circle = scenario.circle.circle
    rng = np.random.default_rng(1)
    starts = starts_of(scenario, rng)[None]
    run = pursue_ring(starts, circle, law, wanted.circle_law(), LOOP, rng, window + 20.0)
    (settled,) = settling_time(run.time, run.radius_error > 0.03)
    assert settled <= 20.0
    angles = run.angle[run.time > 20.0].ravel()
    places = [(circle.x + math.cos(a), circle.y + math.sin(a)) for a in angles.tolist()]
    error = density_error(places, circle, law.importance)
    assert error is not None
    assert error <= 0.15, error
