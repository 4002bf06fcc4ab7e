"""Driving by hand, the law: what a wish becomes."""

from __future__ import annotations

import math

import pytest

from muro_zenoh.behaviours.interface import Seen, Vehicle
from muro_zenoh.behaviours.manual import Manual, Parameters, make
from muro_zenoh.geometry import Bounds, State, Twist2

HERE = State(0.0, 0.0, 0.0, 0.0, 0.0)
VEHICLE = Vehicle("r1", 0.177, 0.25, 1.5, 0.1, Bounds(-2.0, 2.0, -1.5, 1.5))


def step(v: float, omega: float) -> Twist2 | None:
    return Manual(0.3, 1.0).step(Seen(0.0, HERE, HERE, wish=Twist2(v, omega), wish_age=0.0)).twist


@pytest.mark.parametrize(
    ("wish", "twist"),
    [
        ((0.1, 0.2), (0.1, 0.2)),
        ((0.0, -0.5), (0.0, -0.5)),
        ((9.0, -9.0), (0.3, -1.0)),
        ((-9.0, 0.0), (-0.3, 0.0)),
    ],
)
def test_a_wish_is_followed_within_the_limits(wish: tuple[float, float], twist: tuple[float, float]) -> None:
    assert step(*wish) == twist


@pytest.mark.parametrize("wish", [(0.0, 0.0), (-0.0, 0.0), (math.nan, 0.0), (0.1, math.nan), (math.inf, 0.0)])
def test_a_stick_that_is_let_go_or_says_no_number_holds(wish: tuple[float, float]) -> None:
    assert step(*wish) is None


def test_without_a_wish_it_holds_and_says_since_when() -> None:
    manual = Manual(0.3, 1.0)
    assert manual.step(Seen(0.0, HERE, HERE)).reason == "nobody has driven it yet"
    held = manual.step(Seen(0.0, HERE, HERE, wish_age=0.31))
    assert (held.twist, held.reason) == (None, "nobody has driven it for 0.3 s")


def test_a_robot_is_no_faster_than_it_can_be() -> None:
    wish = Seen(0.0, HERE, HERE, wish=Twist2(1.0, 0.0), wish_age=0.0)
    assert make(Parameters(speed=0.4), VEHICLE).step(wish).twist == (0.25, 0.0)
