"""A goal that a user's own behaviour asks for."""

from __future__ import annotations

import math

import pytest

from agents.robot import Connection, Robot
from muro_zenoh.behaviours.interface import Behaviour, Seen
from muro_zenoh.config import parse_scenario
from muro_zenoh.errors import ParameterError, PlanningError
from muro_zenoh.geometry import State
from muro_zenoh.messages import Estimate
from muro_zenoh.transport import Latest

LAB = parse_scenario({"robots": 1}, "lab.toml", name="lab")
THERE = State(0.0, 0.0, 0.0, 0.0, 0.0)


def robot_with(rides: list[Behaviour | None]) -> Robot:
    def no_mailbox() -> Latest[Estimate]:
        raise AssertionError("nobody asks for estimates here")

    seen = Seen(1.0, THERE, THERE)
    connection = Connection(lambda: seen, lambda _: None, rides.append, no_mailbox, lambda: seen.now)
    return Robot(LAB.vehicle("r1"), LAB.robot["r1"], {}, connection)


def test_a_goal_begins_a_ride() -> None:
    rides: list[Behaviour | None] = []
    robot_with(rides).goal(1.0, 0.5)
    (ride,) = rides
    assert ride is not None
    assert ride.step(Seen(1.0, THERE, THERE)).twist is not None


@pytest.mark.parametrize(
    ("goal", "what"),
    [((math.nan, 0.0), "x: got nan"), ((0.0, math.inf), "y: got inf"), ((0.0, 0.0, math.nan), "theta: got nan")],
)
def test_a_goal_that_is_no_position_is_not_taken_for_reached(goal: tuple[float, ...], what: str) -> None:
    rides: list[Behaviour | None] = []
    with pytest.raises(ParameterError, match=f"{what}, expected a number"):
        robot_with(rides).goal(*goal)
    assert not rides


def test_a_goal_outside_the_arena_is_refused() -> None:
    rides: list[Behaviour | None] = []
    with pytest.raises(PlanningError, match=r"goal: got \(9, 0\), outside the arena"):
        robot_with(rides).goal(9.0, 0.0)
    assert not rides
