"""Which lines a robot obeys: the newest snapshot's, and older ones' as far as the other can still come."""

from __future__ import annotations

import math

import pytest

from muro_zenoh.behaviours.interface import Neighbour, Snapshot
from muro_zenoh.safety.separation import Body, SeparationSettings
from muro_zenoh.safety.separation.knowledge import Knowledge
from muro_zenoh.safety.separation.path import stopping_distance

BODY = Body()
SETTINGS = SeparationSettings()
ON = ("tracking",) * 4
SILENT = "silent"


def bounds_after(theta: float, *, changed_at: float = 0.0, until: float = 0.0, leaves: float = 0.0) -> list[float]:
    """How far r0 at the origin may go, along x, on account of r1, which stands at 0.8 m with a heading. Both stood, so
    that each has half of the free 0.4 m; from ``changed_at`` on r0 drives, and gets six sevenths of what is free, and
    r1 drives with the speed ``leaves`` (it is seen where it was, as if it had gone there meanwhile)."""
    known = Knowledge("r0", BODY, {"r1": BODY}, SETTINGS)
    for k in range(round((until + 1.0) / 0.05) + 1):
        sent = -1.0 + 0.05 * k
        v = 0.5 if sent >= changed_at - 1e-9 else 0.0
        rows = (
            Neighbour("r0", 0.0, 0.0, 0.0, v, 0.0, 0.0),
            Neighbour("r1", 0.8, 0.0, theta, leaves if v else 0.0, 0.0, 0.0),
        )
        known.learn(sent, Snapshot(rows, sent, 1, 0.0))
    lines = known.lines(0.0, 0.0, 1.0)
    assert all((line.nx, line.ny) == pytest.approx((1.0, 0.0)) for line in lines)
    return [line.bound for line in lines]


NEWEST = 0.13 + (0.4 - 0.13) * 6.0 / 7.0
"""Braking from 0.5 m/s takes 0.13 m."""


def test_one_that_may_still_come_by_an_older_snapshot_keeps_its_half() -> None:
    assert min(bounds_after(math.pi)) == pytest.approx(0.2)


def test_one_that_cannot_turn_round_by_then_does_not_matter() -> None:
    assert min(bounds_after(0.0, leaves=0.5)) == pytest.approx(NEWEST)


def test_one_that_stands_and_faces_away_may_back_up() -> None:
    assert min(bounds_after(0.0)) == pytest.approx(0.2, abs=0.05)


def test_the_line_of_the_newest_snapshot_is_obeyed_as_it_is() -> None:
    assert bounds_after(0.0, changed_at=1e9) != []
    assert min(bounds_after(0.0, changed_at=1e9)) == pytest.approx(0.2)


@pytest.mark.parametrize(("until", "bound"), [(0.2, 0.2), (0.85, NEWEST)])
def test_an_older_line_matters_less_the_less_time_is_left_to_drive_by_it(until: float, bound: float) -> None:
    """The last of the first kind was sent at -0.05 s: it is too old at 0.45 s, and the dead-man acts 0.35 s later."""
    assert min(bounds_after(math.pi, until=until)) == pytest.approx(bound, abs=0.05)


def test_a_snapshot_that_was_overtaken_is_obeyed_but_shows_nothing() -> None:
    known = Knowledge("r0", BODY, {"r1": BODY}, SETTINGS)
    for k, x in ((0, 0.8), (2, 0.9), (1, 0.7)):
        rows = (Neighbour("r0", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), Neighbour("r1", x, 0.0, math.pi, 0.0, 0.0, 0.0))
        known.learn(0.1, Snapshot(rows, 0.05 * k, 1, 0.1 - 0.05 * k))
    # half of 0.5 m from the newest, of 0.4 m from the first; from the one that came last, what r1 can still reach
    bounds = [line.bound for line in known.lines(0.0, 0.0, 1.0)]
    assert len(bounds) == 3
    assert max(bounds) == pytest.approx(0.25)
    assert 0.15 <= min(bounds) < 0.24
    assert [near.x for near in known.near(0.1, 0.0, 0.0, 2.0)] == [0.9]


