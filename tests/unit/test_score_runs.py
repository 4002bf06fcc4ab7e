"""Goals, paths, deployments and densities on the score sheet, against numbers worked out by hand."""

from __future__ import annotations

import math

import pytest

from muro_zenoh.behaviours.interface import Deployment
from muro_zenoh.config import find_scenario
from muro_zenoh.control.importance import Importance
from muro_zenoh.errors import ConfigError
from muro_zenoh.geometry import Bounds, Circle, Pose2
from muro_zenoh.planning.path import Path, Segment
from muro_zenoh.scoring.density import density_error
from muro_zenoh.scoring.deployment import score_deployment
from muro_zenoh.scoring.expectations import expectation_of
from muro_zenoh.scoring.goals import rests, score_goals, score_tracking
from muro_zenoh.scoring.observed import Body, Moment, Planned


def track(*spans: tuple[float, float, float, float, float]) -> list[Moment]:
    """Ten moments a second: from, to [s], x at the beginning, speed [m/s], heading [rad]."""
    return [
        Moment(k / 10, Body(x + v * (k / 10 - begin), 0.0, theta, v, 0.0))
        for begin, end, x, v, theta in spans
        for k in range(round(10 * begin), round(10 * end))
    ]


def test_a_rest_has_a_minimum_duration() -> None:
    found = rests(track((0, 2, 0.0, 0.5, 0), (2, 2.4, 1.0, 0.0, 0), (2.4, 4, 1.0, 0.5, 0), (4, 6, 1.8, 0.001, 0)))
    assert [(round(s.begin, 2), round(s.end, 2)) for s in found] == [(4.0, 5.9)]
    assert found[0].body.x == pytest.approx(1.8019)


def test_a_robot_that_turns_on_the_spot_does_not_rest() -> None:
    assert rests([Moment(k / 10, Body(0.0, 0.0, 0.0, 0.0, 0.2)) for k in range(30)]) == []


def test_goals_are_reached_in_their_order() -> None:
    drive = track((0, 2, 0.0, 0.5, 0), (2, 4, 1.01, 0.0, 0), (4, 6, 1.01, 0.5, 0), (6, 9, 2.04, 0.0, 3.1))
    first, second, third = score_goals([(1.0, 0.0), (2.0, 0.0, -3.1), (1.0, 0.0)], drive)
    assert (first.reached_s, first.distance_m, first.heading_rad) == (2.0, 0.01, None)
    assert (second.reached_s, second.distance_m) == (6.0, 0.04)
    assert second.heading_rad == pytest.approx(2 * math.pi - 6.2, abs=1e-4)
    assert (third.reached_s, third.distance_m, third.theta) == (None, None, None)


def test_a_robot_that_stops_short_and_comes_nearer_is_judged_by_its_last_rest() -> None:
    drive = track((0, 1, 0.91, 0.0, 0), (1, 1.8, 0.91, 0.1, 0), (1.8, 4, 0.99, 0.0, 0))
    (row,) = score_goals([(1.0, 0.0)], drive)
    assert (row.reached_s, row.distance_m) == (1.8, 0.01)


def test_a_goal_that_is_passed_without_a_rest_is_not_reached() -> None:
    (row,) = score_goals([(1.0, 0.0)], track((0, 4, 0.0, 0.5, 0)))
    assert row.reached_s is None


def test_tracking_is_the_distance_from_the_path_in_force() -> None:
    straight = Planned(0.0, Path(Pose2(0.0, -0.02, 0.0), (Segment(1.0, 0.0), Segment(1.0, 1.0))))
    later = Planned(1.0, Path(Pose2(0.5, 0.01, 0.0), (Segment(9.0, 0.0),)))
    errors, peak = score_tracking([straight, later], track((0, 1, 0.0, 0.5, 0), (1, 2, 0.5, 0.6, 0)))
    assert errors == pytest.approx([0.02] * 10 + [0.01] * 10)
    assert peak == 0.6


def test_a_path_from_which_a_robot_is_diverted_counts_no_more_and_the_next_one_does() -> None:
    first = Planned(0.0, Path(Pose2(0.0, -0.02, 0.0), (Segment(9.0, 0.0),)))
    second = Planned(4.0, Path(Pose2(2.0, 0.01, 0.0), (Segment(9.0, 0.0),)))
    drive = [row._replace(diverted=2.45 < row.t < 3.45) for row in track((0, 5, 0.0, 0.5, 0))]
    errors, _ = score_tracking([first, second], drive)
    assert errors == pytest.approx([0.02] * 15 + [0.01] * 10)  # health says so up to a second later


def test_the_speed_on_an_arc_is_not_counted_as_one_on_a_straight() -> None:
    arc = Planned(0.0, Path(Pose2(0.0, 0.0, 0.0), (Segment(2.0, -0.01),)))
    errors, peak = score_tracking([arc], track((0, 1, 0.0, 0.5, 0)))
    assert len(errors) == 10
    assert peak is None


def test_before_the_first_path_and_at_rest_nothing_is_tracked() -> None:
    path = Planned(1.0, Path(Pose2(0.5, 0.3, 0.0), (Segment(1.0, 0.0),)))
    assert score_tracking([path], track((0, 1, 0.0, 0.5, 0), (1, 3, 0.5, 0.0, 0))) == ([], None)


