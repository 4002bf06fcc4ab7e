"""The separation filter: what passes, what does not, and what cannot be used."""

from __future__ import annotations

import math

import pytest

from muro_zenoh.behaviours.interface import Neighbour, Snapshot
from muro_zenoh.geometry import STILL, Bounds, State, Twist2
from muro_zenoh.safety.separation import Body, Separation, SeparationSettings

ARENA = Bounds(-2.1, 2.1, -1.5, 1.5)
BODY = Body()
FLEET = {"r1": BODY, "r2": BODY}
AHEAD = Twist2(0.3, 0.1)


def seen(*robots: Neighbour, stamp: float = 1.0) -> Snapshot:
    return Snapshot(robots, stamp, 1, 0.0)


def row(name: str, x: float, y: float, theta: float = 0.0, v: float = 0.0, state: str = "tracking") -> Neighbour:
    return Neighbour(name, x, y, theta, v, 0.0, 0.0, state)


def separation() -> Separation:
    return Separation("r1", BODY, FLEET, ARENA, SeparationSettings())


def test_a_robot_alone_drives_as_it_wants() -> None:
    step = separation().step(0.0, State(0.0, 0.0, 0.0, 0.3, 0.0), AHEAD, seen(row("r1", 0.0, 0.0, v=0.3)))
    assert step == (AHEAD, "")


def test_it_does_not_drive_into_another() -> None:
    step = separation().step(
        0.0, State(0.0, 0.0, 0.0, 0.3, 0.0), AHEAD, seen(row("r1", 0.0, 0.0, v=0.3), row("r2", 0.5, 0.0))
    )
    assert step.twist.v < 0.15
    assert "r2" in step.reason


def test_it_does_not_drive_into_the_wall() -> None:
    step = separation().step(0.0, State(1.85, 0.0, 0.0, 0.3, 0.0), AHEAD, seen(row("r1", 1.85, 0.0, v=0.3)))
    assert step.twist.v < 0.15
    assert "wall" in step.reason


def test_without_positions_it_brakes() -> None:
    step = separation().step(0.0, State(0.0, 0.0, 0.0, 0.3, 0.0), AHEAD, None)
    assert step.twist == STILL
    assert step.reason == "brakes: no fresh positions"


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", ["x", "y", "theta", "v", "omega", "age"])
def test_a_snapshot_with_a_number_that_is_none_cannot_be_used(field: str, wrong: float) -> None:
    garbage = row("r2", 1.0, 0.0)._replace(**{field: wrong})
    step = separation().step(0.0, State(0.0, 0.0, 0.0, 0.0, 0.0), AHEAD, seen(row("r1", 0.0, 0.0), garbage))
    assert step.twist == STILL
    assert step.reason == "brakes: no fresh positions"


def test_a_behaviour_that_holds_is_not_moved() -> None:
    step = separation().step(
        0.0, State(0.0, 0.0, 0.0, 0.0, 0.0), None, seen(row("r1", 0.0, 0.0), row("r2", 0.38, 0.0, math.pi, 0.1))
    )
    assert step == (STILL, "")
