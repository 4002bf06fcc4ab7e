"""What keeps a robot from driving: the stop latch, the gate, calibration and limits."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from muro_zenoh.geometry import STILL, Twist2
from muro_zenoh.safety.gate import reasons_to_hold
from muro_zenoh.safety.limits import calibrate_and_limit
from muro_zenoh.safety.stop import MAX_REVISION_GAP, StopLatch

# ---- the stop latch


def receive(latch: StopLatch, revision: int, *names: str, all_robots: bool = False) -> StopLatch:
    return latch.receive("r1", all_robots=all_robots, names=names, revision=revision)


FREE = receive(StopLatch(), 5)
"""A robot that received revision 5, which stops no robot."""

orders = st.lists(
    st.tuples(st.integers(0, 6), st.booleans(), st.lists(st.sampled_from(["r1", "r2", "ghost"]), max_size=2)),
    max_size=12,
)


def test_without_any_order_the_robot_must_not_drive() -> None:
    latch = StopLatch()
    assert not latch.may_drive
    assert latch.reason == "no stop state received yet: waiting for the base station"


@pytest.mark.parametrize("revision", [1, 5])
def test_the_first_state_received_frees_the_robot_at_any_revision(revision: int) -> None:
    latch = receive(StopLatch(), revision)
    assert latch.may_drive
    assert latch.reason == ""
    assert latch.revision == revision


def test_an_order_of_revision_0_that_stops_others_frees_no_robot() -> None:
    # `muro stop r2` with no base station: r1, which joins later, must not take it for the lab's state.
    latch = receive(StopLatch(), 0, "r2")
    assert not latch.may_drive
    assert not latch.received
    assert receive(FREE, 0, "r2").may_drive


def test_a_first_state_that_stops_is_latched() -> None:
    latch = receive(StopLatch(), 0, all_robots=True)
    assert not latch.may_drive
    assert latch.reason == "stopped by order (all robots)"


@pytest.mark.parametrize("revision", [0, 4, 5, 6])
def test_a_stop_is_accepted_at_any_revision(revision: int) -> None:
    latch = receive(FREE, revision, all_robots=True)
    assert latch.stopped
    assert latch.revision == max(5, revision)


@pytest.mark.parametrize("revision", [0, 4, 5])
def test_a_stop_wins_ties_and_against_older_states(revision: int) -> None:
    stopped = receive(FREE, 5, all_robots=True)
    assert receive(stopped, revision) == stopped


def test_a_newer_state_lifts_a_stop() -> None:
    latch = receive(receive(FREE, 5, all_robots=True), 6)
    assert latch.may_drive
    assert not latch.all_robots
    assert latch.revision == 6


def test_a_stop_by_name_stops_only_that_robot() -> None:
    assert receive(FREE, 6, "r1").reason == "stopped by order"
    assert receive(FREE, 6, "r2", "ghost").may_drive


def test_a_stop_of_others_lifts_nothing_unless_it_is_newer() -> None:
    stopped = receive(FREE, 5, "r1")
    assert receive(stopped, 5, "r2").stopped
    assert receive(stopped, 6, "r2").may_drive


def test_a_stop_by_name_does_not_reduce_a_stop_of_all() -> None:
    latch = receive(receive(FREE, 6, all_robots=True), 6, "r1")
    assert latch.all_robots


@pytest.mark.parametrize("absurd", [2**53 + 1, 2**64 - 1])
def test_an_absurd_revision_stops_but_lifts_nothing_and_is_not_remembered(absurd: int) -> None:
    assert receive(FREE, absurd) == FREE
    assert receive(receive(FREE, 6, "r1"), absurd).stopped
    stopped = receive(FREE, absurd, all_robots=True)
    assert stopped.stopped
    assert receive(stopped, 6).may_drive  # the base station can lift it


def test_an_absurd_revision_is_no_stop_state() -> None:
    assert not receive(StopLatch(), 2**53 + 1).received
    assert receive(StopLatch(), 2**53).revision == 2**53


@pytest.mark.parametrize("poison", [5 + MAX_REVISION_GAP, 5 + MAX_REVISION_GAP + 1, 2**40, 2**53 - 1, 2**53])
def test_a_revision_that_is_far_ahead_does_not_outlast_the_next_true_order(poison: int) -> None:
    # Whoever said it: the base station has counted to 5 and goes on from there.
    poisoned = receive(FREE, poison, all_robots=True)
    assert poisoned.stopped
    assert receive(poisoned, 5).stopped  # the state that is repeated lifts nothing
    assert receive(poisoned, 6).may_drive
    assert receive(receive(poisoned, 5, "r1"), 6).may_drive


def test_an_order_that_is_a_little_behind_stays_older() -> None:
    stopped = receive(FREE, 5 + MAX_REVISION_GAP - 1, all_robots=True)
    assert receive(stopped, 5).stopped


def test_an_operator_who_knows_no_revision_makes_nobody_forget_his() -> None:
    assert receive(FREE, 0, "r2") == FREE
    assert receive(FREE, 0, "r1").revision == FREE.revision


def test_a_newer_order_by_name_replaces_an_order_to_all() -> None:
    # `muro stop`, then `muro resume r2`: reported as a stop of all robots, the base station would adopt it as such.
    latch = receive(receive(FREE, 6, all_robots=True), 7, "r1", "r3")
    assert latch.reason == "stopped by order"
    assert not latch.all_robots


@given(orders)
def test_the_revision_never_falls_and_a_stop_is_always_obeyed(said: list[tuple[int, bool, list[str]]]) -> None:
    latch = StopLatch()
    for revision, all_robots, names in said:
        before = latch
        latch = latch.receive("r1", all_robots=all_robots, names=names, revision=revision)
        assert latch.revision == max(before.revision, revision)
        assert latch.received == (before.received or revision > 0 or all_robots or "r1" in names)
        if all_robots or "r1" in names:
            assert not latch.may_drive
        elif before.stopped and revision <= before.revision:
            assert latch == before


@given(orders)
def test_repetition_changes_nothing(said: list[tuple[int, bool, list[str]]]) -> None:
    latch = StopLatch()
    for revision, all_robots, names in said:
        latch = latch.receive("r1", all_robots=all_robots, names=names, revision=revision)
        assert latch.receive("r1", all_robots=all_robots, names=names, revision=revision) == latch


@pytest.mark.parametrize(("behind", "newer"), [(0, False), (1, False), (2**20 - 1, False), (2**20, True)])
@pytest.mark.parametrize("all_robots", [True, False])
def test_an_order_a_million_behind_begins_another_count_and_lifts_nothing(
    behind: int, newer: bool, all_robots: bool
) -> None:
    # A base station that has lost its file counts from 1 and does not know this stop.
    stopped = receive(StopLatch(), 2**20 + 9, "r1", all_robots=all_robots)
    after = receive(stopped, 2**20 + 9 - behind)
    assert (after.stopped, after.all_robots) == (True, all_robots)
    assert after.revision == (9 if newer else 2**20 + 9)
    assert receive(after, 10).may_drive == newer  # its next order, once it has taken over the stop


def test_an_order_a_million_behind_replaces_the_count_of_a_robot_that_drives() -> None:
    free = receive(StopLatch(), 2**20 + 9)
    assert receive(free, 9) == StopLatch(True, False, False, 9)
    assert receive(receive(free, 9), 10, "r1").stopped


@pytest.mark.parametrize(("ahead", "lifts"), [(0, False), (1, True), (2**20 - 1, True), (2**20, False)])
def test_an_order_a_million_ahead_is_not_of_this_count(ahead: int, lifts: bool) -> None:
    stopped = receive(FREE, 6, "r1")
    after = receive(stopped, 6 + ahead)
    assert (after.may_drive, after.revision) == (lifts, 6 + ahead if lifts else 6)


def test_at_its_first_order_a_robot_has_no_count_to_compare_with() -> None:
    assert receive(StopLatch(), 2**30).revision == 2**30
    assert receive(receive(StopLatch(), 0, "r2"), 1).may_drive


# ---- the gate


def stand(
    latch: StopLatch = FREE,
    fix_age: float = 0.1,
    twist_age: float = 0.1,
    hold: str = "",
    pause: float = 0.0,
    snapshot_age: float = 0.0,
) -> tuple[str, ...]:
    return reasons_to_hold(
        latch=latch,
        pause=pause,
        fix_age=fix_age,
        fix_limit=0.4,
        snapshot_age=snapshot_age,
        snapshot_limit=0.5,
        twist_age=twist_age,
        twist_limit=0.25,
        hold=hold,
    )


def test_a_fresh_robot_may_drive() -> None:
    assert stand() == ()
    assert stand(fix_age=0.4, twist_age=0.25) == ()  # the limits themselves are fresh


@pytest.mark.parametrize(
    ("fix_age", "reason"),
    [
        (math.inf, "no pose yet: waiting for a camera to see this robot"),
        (0.5, "no pose for 0.5 s"),
        (math.nan, "no pose for nan s"),
    ],
)
def test_a_stale_pose_stops_the_robot(fix_age: float, reason: str) -> None:
    assert stand(fix_age=fix_age) == (reason,)


@pytest.mark.parametrize(
    ("age", "reason"),
    [
        (math.inf, "no positions of all robots yet: waiting for the base station"),
        (0.51, "no positions of all robots for 0.5 s"),
        (math.nan, "no positions of all robots for nan s"),
    ],
)
def test_a_robot_that_does_not_know_where_the_others_are_stands_still(age: float, reason: str) -> None:
    assert stand(snapshot_age=age) == (reason,)
    assert stand(snapshot_age=0.5) == ()


def test_after_a_pause_a_robot_stands_still_until_it_knows_the_stop_state() -> None:
    assert stand(pause=0.7) == ("no stop state since a pause of 0.7 s: waiting for the base station",)
    stopped = receive(FREE, 6, "r1")
    assert stand(stopped, pause=0.7) == (stopped.reason,)


@pytest.mark.parametrize("twist_age", [0.26, math.inf, math.nan])
def test_a_behaviour_that_times_out_stops_the_robot(twist_age: float) -> None:
    assert stand(twist_age=twist_age) == ("no command from the behaviour",)


def test_a_behaviour_that_holds_has_not_timed_out() -> None:
    assert stand(twist_age=9.0, hold="no circle received yet") == ("no circle received yet",)


def test_reasons_are_ordered_by_importance() -> None:
    stopped = receive(FREE, 6, all_robots=True)
    assert stand(stopped, 2.0, 9.0) == (
        "stopped by order (all robots)",
        "no pose for 2.0 s",
        "no command from the behaviour",
    )


@given(
    st.sampled_from([StopLatch(), FREE, receive(FREE, 6, "r1")]),
    st.floats(),
    st.floats(),
    st.sampled_from(["", "the behaviour is hold"]),
)
def test_driving_requires_all_conditions(latch: StopLatch, fix_age: float, twist_age: float, hold: str) -> None:
    may = stand(latch, fix_age, twist_age, hold) == ()
    assert may == (latch.may_drive and fix_age <= 0.4 and twist_age <= 0.25 and not hold)


# ---- calibration and limits


def command(v: float, omega: float, cal_v: float = 1.0, cal_omega: float = 1.0) -> Twist2:
    return calibrate_and_limit(Twist2(v, omega), cal_v=cal_v, cal_omega=cal_omega, v_max=0.5, omega_max=1.5)


def test_calibration_is_applied_once_before_the_limits() -> None:
    assert command(0.2, 1.0, cal_v=1.25, cal_omega=0.8) == Twist2(0.25, 0.8)
    assert command(0.45, 1.4, cal_v=1.25, cal_omega=1.25) == Twist2(0.5, 1.5)


@pytest.mark.parametrize(("v", "omega"), list(itertools.product((-9.0, 9.0), repeat=2)))
def test_both_speeds_saturate_on_both_sides(v: float, omega: float) -> None:
    assert command(v, omega) == Twist2(math.copysign(0.5, v), math.copysign(1.5, omega))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_twist_that_is_not_finite_gives_zero(bad: float) -> None:
    assert command(bad, 1.0) == STILL
    assert command(0.2, bad) == STILL
    assert command(0.2, 1.0, cal_v=bad) == STILL
    assert command(0.2, 1.0, cal_omega=bad) == STILL


def test_a_product_that_overflows_gives_zero() -> None:
    assert command(1e308, 0.0, cal_v=1e10) == STILL


@given(st.floats(), st.floats(), st.floats(), st.floats())
def test_no_command_exceeds_the_limits(v: float, omega: float, cal_v: float, cal_omega: float) -> None:
    out = command(v, omega, cal_v, cal_omega)
    assert abs(out.v) <= 0.5
    assert abs(out.omega) <= 1.5
