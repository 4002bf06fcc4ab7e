"""The goals of one robot: a list of its own, and the one that an operator sends."""

from __future__ import annotations

import pytest

from muro_zenoh.behaviours.dubins import GoalRide, RideParameters
from muro_zenoh.behaviours.interface import Seen, Vehicle
from muro_zenoh.geometry import Bounds, State
from muro_zenoh.planning.destination import Destination
from muro_zenoh.planning.itinerary import Itinerary

A, B, C = Destination(1.0, 0.5), Destination(-1.0, 0.0, 1.57), Destination(0.3, -0.4, 0.1)


def test_the_list_is_visited_in_order() -> None:
    goals = Itinerary([A, B], pause=2.0)
    assert goals.begin_next(10.0)
    assert goals.current == A
    assert not goals.begin_next(10.0)  # the same one
    goals.arrive(20.0)
    assert goals.waiting == "at goal 1, pausing before the next"
    assert not goals.begin_next(21.9)
    assert goals.begin_next(22.0)
    assert goals.current == B
    goals.arrive(30.0)
    assert not goals.begin_next(99.0)
    assert (goals.reached, goals.waiting) == (2, "all goals reached")


def test_without_goals_there_is_nothing_to_do() -> None:
    goals = Itinerary()
    assert not goals.begin_next(0.0)
    assert (goals.current, goals.waiting) == (None, "no goal")


def test_an_order_replaces_the_goal_and_ends_the_list() -> None:
    goals = Itinerary([A, B])
    goals.begin_next(0.0)
    goals.replace(C)
    assert goals.current == C
    goals.arrive(1.0)
    assert not goals.begin_next(99.0)


def test_a_goal_that_is_given_up_is_named_and_the_next_one_follows() -> None:
    goals = Itinerary([A, B], pause=2.0)
    goals.begin_next(0.0)
    goals.give_up(5.0, "no path")
    assert goals.waiting == goals.given_up == "goal (1, 0.5) given up: no path"
    assert not goals.begin_next(6.9)
    assert goals.begin_next(7.0)
    goals.arrive(8.0)
    assert (goals.reached, goals.waiting, goals.given_up) == (1, "all goals reached", "")


@pytest.mark.parametrize(
    ("goals", "reason"), [([], "idle"), ([Destination(9.0, 0.0)], "goal (9, 0) given up: goal: got")]
)
def test_a_ride_without_a_goal_shows_what_it_gave_up_before_why_it_idles(goals: list[Destination], reason: str) -> None:
    vehicle = Vehicle("r1", 0.177, 0.4, 1.5, 0.1, Bounds(-2.0, 2.0, -1.0, 1.0))
    ride = GoalRide(RideParameters().settings(vehicle), Itinerary(goals), "idle")
    there = State(0.0, 0.0, 0.0, 0.0, 0.0)
    assert ride.step(Seen(1.0, there, there)).reason.startswith(reason)
