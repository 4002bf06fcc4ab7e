"""The base station's table of all positions."""

from __future__ import annotations

import math

import pytest

from basestation.fleet.table import FleetTable, Motion
from muro_zenoh.geometry import Pose2
from muro_zenoh.messages import RobotState

HERE = Pose2(1.0, 0.5, 0.2)


def moving(at: float, pose: Pose2 = HERE, v: float = 0.2, omega: float = 0.1) -> Motion:
    return Motion(pose, v, omega, at)


def row(table: FleetTable, now: float, name: str = "r1") -> RobotState:
    (state,) = [state for state in table.snapshot(now) if state.name == name]
    return state


@pytest.fixture
def table() -> FleetTable:
    """r1 was seen at 10 s."""
    table = FleetTable()
    table.fix("r1", HERE, 10.0)
    return table


def test_a_robot_that_no_camera_saw_is_not_in_it() -> None:
    table = FleetTable()
    table.estimate("r1", moving(1.0))
    assert table.snapshot(1.0) == ()


def test_robots_are_sorted_by_name(table: FleetTable) -> None:
    for name in ("r3", "r10", "r2"):
        table.fix(name, HERE, 10.0)
    assert [state.name for state in table.snapshot(10.0)] == ["r1", "r10", "r2", "r3"]


def test_pose_and_age_are_those_of_the_newest_fix(table: FleetTable) -> None:
    table.estimate("r1", moving(10.1, Pose2(2.0, -1.0, 3.0)))
    table.fix("r1", Pose2(2.0, -1.0, 3.0), 10.1)
    state = row(table, 10.25)
    assert (state.x, state.y, state.theta) == (2.0, -1.0, 3.0)
    assert state.age == pytest.approx(0.15)
    assert state.state == "tracking"


def test_an_older_fix_changes_nothing(table: FleetTable) -> None:
    table.fix("r1", Pose2(9.0, 9.0, 0.0), 9.9)
    assert row(table, 10.1).pose == HERE


def test_an_age_is_never_negative(table: FleetTable) -> None:
    assert row(table, 9.0).age == 0.0


@pytest.mark.parametrize(
    ("age", "state"),
    [
        (0.24, "tracking"),
        (0.26, "stale"),
        (1.99, "stale"),
        (2.01, "lost"),
        (3600.0, "lost"),
    ],
)
def test_a_robot_out_of_sight_turns_stale_then_lost_and_stays_where_it_was(
    table: FleetTable, age: float, state: str
) -> None:
    table.estimate("r1", moving(10.0))
    seen = row(table, 10.0 + age)
    assert seen.state == state
    assert seen.pose == HERE
    assert seen.age == pytest.approx(age)


def test_the_estimate_adds_speeds_and_nothing_else(table: FleetTable) -> None:
    table.estimate("r1", moving(10.05, Pose2(1.05, 0.55, 0.25)))
    state = row(table, 10.1)
    assert (state.v, state.omega) == (0.2, 0.1)
    assert state.pose == HERE


def test_a_lost_robot_has_no_speed_however_fresh_its_estimates(table: FleetTable) -> None:
    table.estimate("r1", moving(13.0))
    state = row(table, 13.0)
    assert (state.state, state.v, state.omega) == ("lost", 0.0, 0.0)


def test_a_robot_that_nothing_was_heard_of_is_silent(table: FleetTable) -> None:
    """It may drive, or be no robot of ours: nobody knows."""
    assert (row(table, 10.0).state, row(table, 10.0).v) == ("silent", 0.0)


def test_an_old_estimate_of_somewhere_else_disagrees(table: FleetTable) -> None:
    table.estimate("r1", moving(9.5, Pose2(-2.0, 0.0, 0.0)))
    state = row(table, 10.0)
    assert (state.state, state.v) == ("disagrees", 0.0), "whatever it does, it does not keep apart where it is seen"


