"""The Frenet law on the plant: its identity, and random Dubins paths driven to their end."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from muro_zenoh.arcs import advance
from muro_zenoh.control.path_tracking import (
    FollowStep,
    Progress,
    TrackingGains,
    follow_path,
    frenet_law,
    path_error,
)
from muro_zenoh.control.speed_profile import SpeedProfile
from muro_zenoh.geometry import Pose2, wrap_to_pi
from muro_zenoh.planning.dubins import plan
from muro_zenoh.planning.path import Path, Segment

GAINS = TrackingGains()
Law = Callable[[float, float, float, float, TrackingGains], float]


def wrong_sign(lateral: float, dtheta: float, curvature: float, v: float, gains: TrackingGains) -> float:
    feedback = frenet_law(lateral, dtheta, 0.0, v, gains)
    return feedback + v * math.cos(dtheta) * curvature / (1.0 + curvature * lateral)


def identity_error(law: Law, curvature: float, lateral: float, dtheta: float, v: float) -> float:
    """d dtheta / dt measured on the unicycle, less -ka v l sinc(dtheta) - kb dtheta."""
    path = Path(Pose2(0.3, -0.2, 0.7), (Segment(4.0 / abs(curvature), curvature),))
    s = 2.0 / abs(curvature)
    on = path.pose_at(s)
    pose = Pose2(on.x - lateral * math.sin(on.theta), on.y + lateral * math.cos(on.theta), on.theta + dtheta)
    omega = law(lateral, dtheta, curvature, v, GAINS)
    dt = 1e-5
    ahead = path_error(path, advance(pose, v, omega, dt), s)
    behind = path_error(path, advance(pose, v, omega, -dt), s)
    measured = wrap_to_pi(ahead.dtheta - behind.dtheta) / (2.0 * dt)
    kb = 2.0 * GAINS.zeta * abs(v) * math.sqrt(GAINS.ka)
    return measured - (-GAINS.ka * v * lateral * float(np.sinc(dtheta / math.pi)) - kb * dtheta)


@pytest.mark.parametrize("radius", [0.02, 0.05, 0.08, 0.1, 0.12, 0.14, 0.5])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("side", [-0.9, 0.0, 0.9])
def test_on_a_tight_arc_the_nearest_point_is_that_of_this_turn(radius: float, sign: float, side: float) -> None:
    # Three turns: a robot that is a little behind must not be taken to be a whole turn ahead.
    path = Path(Pose2(0.3, -0.2, 0.7), (Segment(6.0 * math.pi * radius, sign / radius),))
    s = 3.0 * math.pi * radius
    for turned in (-0.5, -0.05, 0.0, 0.05, 0.5, 2.0):
        if abs(turned) * radius > 0.1 and turned < 0.0:
            continue  # farther back than is searched
        on = path.pose_at(s + turned * radius)
        off = side * radius
        pose = Pose2(on.x - off * math.sin(on.theta), on.y + off * math.cos(on.theta), on.theta)
        if turned * radius <= 0.4:
            assert path_error(path, pose, s).s == pytest.approx(s + turned * radius, abs=1e-9)


def test_a_robot_beyond_the_centre_of_a_tight_arc_does_not_skip_half_a_turn() -> None:
    path = Path(Pose2(0.0, 0.0, 0.0), (Segment(6.0 * math.pi * 0.1, 10.0),))
    s = 3.0 * math.pi * 0.1
    on = path.pose_at(s)
    beyond = Pose2(on.x - 0.11 * math.sin(on.theta), on.y + 0.11 * math.cos(on.theta), on.theta)
    assert abs(path_error(path, beyond, s).s - s) < 0.9 * math.pi * 0.1 + 1e-9


def test_reach_stops_where_the_turn_is_used_up_and_counts_both_ways() -> None:
    path = Path(Pose2(0.0, 0.0, 0.0), (Segment(1.0, 0.0), Segment(0.3, 10.0), Segment(0.3, -10.0), Segment(1.0, 0.0)))
    assert path.reach(0.5, 0.4, 1.0) == pytest.approx(0.4)  # straight
    assert path.reach(0.8, 0.4, 1.0) == pytest.approx(0.3)  # 0.2 straight, 0.1 m is 1 rad
    assert path.reach(1.2, 0.4, 2.0) == pytest.approx(0.2)  # 1 rad to the left and 1 to the right
    assert path.reach(1.8, -0.4, 1.0) == pytest.approx(0.3)
    assert path.reach(1.4, -0.2, 3.0) == pytest.approx(0.2)
    assert path.reach(2.5, 0.4, 1.0) == pytest.approx(0.4)  # beyond the end nothing turns


@pytest.mark.parametrize("curvature", [1.0, -1.0, 3.0, -3.0])
@pytest.mark.parametrize("side", [0.5, -0.5])
@pytest.mark.parametrize("dtheta", [0.0, 0.4, -0.9])
def test_the_frenet_identity_holds_on_both_arcs_and_the_wrong_sign_fails_it(
    curvature: float, side: float, dtheta: float
) -> None:
    lateral = side / abs(curvature)
    assert abs(identity_error(frenet_law, curvature, lateral, dtheta, 0.2)) < 1e-6
    assert abs(identity_error(wrong_sign, curvature, lateral, dtheta, 0.2)) > 0.05


def test_near_the_centre_of_an_arc_the_rate_is_bounded() -> None:
    for lateral in (0.99, 1.0, 1.01, 3.0):
        assert math.isfinite(frenet_law(lateral, 0.0, 1.0, 0.2, GAINS))
        assert abs(frenet_law(lateral, 0.0, 1.0, 0.2, GAINS) - frenet_law(lateral, 0.0, 0.0, 0.2, GAINS)) <= 2.0 + 1e-9


def test_arrays_and_floats_agree() -> None:
    rng = np.random.default_rng(8)
    lateral, dtheta, curvature, v = rng.uniform(-0.9, 0.9, (4, 100))
    dtheta[:5] = 0.0
    rates = frenet_law(lateral, dtheta, curvature, v, GAINS)
    rows = zip(*(a.tolist() for a in (lateral, dtheta, curvature, v)), strict=True)
    np.testing.assert_allclose(rates, [frenet_law(*row, GAINS) for row in rows], atol=1e-12)


def follow(path: Path, pose: Pose2, profile: SpeedProfile, dt: float = 0.05) -> tuple[Pose2, list[FollowStep]]:
    steps: list[FollowStep] = []
    progress = Progress()
    while len(steps) < 4000:
        step = follow_path(path, pose, progress, dt, GAINS, profile)
        steps.append(step)
        if step.arrived:
            return pose, steps
        pose, progress = advance(pose, *step.twist, dt), step.progress
    raise AssertionError(f"not arrived after {len(steps) * dt} s, {steps[-1].to_go} m to go")


PROFILE = SpeedProfile(v_min=0.12, v_max=0.3)


def test_random_dubins_paths_are_tracked_and_ended_within_tolerance() -> None:
    rng = np.random.default_rng(12)
    errors, fast = [], 0
    for _ in range(60):
        start, goal = (Pose2(*rng.uniform([-2.0, -1.4, -math.pi], [2.0, 1.4, math.pi]).tolist()) for _ in range(2))
        path = plan(start, goal, 0.3)
        end, steps = follow(path, start, PROFILE)
        errors += [abs(step.error.lateral) for step in steps]
        assert math.dist(end[:2], goal[:2]) <= 0.02
        assert abs(wrap_to_pi(end.theta - goal.theta)) <= math.radians(3.0)
        assert steps[-1].twist.v == 0.0
        assert max(step.twist.v for step in steps) <= 0.3
        fast += max(step.twist.v for step in steps) >= 2 * 0.12
    assert np.quantile(errors, 0.95) <= 0.01
    assert fast > 30


@settings(max_examples=50)
@given(
    lateral=st.floats(-0.2, 0.2),
    dtheta=st.floats(-1.0, 1.0),
    curvature=st.sampled_from([0.0, 1.0, -1.0, 2.5, -2.5]),
)
def test_a_robot_beside_the_path_returns_to_it(lateral: float, dtheta: float, curvature: float) -> None:
    path = Path(Pose2(0.0, 0.0, 0.3), (Segment(2.0, curvature),))
    on = path.pose_at(0.2)
    start = Pose2(on.x - lateral * math.sin(on.theta), on.y + lateral * math.cos(on.theta), on.theta + dtheta)
    end, steps = follow(path, start, PROFILE)
    assert abs(steps[-1].error.lateral) < 0.005
    assert math.dist(end[:2], path.end[:2]) < 0.02


def test_far_from_the_path_it_turns_towards_it_and_not_back() -> None:
    path = Path(Pose2(0.0, 0.0, 0.0), (Segment(8.0, 0.0),))
    _, steps = follow(path, Pose2(0.0, 3.0, 0.0), PROFILE)
    assert min(step.error.dtheta for step in steps) > -math.pi / 2
    assert abs(steps[-1].error.lateral) < 0.005


def test_a_new_plan_brings_a_robot_that_was_carried_off_its_path_to_the_goal() -> None:
    goal = Pose2(1.5, 0.8, 1.0)
    path = plan(Pose2(-1.5, 0.0, 0.0), goal, 0.3)
    _, steps = follow(path, path.start, PROFILE)
    assert all(abs(step.error.lateral) < 0.1 and abs(step.error.dtheta) < 1.0 for step in steps)
    halfway = steps[len(steps) // 2].progress
    carried = path.pose_at(halfway.s).compose(Pose2(0.0, 0.3, 0.5))
    assert path_error(path, carried, halfway.s).lateral > 0.25
    end, _ = follow(plan(carried, goal, 0.3), carried, PROFILE)
    assert math.dist(end[:2], goal[:2]) < 0.02


def test_where_a_path_crosses_itself_it_goes_on_along_it() -> None:
    loop = Path(Pose2(0.0, 0.0, 0.0), (Segment(1.0, 0.0), Segment(1.5 * math.pi * 0.4, 1.0 / 0.4), Segment(1.0, 0.0)))
    end, steps = follow(loop, Pose2(0.0, 0.0, 0.0), PROFILE)
    assert math.dist(end[:2], loop.end[:2]) < 0.02
    assert max(abs(step.error.lateral) for step in steps) < 0.02


@pytest.mark.parametrize("changes", [{"ka": 0.0}, {"zeta": math.nan}])
def test_invalid_gains_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="above 0"):
        TrackingGains(**changes)
