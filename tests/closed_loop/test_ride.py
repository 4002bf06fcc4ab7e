"""A ride to one goal on an ideal unicycle: from anywhere, in front of walls, disturbed, and where none is possible."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from muro_zenoh.arcs import advance
from muro_zenoh.control.path_tracking import TrackingGains
from muro_zenoh.control.ride import RideSettings, is_at, ride_on, set_out, turn_on_the_spot
from muro_zenoh.control.speed_profile import SpeedProfile
from muro_zenoh.errors import PlanningError
from muro_zenoh.geometry import Bounds, Pose2, wrap_to_pi
from muro_zenoh.planning.coverage import Round, next_round
from muro_zenoh.planning.destination import Destination

FLOOR = Bounds(-2.1, 2.1, -1.5, 1.5)
RADIUS = 0.177
SETTINGS = RideSettings(SpeedProfile(reaction=0.0, omega_max=1.2), TrackingGains(), 0.3, FLOOR, RADIUS)
DT = 0.05


class Ridden:
    """What a ride was: its poses, how often it was planned anew, and its last pose."""

    def __init__(self, pose: Pose2, goal: Destination, settings: RideSettings = SETTINGS) -> None:
        self.plans = 1
        self.poses = [pose]
        self.rates: list[float] = []
        ride = set_out(pose, goal, 0.0, settings)
        self.first = ride
        for _ in range(3000):
            move = ride_on(ride, pose, DT, settings)
            if move.state == "arrived":
                break
            if move.state == "off":
                self.plans += 1
                ride = set_out(pose, goal, move.twist.v, settings)
                continue
            ride = move.ride
            for _ in range(5):
                pose = advance(pose, *move.twist, DT / 5)
            self.poses.append(pose)
            self.rates.append(move.twist.omega)
        else:
            raise AssertionError(f"not arrived after {3000 * DT:g} s: {pose}")
        self.end = pose


places = st.tuples(st.floats(-1.9, 1.9), st.floats(-1.3, 1.3))
headings = st.floats(-math.pi, math.pi)


@given(places, headings, st.tuples(st.floats(-1.2, 1.2), st.floats(-0.6, 0.6)), st.none() | headings)
def test_every_goal_away_from_the_walls_is_reached_from_anywhere(
    place: tuple[float, float], heading: float, goal: tuple[float, float], theta: float | None
) -> None:
    ridden = Ridden(Pose2(*place, heading), Destination(*goal, theta))
    assert math.hypot(ridden.end.x - goal[0], ridden.end.y - goal[1]) <= 0.03
    assert theta is None or abs(wrap_to_pi(ridden.end.theta - theta)) <= 0.1
    inside = FLOOR.shrunk(RADIUS)
    assert all(inside.holds(p.x, p.y, slack=0.05) for p in ridden.poses[1:])


@pytest.mark.parametrize("heading", [0.0, 0.4, -0.4])
@pytest.mark.parametrize("x", [1.85, 1.95])  # before the margin, and within it
def test_a_robot_that_faces_a_wall_turns_on_the_spot_first(x: float, heading: float) -> None:
    pose = Pose2(x, 0.0, heading)
    ridden = Ridden(pose, Destination(0.0, 0.5))
    assert ridden.first.turning
    assert math.hypot(ridden.end.x, ridden.end.y - 0.5) <= 0.03
    assert max(p.x for p in ridden.poses) <= max(x, FLOOR.x_max - RADIUS) + 0.02


def test_without_need_there_is_no_turn_on_the_spot() -> None:
    assert not set_out(Pose2(0.0, 0.0, 0.0), Destination(1.0, 0.5), 0.0, SETTINGS).turning


@pytest.mark.parametrize("side", [0.05, -0.05, 0.2, -0.2])
def test_a_goal_inside_the_turning_circle_is_reached(side: float) -> None:
    ridden = Ridden(Pose2(0.0, 0.0, 0.0), Destination(0.0, side))
    assert math.hypot(ridden.end.x, ridden.end.y - side) <= 0.03


def test_left_and_right_are_alike() -> None:
    left = Ridden(Pose2(-0.5, 0.0, 0.3), Destination(0.4, 0.7, 2.0))
    right = Ridden(Pose2(-0.5, 0.0, -0.3), Destination(0.4, -0.7, -2.0))
    assert len(left.poses) == len(right.poses)
    for a, b in zip(left.poses, right.poses, strict=True):
        assert (b.x, b.y, b.theta) == pytest.approx((a.x, -a.y, -a.theta), abs=1e-9)


def test_at_the_goal_there_is_no_ride() -> None:
    pose = Pose2(0.5, 0.5, 1.0)
    assert is_at(pose, Destination(0.505, 0.5), 0.01)
    assert not is_at(pose, Destination(0.52, 0.5), 0.01)
    assert is_at(pose, Destination(0.5, 0.5, 1.0 + 2 * math.pi), 0.01)
    assert not is_at(pose, Destination(0.5, 0.5, -1.0), 0.01)


def test_at_the_goal_with_another_heading_there_is_a_ride() -> None:
    ridden = Ridden(Pose2(0.0, 0.0, 0.0), Destination(0.0, 0.0, math.pi))
    assert abs(wrap_to_pi(ridden.end.theta - math.pi)) <= 0.1
    assert math.hypot(ridden.end.x, ridden.end.y) <= 0.03


def test_a_robot_carried_off_its_path_plans_again() -> None:
    goal = Destination(1.2, 0.0)
    ride = set_out(Pose2(-1.0, 0.0, 0.0), goal, 0.0, SETTINGS)
    assert ride_on(ride, Pose2(-0.9, 0.14, 0.0), DT, SETTINGS).state == "on"
    assert ride_on(ride, Pose2(-0.9, 0.16, 0.0), DT, SETTINGS).state == "off"
    assert ride_on(ride, Pose2(-0.9, -0.16, 0.0), DT, SETTINGS).state == "off"


def test_a_path_that_ends_beside_the_goal_is_planned_again() -> None:
    ride = set_out(Pose2(0.0, 0.0, 0.0), Destination(0.3, 0.0), 0.0, SETTINGS)
    assert ride_on(ride, Pose2(0.3, 0.02, 0.0), DT, SETTINGS).state == "arrived"
    assert ride_on(ride, Pose2(0.3, 0.05, 0.0), DT, SETTINGS).state == "off"


def test_a_tighter_radius_is_used_where_the_arena_requires_it() -> None:
    ride = set_out(Pose2(1.7, 0.0, 0.0), Destination(0.0, 0.1), 0.0, SETTINGS)
    assert not ride.turning
    assert abs(ride.path.segments[0].curvature) == pytest.approx(1 / (0.7 * 0.3))


def test_a_goal_outside_and_a_heading_that_only_a_wall_allows_are_refused() -> None:
    with pytest.raises(PlanningError, match="outside the arena"):
        set_out(Pose2(0.0, 0.0, 0.0), Destination(2.0, 0.0), 0.0, SETTINGS)
    with pytest.raises(PlanningError, match="leaves the arena"):  # it would have to come out of the wall
        set_out(Pose2(0.0, 0.0, 0.0), Destination(1.92, 1.32, -2.4), 0.0, SETTINGS)


def test_turning_uses_the_shorter_direction_and_ends() -> None:
    path = set_out(Pose2(0.0, 0.0, 3.0), Destination(-1.0, 0.14), 0.0, SETTINGS).path
    assert turn_on_the_spot(path, Pose2(0.0, 0.0, 3.0)) == 0.0
    assert turn_on_the_spot(path, Pose2(0.0, 0.0, -3.0)) < 0.0
    assert turn_on_the_spot(path, Pose2(0.0, 0.0, 2.5)) > 0.0


def test_rounds_begin_when_all_are_stationary_and_again_when_none_moves() -> None:
    turn, due = Round(), []
    for k in range(40):
        turn = next_round(k / 10, 5 <= k != 20, turn, 1.0)
        if turn.due:
            due.append(k)
    assert due == [15, 31]


def test_while_no_robot_moves_a_round_begins_every_hold_time() -> None:
    turn, due = Round(), []
    for k in range(35):
        turn = next_round(k / 10, True, turn, 1.0)
        if turn.due:
            due.append(k)
    assert len(due) == 3


@pytest.mark.parametrize(("off", "state"), [(0.1, "arrived"), (-0.1, "arrived"), (0.2, "off"), (-2.0, "off")])
def test_a_robot_that_comes_to_its_goal_from_another_side_plans_again(off: float, state: str) -> None:
    """It may have had to keep clear of another."""
    ride = set_out(Pose2(0.0, 0.0, 0.0), Destination(1.0, 0.0, 0.0), 0.0, SETTINGS)
    ended = ride._replace(progress=ride.progress._replace(s=ride.path.length))
    assert ride_on(ended, Pose2(1.0, 0.0, off), DT, SETTINGS).state == state
    anyhow = ended._replace(goal=Destination(1.0, 0.0))
    assert ride_on(anyhow, Pose2(1.0, 0.0, off), DT, SETTINGS).state == "arrived"