@pytest.mark.parametrize(
    ("silent", "state", "speed"),
    [(0.3, "tracking", 0.2), (0.5, "tracking", 0.2), (0.65, "silent", 0.0), (1.1, "silent", 0.0)],
)
def test_a_robot_that_has_fallen_silent_does_not_stand_at_once(
    table: FleetTable, silent: float, state: str, speed: float
) -> None:
    """Its agent was killed, or cut off: it drives on until the dead-man acts, or its pose is too old, and brakes. Where
    only its link outward is cut, it drives on for longer."""
    table.estimate("r1", moving(10.0))
    table.fix("r1", Pose2(1.05, 0.5, 0.2), 10.0 + silent - 0.05)
    assert (row(table, 10.0 + silent).state, row(table, 10.0 + silent).v) == (state, speed)


def test_a_silent_robot_that_says_something_again_is_tracked(table: FleetTable) -> None:
    table.fix("r1", Pose2(1.05, 0.5, 0.2), 11.5)
    assert row(table, 11.5).state == "silent"
    table.estimate("r1", moving(11.5, Pose2(1.05, 0.5, 0.2)))
    assert row(table, 11.5).state == "tracking"


@pytest.mark.parametrize(
    "elsewhere", [Pose2(1.4, 0.5, 0.2), Pose2(1.0, 0.5, 1.2), Pose2(-1.0, -0.5, 0.2)], ids=["place", "heading", "far"]
)
def test_an_estimate_elsewhere_disagrees(table: FleetTable, elsewhere: Pose2) -> None:
    table.estimate("r1", moving(10.05, elsewhere))
    state = row(table, 10.1)
    assert (state.state, state.v, state.omega) == ("disagrees", 0.0, 0.0)
    assert state.pose == HERE


def test_headings_on_both_sides_of_pi_agree(table: FleetTable) -> None:
    table.fix("r1", Pose2(0.0, 0.0, math.pi - 0.05), 10.0)
    table.estimate("r1", moving(10.0, Pose2(0.0, 0.0, -math.pi + 0.05)))
    assert row(table, 10.05).state == "tracking"


def test_a_fast_robot_may_be_ahead_of_its_fix(table: FleetTable) -> None:
    table.estimate("r1", moving(10.2, Pose2(1.3, 0.5, 0.2), v=0.5))
    assert row(table, 10.2).state == "tracking"


def test_it_is_found_again_where_it_is_seen(table: FleetTable) -> None:
    assert row(table, 13.0).state == "lost"
    table.fix("r1", Pose2(0.0, 0.0, 0.0), 13.0)
    table.estimate("r1", moving(13.0, Pose2(0.0, 0.0, 0.0)))
    assert row(table, 13.1).state == "tracking"


def test_when_a_robot_is_stale_is_a_setting() -> None:
    table = FleetTable(stale_after=0.4)
    table.fix("r1", HERE, 10.0)
    table.estimate("r1", moving(10.0))
    assert row(table, 10.39).state == "tracking"
    assert row(table, 10.41).state == "stale"


def test_a_cleared_robot_is_gone_until_it_is_seen_again(table: FleetTable) -> None:
    table.estimate("r1", moving(10.0))
    assert table.clear("r1")
    assert table.snapshot(10.1) == ()
    assert not table.clear("r1")
    table.fix("r1", HERE, 10.2)
    assert row(table, 10.2).v == 0.0  # its estimate was forgotten, too


@pytest.mark.parametrize("back", [0.04, 0.2, 5.0])
def test_when_the_clock_was_set_back_nothing_is_young(table: FleetTable, back: float) -> None:
    table.estimate("r1", moving(10.0))
    assert row(table, 10.05).state == "tracking"
    lost = row(table, 10.05 - back)
    assert (lost.state, lost.v, lost.x) == ("lost", 0.0, HERE.x)
    assert table.doubts(10.05 - back) == {}
    there = Pose2(1.1, 0.5, 0.2)
    table.fix("r1", there, 10.06 - back)
    assert (row(table, 10.07 - back).state, row(table, 10.07 - back).x) == ("silent", 1.1)


def test_estimates_of_robots_that_no_camera_sees_are_not_kept(table: FleetTable) -> None:
    """A stranger with ever new names must not fill the memory."""
    for number in range(1000):
        table.estimate(f"x{number}", moving(10.0))
    assert len(table._motions) + len(table._doubts._robots) <= 2
