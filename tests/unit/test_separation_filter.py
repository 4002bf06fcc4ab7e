"""The separation filter: what passes, what does not, and what cannot be used."""

from __future__ import annotations

import math

import pytest

from muro_zenoh.behaviours.interface import Neighbour, Snapshot
from muro_zenoh.geometry import STILL, Bounds, State, Twist2
from muro_zenoh.safety.separation import Body, Separation, SeparationSettings
from muro_zenoh.walls import Wall

ARENA = Bounds(-2.1, 2.1, -1.5, 1.5)
BODY = Body()
FLEET = {"r1": BODY, "r2": BODY}
AHEAD = Twist2(0.3, 0.1)


def seen(*robots: Neighbour, stamp: float = 0.0) -> Snapshot:
    return Snapshot(robots, stamp, 1, 0.0)


def row(name: str, x: float, y: float, theta: float = 0.0, v: float = 0.0, state: str = "tracking") -> Neighbour:
    return Neighbour(name, x, y, theta, v, 0.0, 0.0, state)


def separation(*robots: Neighbour) -> Separation:
    """The filter of r1, which has stood and listened for a second."""
    made = Separation("r1", BODY, FLEET, ARENA, SeparationSettings())
    for k in range(-20, 0):
        now = 0.05 * k
        made.step(now, State(0.0, 0.0, 0.0, 0.0, 0.0), STILL, Snapshot(robots or (row("r1", 0.0, 0.0),), now, 1, 0.0))
    return made


def test_a_robot_alone_drives_as_it_wants() -> None:
    step = separation().step(0.0, State(0.0, 0.0, 0.0, 0.3, 0.0), AHEAD, seen(row("r1", 0.0, 0.0, v=0.3)))
    assert step == (AHEAD, "")


