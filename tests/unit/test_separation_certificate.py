"""The certificate: a millimetre on either side of what it must refuse."""

from __future__ import annotations

import math

import pytest

from muro_zenoh.behaviours.interface import Neighbour, Snapshot
from muro_zenoh.geometry import STILL, Bounds, State, Twist2
from muro_zenoh.safety.separation import Body, SeparationSettings
from muro_zenoh.safety.separation.certificate import Certificate
from muro_zenoh.safety.separation.knowledge import Knowledge
from muro_zenoh.safety.separation.path import braking_path

BODY = Body()
SETTINGS = SeparationSettings()
OPEN = Bounds(-9.0, 9.0, -9.0, 9.0)
SLOW = Twist2(0.3, 0.0)
COMES = braking_path(State(0.0, 0.0, 0.0, 0.3, 0.0), SLOW, SETTINGS.hold, BODY)[-1][0]
"""How far a robot comes at 0.3 m/s, held and braked: 0.18 m."""
MM = 1e-3


def knowing(*others: Neighbour) -> Knowledge:
    """What r1 knows, which is seen at rest at the origin."""
    known = Knowledge("r1", BODY, {"r1": BODY, "r2": BODY}, SETTINGS)
    known.learn(0.0, Snapshot((Neighbour("r1", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), *others), 0.0, 1, 0.0))
    return known


def blocker(command: Twist2, state: State, inside: Bounds = OPEN, *others: Neighbour) -> str:
    fastest = max(abs(command.v), 0.2)
    return Certificate(state, BODY, inside, knowing(*others), SETTINGS, fastest).blocker(command)


@pytest.mark.parametrize(("name", "state"), [("r2", "lost"), ("r2", "stale"), ("r2", "disagrees"), ("x1", "tracking")])
def test_what_does_not_keep_apart_itself_is_kept_the_whole_distance_from(name: str, state: str) -> None:
    keep = 2.0 * BODY.radius + SETTINGS.margin
    here = State(0.0, 0.0, 0.0, 0.3, 0.0)
    for away, found in ((-MM, name), (MM, "")):
        other = Neighbour(name, COMES + keep + away, 0.0, 0.0, 0.0, 0.0, 0.0, state)
        assert blocker(SLOW, here, OPEN, other) == found


@pytest.mark.parametrize(("nx", "ny"), [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_each_wall_is_kept_clear_of(nx: int, ny: int) -> None:
    here = State(0.0, 0.0, math.atan2(ny, nx), 0.3, 0.0)
    for away, found in ((-MM, "the wall"), (MM, "")):
        ends = [COMES + away if here else 9.0 for here in (nx > 0, nx < 0, ny > 0, ny < 0)]
        assert blocker(SLOW, here, Bounds(-ends[1], ends[0], -ends[3], ends[2])) == found


def test_one_side_of_a_line_is_kept() -> None:
    other = Neighbour("r2", 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    (line,) = knowing(other).lines(0.0, 0.0, 1.0)
    for away, found in ((-MM, "r2"), (MM, "")):
        assert blocker(SLOW, State(line.bound - COMES - away, 0.0, 0.0, 0.3, 0.0), OPEN, other) == found


def test_a_robot_that_is_faster_than_its_command_still_comes_far() -> None:
    here, command = State(0.0, 0.0, 0.0, 0.5, 0.0), Twist2(0.1, 0.0)
    comes = braking_path(here, command, SETTINGS.hold, BODY)[-1][0]
    for away, found in ((-MM, "the wall"), (MM, "")):
        assert blocker(command, here, Bounds(-9.0, comes + away, -9.0, 9.0)) == found


def test_braking_at_the_next_decision_must_be_possible_too() -> None:
    """A robot that turns along a wall comes nearer to it when it brakes in the turn than when it goes on."""
    here, command = State(0.0, 0.0, math.radians(-55.0), 0.5, -1.5), Twist2(0.5, -1.5)
    nearest = {held: max(x for x, _ in braking_path(here, command, held, BODY)) for held in (0.0, 0.05, SETTINGS.hold)}
    assert nearest[0.05] > max(nearest[0.0], nearest[SETTINGS.hold]) + MM
    for away, found in ((-MM, "the wall"), (MM, "")):
        assert blocker(command, here, Bounds(-9.0, nearest[0.05] + away, -9.0, 9.0)) == found


def test_what_braking_cannot_avoid_is_kept_and_never_deepened() -> None:
    here = State(0.0, 0.0, 0.0, 0.3, 0.0)
    across = Bounds(-9.0, 0.02, -9.0, 9.0)  # braking takes it 0.075 m further
    assert blocker(STILL, here, across) == ""
    assert blocker(Twist2(-0.3, 0.0), here, across) == ""
    assert blocker(Twist2(0.1, 0.0), here, across) == "the wall"