def test_a_lost_robot_may_have_gone_on_as_far_as_it_could_blind() -> None:
    known = Knowledge("r0", BODY, {"r1": BODY}, SETTINGS)
    me = Neighbour("r0", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    known.learn(0.0, Snapshot((me, Neighbour("r1", 1.0, 0.0, math.pi, 0.4, 0.0, 0.0)), 0.0, 1, 0.0))
    known.learn(0.3, Snapshot((me, Neighbour("r1", 1.0, 0.0, math.pi, 0.0, 0.0, 0.3, "stale")), 0.3, 1, 0.0))
    (obstacle,) = known.obstacles
    # 0.4 m/s for 0.35 s, then 0.4 -> 0.1 m/s at 1 m/s^2 and the lag: 0.14 + 0.075 + 0.01
    assert (obstacle.x, obstacle.dx) == pytest.approx((1.0, -0.225))
    assert obstacle.keep == pytest.approx(0.4)


def test_a_foreign_robot_is_as_large_as_the_largest() -> None:
    known = Knowledge("r0", BODY, {"r1": Body(radius=0.3)}, SETTINGS)
    rows = (Neighbour("r0", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), Neighbour("stranger", 1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    known.learn(0.0, Snapshot(rows, 0.0, 1, 0.0))
    (obstacle,) = known.obstacles
    assert (obstacle.name, obstacle.keep) == ("stranger", pytest.approx(0.177 + 0.3 + 0.046))


@pytest.mark.parametrize("back", [0.2, 0.4, 5.0])
def test_what_was_known_before_the_clock_was_set_back_is_forgotten(back: float) -> None:
    """Its times lie ahead of the clock: it would be fresh, and all that comes would be older than it."""
    known = Knowledge("r0", BODY, {"r1": BODY}, SETTINGS)

    def learn(now: float, sent: float, x: float) -> str:
        rows = (Neighbour("r0", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), Neighbour("r1", x, 0.0, math.pi, 0.0, 0.0, 0.0))
        return known.learn(now, Snapshot(rows, sent, 1, 0.0))

    assert [learn(0.05 * k, 0.05 * k, 3.0) for k in range(21)][-1] == ""
    assert learn(1.0 - back, 1.05, 0.8) == "it listens before it drives"
    assert [near.x for near in known.near(1.0 - back, 0.0, 0.0, 2.0)] == [0.8]
    assert min(line.bound for line in known.lines(0.0, 0.0, 1.0)) == pytest.approx(0.2)
    assert [learn(1.0 - back + 0.05 * k, 1.05 + 0.05 * k, 0.8) for k in range(1, 21)][-1] == ""


def test_an_age_below_zero_makes_no_line_forgotten() -> None:
    known = Knowledge("r0", BODY, {"r1": BODY}, SETTINGS)
    for k, age in enumerate((0.0, 0.0, -1e12)):
        rows = (Neighbour("r0", 0.0, 0.0, 0.0, 0.0, 0.0, age), Neighbour("r1", 0.8, 0.0, math.pi, 0.0, 0.0, age))
        known.learn(0.05 * k, Snapshot(rows, 0.05 * k, 1, 0.0))
    assert [received.sent for received in known._received] == pytest.approx([0.0, 0.05, 0.1])


# ---- a robot whose estimates do not reach the base station


def learned(*states: str) -> Knowledge:
    """What r0 knows of r1, which is seen at 0.8 m and comes nearer at 0.4 m/s while it is tracked, in these states in
    turn."""
    known = Knowledge("r0", BODY, {"r1": BODY}, SETTINGS)
    for k, state in enumerate(states):
        rows = (
            Neighbour("r0", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            Neighbour("r1", 0.8, 0.0, math.pi, 0.4 if state == "tracking" else 0.0, 0.0, 0.0, state),
        )
        known.learn(0.05 * k, Snapshot(rows, 0.05 * k, 1, 0.0))
    return known


def test_a_silent_robot_obeys_the_lines_and_so_do_the_others() -> None:
    before, since = ([line.bound for line in learned(*states).lines(0.0, 0.0, 1.0)] for states in (ON, (*ON, SILENT)))
    assert min(since) == min(before), "it may come as it could before, until it hears so"
    assert len(since) == len(before) + 1
    assert learned(*ON, "lost").lines(0.0, 0.0, 1.0) == []


def test_a_stale_robot_obeys_the_lines_of_before_while_it_stops() -> None:
    before, since = ([line.bound for line in learned(*states).lines(0.0, 0.0, 1.0)] for states in (ON, (*ON, "stale")))
    assert since == before, "none of the newest snapshot: there it keeps nothing any more"


@pytest.mark.parametrize(("omega", "aside"), [(0.0, 0.0), (1.5, 0.09), (-1.5, 0.09)])
def test_a_robot_that_was_turning_may_be_found_beside_its_heading(omega: float, aside: float) -> None:
    known = Knowledge("r0", BODY, {"r1": BODY}, SETTINGS)
    me = Neighbour("r0", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    known.learn(0.0, Snapshot((me, Neighbour("r1", 1.0, 0.0, math.pi, 0.4, omega, 0.0)), 0.0, 1, 0.0))
    known.learn(0.3, Snapshot((me, Neighbour("r1", 1.0, 0.0, math.pi, 0.0, 0.0, 0.3, "stale")), 0.3, 1, 0.0))
    (obstacle,) = known.obstacles
    straight = 2.0 * BODY.radius + SETTINGS.margin
    assert obstacle.keep - straight >= aside
    assert (obstacle.keep == straight) is (omega == 0.0)


def test_a_silent_robot_is_an_obstacle_as_far_as_it_may_have_driven_since() -> None:
    assert learned(*ON).obstacles == ()
    (obstacle,) = learned(*ON, SILENT).obstacles
    assert (obstacle.name, obstacle.x) == ("r1", 0.8)
    assert obstacle.keep == 2.0 * BODY.radius + SETTINGS.margin
    assert obstacle.dx == pytest.approx(-(0.4 * SETTINGS.hold + stopping_distance(0.4, BODY)))


def test_a_silent_robot_does_not_drive() -> None:
    known = Knowledge("r0", BODY, {"r1": BODY}, SETTINGS)
    row = Neighbour("r0", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, SILENT)
    assert known.learn(0.0, Snapshot((row,), 0.0, 1, 0.0)) == "the base station does not hear from it"


# ---- what is kept, and looked at


@pytest.mark.parametrize("age", [math.nan, math.inf])
def test_a_snapshot_whose_age_nobody_knows_is_not_kept(age: float) -> None:
    known = Knowledge("r0", BODY, {"r1": BODY}, SETTINGS)
    row = Neighbour("r0", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert known.learn(0.0, Snapshot((row,), 0.0, 1, age)) == "no fresh positions"
    assert not known._received


@pytest.mark.parametrize(("age", "counts"), [(0.0, 0.0), (0.2, 0.2), (0.9, 0.25)])
def test_snapshots_are_kept_for_longer_when_the_newest_shows_what_was_earlier(age: float, counts: float) -> None:
    known = Knowledge("r0", BODY, {"r1": BODY}, SETTINGS)
    for k in range(61):
        rows = (Neighbour("r0", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), Neighbour("r1", 0.8, 0.0, 0.0, 0.0, 0.0, age))
        known.learn(0.05 * k, Snapshot(rows, 0.05 * k, 1, 0.0))
    kept = 3.0 - known._received[0].sent
    assert kept == pytest.approx(SETTINGS.snapshot_limit + SETTINGS.hold + counts, abs=0.051)
    assert kept <= SETTINGS.snapshot_limit + SETTINGS.hold + counts + 1e-9


@pytest.mark.parametrize("mine", [0.0, 0.3])
@pytest.mark.parametrize("theirs", [-0.4, 0.0, 0.5])
@pytest.mark.parametrize("away", [0.6, 1.0, 1.6, 2.4])
def test_no_line_within_reach_is_left_out(away: float, mine: float, theirs: float) -> None:
    known = Knowledge("r0", BODY, {"r1": BODY}, SETTINGS)
    rows = (
        Neighbour("r0", 0.0, 0.0, 0.0, mine, 0.0, 0.0),
        Neighbour("r1", away, 0.0, math.pi, theirs, 0.0, 0.0),
    )
    known.learn(0.0, Snapshot(rows, 0.0, 1, 0.0))
    (line,) = known.lines(0.0, 0.0, 99.0)
    assert known.lines(0.0, 0.0, line.bound + 1e-3) == [line]
    assert known.lines(0.0, 0.0, line.bound - 1e-3) == []


def test_neighbours_are_moved_on_from_when_they_were_seen() -> None:
    known = Knowledge("r0", BODY, {"r1": BODY}, SETTINGS)
    rows = (
        Neighbour("r0", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        Neighbour("r1", 1.0, 0.0, math.pi, 0.4, 0.0, 0.1),
    )
    known.learn(0.05, Snapshot(rows, 0.0, 1, 0.05))
    (near,) = known.near(0.15, 0.0, 0.0, 2.0)
    assert near[:4] == pytest.approx((1.0 - 0.4 * 0.25, 0.0, -0.4, 0.0), abs=1e-9)
    assert known.near(0.15, 0.0, 0.0, 0.91) == [near]
    assert known.near(0.15, 0.0, 0.0, 0.89) == []


def test_another_base_stations_snapshot_of_the_same_stamp_is_another_one() -> None:
    known = Knowledge("r0", BODY, {"r1": BODY}, SETTINGS)
    for k, epoch in enumerate((1, 1, 2)):
        rows = (Neighbour("r0", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), Neighbour("r1", 1.0 + k, 0.0, 0.0, 0.0, 0.0, 0.0))
        known.learn(0.05 * k, Snapshot(rows, 7.0, epoch, 0.0))
    assert [received.epoch for received in known._received] == [1, 2]
    assert known.near(0.1, 0.0, 0.0, 9.0)[0].x == pytest.approx(3.0)


def test_a_robot_that_only_the_base_station_before_has_seen_is_still_there() -> None:
    known = Knowledge("r0", BODY, {"r1": BODY, "r2": BODY}, SETTINGS)
    me, other, third = (Neighbour(f"r{k}", 0.8 * k, 0.0, 0.0, 0.4 * k, 0.0, 0.0) for k in range(3))

    def learn(sent: float, epoch: int, *rows: Neighbour) -> list[tuple[str, float]]:
        known.learn(sent, Snapshot(rows, sent, epoch, 0.0))
        return [(obstacle.name, obstacle.x) for obstacle in known.obstacles]

    assert learn(0.0, 1, me, other, third) == []
    assert learn(0.5, 2) == [("r1", 0.8), ("r2", 1.6)]
    assert known.obstacles[0].dx == pytest.approx(0.4 * SETTINGS.hold + stopping_distance(0.4, BODY)), "it drove"
    assert learn(1.0, 2, me, third) == [("r1", 0.8)]
    assert [near.name for near in known.near(1.0, 0.0, 0.0, 9.0)] == ["r1", "r2"]
    assert learn(1.5, 3, me) == [("r1", 0.8), ("r2", 1.6)]
    assert learn(2.0, 3, me, other, third) == []
    assert learn(2.5, 3, me, third) == [], "an operator has cleared it"