def test_it_does_not_drive_into_another() -> None:
    step = separation(row("r1", 0.0, 0.0), row("r2", 0.5, 0.0)).step(
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


def test_it_listens_before_it_drives() -> None:
    made = Separation("r1", BODY, FLEET, ARENA, SeparationSettings())
    at = State(0.0, 0.0, 0.0, 0.0, 0.0)
    reasons = [
        made.step(0.05 * k, at, AHEAD, Snapshot((row("r1", 0.0, 0.0),), 0.05 * k, 1, 0.0)).reason for k in range(30)
    ]
    assert reasons[:17] == ["brakes: it listens before it drives"] * 17
    assert reasons[17:] == [""] * 13


def test_it_listens_again_after_a_gap() -> None:
    made = separation()
    at = State(0.0, 0.0, 0.0, 0.0, 0.0)
    assert made.step(0.0, at, AHEAD, Snapshot((row("r1", 0.0, 0.0),), 0.0, 1, 0.0)).reason == ""
    assert made.step(0.35, at, AHEAD, Snapshot((row("r1", 0.0, 0.0),), 0.35, 1, 0.0)).reason.startswith("brakes")


@pytest.mark.parametrize("state", ["silent", "disagrees", "stale", "lost"])
def test_a_robot_that_the_cameras_do_not_see_where_it_believes_to_be_brakes(state: str) -> None:
    step = separation().step(0.0, State(0.0, 0.0, 0.0, 0.3, 0.0), AHEAD, seen(row("r1", 0.0, 0.0, state=state)))
    assert step.twist == STILL


def test_a_robot_that_is_not_in_the_snapshot_brakes() -> None:
    assert separation().step(0.0, State(0.0, 0.0, 0.0, 0.3, 0.0), AHEAD, seen(row("r2", 1.0, 0.0))).twist == STILL


def test_an_old_snapshot_is_none() -> None:
    old = Snapshot((row("r1", 0.0, 0.0),), -0.05, 1, 0.51)
    assert separation().step(0.46, State(0.0, 0.0, 0.0, 0.3, 0.0), AHEAD, old).reason == "brakes: no fresh positions"


def test_a_slow_robot_that_is_free_does_not_lose_patience() -> None:
    made = separation()
    slow = Twist2(0.01, 0.0)
    for k in range(200):
        now, x = 0.05 * k, 0.0005 * k
        at = State(x, 0.0, 0.0, 0.01, 0.0)
        assert made.step(now, at, slow, Snapshot((row("r1", x, 0.0, v=0.01),), now, 1, 0.0)) == (slow, "")


def test_a_parked_robot_makes_room_for_one_that_waits_and_no_other() -> None:
    for omega, reason in ((0.4, "makes room for r2"), (0.0, "")):
        other = row("r2", 0.5, 0.0, math.pi)._replace(omega=omega)
        made = separation(row("r1", 0.0, 0.0), other)
        at = State(0.0, 0.0, 0.0, 0.0, 0.0)
        step = made.step(0.0, at, STILL, seen(row("r1", 0.0, 0.0), other), (0.0, 0.0))
        assert step.reason == reason
        assert (step.twist != STILL) == bool(reason)


DOOR = (Wall(0.0, 0.4, 0.0, 1.5), Wall(0.0, -1.5, 0.0, -0.4))


@pytest.mark.parametrize(("x", "to", "makes_room"), [(0.45, 0.40, True), (0.45, 0.1, False), (1.45, 1.40, False)])
def test_who_is_kept_just_off_its_place_in_a_doorway_makes_room(x: float, to: float, makes_room: bool) -> None:
    """It would wait there for ever for the other one, which waits for it. One that is still on its way drives on, and
    elsewhere others get past."""
    made = Separation("r1", BODY, FLEET, ARENA, SeparationSettings(), DOOR)
    at, waits = State(x, 0.09, math.pi, 0.0, 0.0), row("r2", x - 0.25, 0.43, -1.0)._replace(omega=0.4)
    reasons = []
    for k in range(40):
        snapshot = Snapshot((row("r1", at.x, at.y, at.theta), waits), 0.05 * k, 1, 0.0)
        reasons.append(made.step(0.05 * k, at, Twist2(0.05, -0.2), snapshot, (to, 0.12)).reason)
    assert ("makes room for r2" in reasons) is makes_room
    assert reasons[-1] != "", "it is kept from its place"


def test_who_waits_long_at_a_doorway_does_not_stand_there() -> None:
    """It backs off, although it has room enough where it is: who comes out may have not."""
    made = Separation("r1", BODY, FLEET, ARENA, SeparationSettings(), DOOR)
    at, inside = State(-0.55, -0.55, 0.25 * math.pi, 0.0, 0.0), row("r2", 0.2, 0.0, math.pi, 0.1)
    waits = []
    for k in range(90):
        snapshot = Snapshot((row("r1", at.x, at.y, at.theta), inside), 0.05 * k, 1, 0.0)
        waits.append(made.step(0.05 * k, at, Twist2(0.1, 0.3), snapshot, (1.0, 0.0)).twist.v < 0.02)
    assert all(waits[18:75])
    assert not any(waits[80:])


def test_who_backs_off_from_a_doorway_turns_back_while_it_is_its_turn() -> None:
    """It looks away from the doorway: it drives to back off, and turns on the spot to go through."""
    made = Separation("r1", BODY, FLEET, ARENA, SeparationSettings(), DOOR)
    at, gone = State(-0.55, -0.55, -0.75 * math.pi, 0.0, 0.0), row("r2", 1.5, 1.0)
    inside = row("r2", 0.2, 0.0, math.pi, 0.1)
    drives = []
    for k in range(110):
        other = gone if 90 <= k < 95 else inside
        snapshot = Snapshot((row("r1", at.x, at.y, at.theta), other), 0.05 * k, 1, 0.0)
        drives.append(made.step(0.05 * k, at, Twist2(0.1, 0.3), snapshot, (1.0, 0.0)).twist.v > 0.02)
    assert not any(drives[22:75])
    assert all(drives[80:90])
    assert not any(drives[90:95])
    assert all(drives[96:])


def test_who_has_come_through_a_doorway_does_not_go_on_backing_off() -> None:
    made = Separation("r1", BODY, FLEET, ARENA, SeparationSettings(), DOOR)
    wish, inside, gone = Twist2(0.1, 0.0), row("r2", 0.2, 0.0, math.pi, 0.1), row("r2", -1.5, 1.0)
    log = []
    for k in range(120):
        x, other = (-0.55, inside) if k < 90 else (0.6, gone)
        snapshot = Snapshot((row("r1", x, 0.0), other), 0.05 * k, 1, 0.0)
        log.append(made.step(0.05 * k, State(x, 0.0, 0.0, 0.0, 0.0), wish, snapshot, (1.5, 0.0)))
    assert log[89] != (wish, ""), "it backs off"
    assert log[-1].twist == pytest.approx(wish, abs=0.01), "it would do so for another half a second"


def test_who_is_shut_in_elsewhere_stays_where_it_has_most_room() -> None:
    """Round it there is less."""
    around = {"r2": (0.5, 0.0), "r3": (-0.5, 0.0), "r4": (0.0, 0.5), "r5": (0.0, -0.5)}
    made = Separation("r1", BODY, dict.fromkeys(("r1", *around), BODY), ARENA, SeparationSettings())
    at = State(0.0, 0.0, 0.25 * math.pi, 0.0, 0.0)
    for k in range(200):
        others = (row(name, x, y) for name, (x, y) in around.items())
        snapshot = Snapshot((row("r1", at.x, at.y, at.theta), *others), 0.05 * k, 1, 0.0)
        drives = made.step(0.05 * k, at, Twist2(0.1, 0.3), snapshot, (1.5, 0.0)).twist.v > 0.02
        assert not drives or k < 40, "it tries to get on at first"


@pytest.mark.parametrize("x", [-1.5, 1.5])
def test_the_robots_on_each_side_of_a_doorway_count(x: float) -> None:
    """Two have waited equally long; it goes when the third is on its own side."""
    made = Separation("r1", BODY, {**FLEET, "r3": BODY}, ARENA, SeparationSettings(), DOOR)
    at, other = State(-0.7, 0.0, 0.0, 0.0, 0.0), row("r2", 0.7, 0.0, math.pi)._replace(omega=0.4)
    goes = []
    for k in range(80):
        snapshot = Snapshot((row("r1", at.x, at.y), other, row("r3", x, -1.2)._replace(omega=0.4)), 0.05 * k, 1, 0.0)
        goes.append(made.step(0.05 * k, at, Twist2(0.1, 0.0), snapshot, (1.5, 0.0)).twist.v > 0.05)
    assert all(goes[40:70]) is (x < 0.0)
    assert any(goes[40:70]) is (x < 0.0)


def test_who_only_turns_in_a_doorway_does_not_get_on() -> None:
    """It is its turn, and another one is parked in its way. Now and then it may turn as it wants; else the filter turns
    it back. After a while it backs off all the same."""
    made = Separation("r1", BODY, FLEET, ARENA, SeparationSettings(), DOOR)
    at, parked = State(0.22, 0.02, math.pi, 0.0, 0.0), row("r2", -0.25, 0.0)
    passed = []
    for k in range(140):
        snapshot = Snapshot((row("r1", at.x, at.y, at.theta), parked), 0.05 * k, 1, 0.0)
        wish = Twist2(0.4, 0.0) if k % 10 else Twist2(0.0, 0.5)
        given = made.step(0.05 * k, at, wish, snapshot, (-1.28, 0.0)).twist
        if not k % 10:
            passed.append(given == wish)
    assert all(passed[2:6])
    assert not all(passed[6:])


@pytest.mark.parametrize("wish", [Twist2(0.03, 0.0), Twist2(0.0, -0.3)])
def test_who_is_alone_at_a_doorway_does_as_it_wants_however_slowly(wish: Twist2) -> None:
    made = Separation("r1", BODY, FLEET, ARENA, SeparationSettings(), DOOR)
    for k in range(240):
        at = State(-0.6 + 0.05 * k * wish.v, 0.0, 0.0, *wish)
        step = made.step(0.05 * k, at, wish, Snapshot((row("r1", at.x, at.y),), 0.05 * k, 1, 0.0), (1.5, 0.0))
        assert step == (wish, "") or k < 18