FLOOR = Deployment(Bounds(0.0, 2.0, 0.0, 1.0), None, 0.5)


def rest(begin: float, end: float, a: float, b: float) -> list[tuple[float, dict[str, Body]]]:
    """Two robots at rest at x = a and b, in the middle of the floor's width."""
    bodies = {"r1": Body(a, 0.5, 0.0, 0.0, 0.0), "r2": Body(b, 0.5, 0.0, 0.0, 0.0)}
    return [(k / 10, bodies) for k in range(round(10 * begin), round(10 * end))]


def moving(begin: float, end: float) -> list[tuple[float, dict[str, Body]]]:
    bodies = {"r1": Body(0.1, 0.5, 0.0, 0.2, 0.0), "r2": Body(1.0, 0.5, 0.0, 0.0, 0.0)}
    return [(k / 10, bodies) for k in range(round(10 * begin), round(10 * end))]


def test_a_deployment_that_is_done() -> None:
    found = score_deployment(FLOOR, [*moving(0, 2), *rest(2, 4, 0.45, 1.55), *moving(4, 5), *rest(5, 7, 0.5, 1.5)], 2)
    assert found.rounds == 2
    assert found.distance == pytest.approx(0.0, abs=1e-9)
    assert found.cost == pytest.approx(2 / 6)  # two unit squares about their centres
    assert found.gain == pytest.approx(0.0, abs=1e-6)
    assert found.rise == pytest.approx((1 / 6) / (1 / 6 + 0.05**2) - 1)  # it fell


def test_a_cost_that_rises_is_seen_and_what_is_left_to_gain() -> None:
    found = score_deployment(FLOOR, [*rest(0, 1, 0.5, 1.5), *moving(1, 2), *rest(2, 3, 0.4, 1.6)], 2)
    assert found.rise == pytest.approx(0.1**2 * 6)
    assert found.distance == pytest.approx(0.1)
    assert found.gain == pytest.approx(1 - (1 / 6) / (1 / 6 + 0.1**2), abs=1e-5)


def test_robots_that_drive_at_the_end_have_not_deployed() -> None:
    found = score_deployment(FLOOR, [*rest(0, 1, 0.5, 1.5), *moving(1, 2)], 2)
    assert (found.distance, found.gain, found.rounds) == (None, None, 1)
    found = score_deployment(FLOOR, rest(0, 0.3, 0.5, 1.5), 2)  # shorter than the hold time
    assert (found.distance, found.cost, found.rise, found.rounds) == (None, None, None, 0)


def test_a_moment_that_misses_a_robot_is_skipped() -> None:
    fleet = [*rest(0, 1, 0.5, 1.5), (1.0, {"r1": Body(0.1, 0.1, 0.0, 0.0, 0.0)})]
    assert score_deployment(FLOOR, fleet, 2).distance == pytest.approx(0.0, abs=1e-9)


CIRCLE = Circle(1.0, -0.5, 0.8)
HALF = Importance.from_function(lambda angle: 3.0 if angle < math.pi else 1.0)


def spread(count: int, share_of_left: float) -> list[tuple[float, float]]:
    """Places round the circle: in its upper half ``share_of_left`` of them, evenly, the rest in its lower one."""
    upper = round(count * share_of_left)
    angles = [math.pi * (k + 0.5) / upper for k in range(upper)]
    angles += [math.pi + math.pi * (k + 0.5) / (count - upper) for k in range(count - upper)]
    return [(CIRCLE.x + 0.8 * math.cos(a), CIRCLE.y + 0.8 * math.sin(a)) for a in angles]


def test_a_density_that_is_achieved_and_one_that_is_not() -> None:
    assert density_error(spread(7200, 0.75), CIRCLE, HALF) == pytest.approx(0.0, abs=2e-3)
    assert density_error(spread(7200, 0.5), CIRCLE, HALF) == pytest.approx(0.25, abs=2e-3)
    even = Importance.from_function(lambda angle: 1.0)
    assert density_error([(2.0, -0.4)], CIRCLE, even) == pytest.approx(1 - 1 / 36)
    assert density_error([], CIRCLE, HALF) is None


def test_the_expectations_of_the_built_in_scenarios() -> None:
    dubins = expectation_of(find_scenario("dubins", 3))
    assert set(dubins.goals) == {"r1", "r2", "r3"}
    assert dubins.v_min == 0.1
    assert not dubins.follows_circle
    coverage = expectation_of(find_scenario("coverage"))
    assert coverage.deployment is not None
    assert coverage.deployment.floor == Bounds(-2.1, 2.1, -1.5, 1.5)
    importance = expectation_of(find_scenario("importance"))
    assert (importance.follows_circle, importance.spreads) == (True, False)
    assert importance.importance is not None
    assert importance.importance.contrast == pytest.approx(3.0, abs=1e-3)
    assert expectation_of(find_scenario("pursuit")).spreads


def test_parameters_that_do_not_fit_are_refused_before_anything_is_scored() -> None:
    with pytest.raises(ConfigError, match="cruise"):
        expectation_of(find_scenario("pursuit", None, {"behaviour.cruise": 9.0}))
