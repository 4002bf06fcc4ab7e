"""Each promise has a record that keeps it and one that breaks it, and says how often it was evaluated."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import msgspec
import numpy as np
import pytest

from muro_zenoh.checking.contacts import ContactClass, contacts
from muro_zenoh.checking.coverage import Activity
from muro_zenoh.checking.judgement import Breach
from muro_zenoh.checking.operator import Ordered
from muro_zenoh.checking.promises import PROMISES, IncompleteRecord, judge
from muro_zenoh.checking.record import PERIOD, Incident, Record
from muro_zenoh.checking.trace import HealthReport, ProcessEnd
from muro_zenoh.config.order import OrderRow
from muro_zenoh.config.wall import WallRow
from tests.support.records import aged, driving, fault, still


def breaches(record: Record, promise: str) -> tuple[Breach, ...]:
    return judge(record)[promise].breaches


def with_effect(record: Record, kind: str, start: float, end: float, robot: str = "r2", **numbers: Any) -> Record:
    """The record with what a fault did to a robot."""
    made = fault(kind, robot, start, end - start, **numbers)
    effect = Incident(made, start, end, {robot: Activity.DRIVING})
    return dataclasses.replace(record, effects=(*record.effects, effect))


def moved_by_hand(record: Record, start: float, end: float, speed: float) -> Record:
    """The record with r2 moved along x besides what its wheels do [m/s]."""
    record = dataclasses.replace(record, pose=record.pose.copy())
    held = (record.time > start) & (record.time <= end)
    record.pose[:, 1, 0] += np.cumsum(np.where(held, speed * PERIOD, 0.0))
    return record


def test_a_fleet_that_stands_breaks_nothing() -> None:
    judged = judge(still())
    assert all(not judgement.breaches for judgement in judged.values())
    assert {name for name, judgement in judged.items() if not judgement.evaluated} == {
        "driven into",
        "named",
        "braking",
        "stop",
    }


def test_every_promise_is_judged() -> None:
    assert set(judge(still())) == {promise.name for promise in PROMISES}
    # What no trial of a check evaluates is an error of the check, except where a fault or an order is needed.
    always = {promise.name for promise in PROMISES if promise.always}
    assert always <= {name for name, judgement in judge(driving(still(), 0, 1.0, 2.0)).items() if judgement.evaluated}


class TestWhatCannotBeJudged:
    def test_a_trace_that_begins_late(self) -> None:
        whole = still()
        late = {f.name: getattr(whole, f.name) for f in dataclasses.fields(whole)}
        late = {k: v[50:] if isinstance(v, np.ndarray) else v for k, v in late.items()}
        with pytest.raises(IncompleteRecord, match=r"first sample at 1\.00 s.*watched too late"):
            judge(Record(**late))

    def test_a_trace_with_a_gap(self) -> None:
        whole = still()
        with_gap = whole.time + np.where(whole.time > 5.0, 0.1, 0.0)
        with pytest.raises(IncompleteRecord, match=r"gap of 0\.120 s"):
            judge(dataclasses.replace(whole, time=with_gap))

    def test_a_trace_that_ends_early_and_says_that_it_is_whole(self) -> None:
        whole = still()
        short = {f.name: getattr(whole, f.name) for f in dataclasses.fields(whole)}
        short = {k: v[:-50] if isinstance(v, np.ndarray) else v for k, v in short.items()}
        with pytest.raises(IncompleteRecord, match="last sample at 9"):
            judge(Record(**short))
        assert judge(Record(**{**short, "finished": False}))["finished"].breaches


class TestNoContact:
    """Two robots, 1 m apart, touch when one has driven 0.646 m: at 0.2 m/s after 3.23 s."""

    def test_two_that_touch(self) -> None:
        (breach,) = breaches(driving(still(), 0, 1.0, 5.0), "no contact")
        assert breach.robots == ("r1", "r2")
        assert breach.time == pytest.approx(1.0 + 3.23, abs=0.05)
        assert str(breach) == "r1 touches r2 at 4.2 s"

    def test_two_that_nearly_touch(self) -> None:
        assert not breaches(driving(still(), 0, 1.0, 4.2), "no contact")

    def test_two_contacts_of_the_same_pair(self) -> None:
        twice = driving(driving(driving(still(), 0, 1.0, 4.5), 0, 4.5, 5.5, v=-0.2), 0, 5.5, 7.0)
        assert len(breaches(twice, "no contact")) == 2

    def test_a_carried_robot_is_not_ours(self) -> None:
        carried = with_effect(driving(still(), 0, 1.0, 5.0), "carry", 3.0, 3.5, x=0.1)
        assert not breaches(carried, "no contact")

    def test_a_robot_that_was_carried_is_ours_again_after_two_seconds(self) -> None:
        long_ago = with_effect(driving(still(), 0, 4.0, 9.0), "carry", 1.0, 1.5, x=0.1)
        assert breaches(long_ago, "no contact")

    def test_a_robot_put_down_on_another_is_ours_when_it_was_clear_of_it(self) -> None:
        record = with_effect(still(), "carry", 1.0, 1.5, x=0.1)
        record.pose[record.time > 1.5, 1, 0] = record.pose[0, 0, 0] + 0.3
        assert [contact.kind for contact in contacts(record)] == [ContactClass.DISTURBED]
        record.pose[(record.time > 5.0) & (record.time <= 6.0), 1, 0] += 0.2
        assert [contact.kind for contact in contacts(record)] == [ContactClass.DISTURBED, ContactClass.OURS]

    @pytest.mark.parametrize("kind", ["crash", "freeze", "partition", "halt"])
    def test_information_faults_excuse_nothing(self, kind: str) -> None:
        target = "r2/agent" if kind in ("crash", "freeze") else "r2"
        record = driving(still(), 0, 1.0, 5.0)
        effect = Incident(fault(kind, target, 1.0, 5.0), 1.0, 6.0, {"r2": Activity.DRIVING})
        assert breaches(dataclasses.replace(record, effects=(effect,)), "no contact")


class TestDrivenInto:
    def test_a_liar_that_stands_is_driven_into(self) -> None:
        record = with_effect(driving(still(), 0, 1.0, 5.0), "lie", 0.5, 9.0, x=1.0)
        (breach,) = breaches(record, "driven into")
        assert breach.robots == ("r1", "r2")
        assert not breaches(record, "no contact")

    def test_a_liar_that_drives_into_another(self) -> None:
        record = with_effect(driving(still(), 1, 1.0, 5.0, v=-0.2), "lie", 0.5, 9.0, x=1.0)
        assert [contact.kind for contact in contacts(record)] == [ContactClass.DISTURBED]
        assert not breaches(record, "driven into")
        assert judge(record)["driven into"].evaluated == 1

    def test_one_that_was_put_down_just_now_could_not_be_seen(self) -> None:
        record = with_effect(driving(still(), 0, 1.0, 5.0), "carry", 1.0, 3.2, x=0.1)
        carried = (record.time > 1.0) & (record.time <= 3.2)
        record.pose[:, 1, 1] += np.cumsum(np.where(carried, 0.05 * PERIOD, 0.0))
        assert [contact.kind for contact in contacts(record)] == [ContactClass.DISTURBED]

    @pytest.mark.parametrize(("seen_again", "kind"), [(2.7, "standing"), (6.0, "disturbed")])
    def test_one_that_was_put_down_where_no_camera_sees_it(self, seen_again: float, kind: str) -> None:
        record = with_effect(driving(still(), 0, 1.0, 5.0), "carry", 1.0, 2.5, x=0.1)
        record.good_pose[(record.time > 1.0) & (record.time < seen_again), 1] = 1.0
        assert [str(contact.kind) for contact in contacts(record)] == [kind]

    @pytest.mark.parametrize(("first_seen", "kind"), [(0.5, "ours"), (3.0, "ours"), (4.0, "disturbed")])
    def test_one_that_no_camera_has_seen_yet(self, first_seen: float, kind: str) -> None:
        record = driving(still(), 0, 1.0, 5.0)  # they touch at 4.2 s
        record.good_pose[record.time < first_seen, 1] = -math.inf
        assert [str(contact.kind) for contact in contacts(record)] == [kind]


class TestNamed:
    @staticmethod
    def reported(record: Record, time: float, process: str, *reasons: str) -> Record:
        return dataclasses.replace(record, reports=(*record.reports, HealthReport(time, process, reasons=reasons)))

    def lied(self) -> Record:
        return with_effect(still(), "lie", 2.0, 8.0, x=1.0)

    def test_nobody_says_anything(self) -> None:
        (breach,) = breaches(self.lied(), "named")
        assert breach.time == pytest.approx(3.0)
        assert "r2 (lie)" in breach.what

    def test_the_base_station_names_it_in_time(self) -> None:
        assert not breaches(self.reported(self.lied(), 2.9, "basestation", "r2: its estimate is 1.0 m off"), "named")

    def test_the_base_station_names_it_too_late(self) -> None:
        assert breaches(self.reported(self.lied(), 3.1, "basestation", "r2: its estimate is 1.0 m off"), "named")

    def test_it_names_another(self) -> None:
        assert breaches(self.reported(self.lied(), 2.5, "basestation", "r1: its estimate is 1.0 m off"), "named")

    def test_it_said_so_before_with_another_number(self) -> None:
        early = self.reported(self.lied(), 1.0, "basestation", "r2: its estimate is 0.3 m off")
        assert breaches(self.reported(early, 2.5, "basestation", "r2: its estimate is 1.0 m off"), "named")

    def test_an_old_estimate_is_a_lie_once_its_robot_is_elsewhere(self) -> None:
        standing = with_effect(still(), "lie", 2.0, 8.0, stuck=True)
        assert judge(standing)["named"].evaluated == 0
        driven = driving(standing, 1, 3.0, 7.0)  # 0.36 m after 1.8 s
        (breach,) = breaches(driven, "named")
        assert breach.time == pytest.approx(4.8 + 1.0, abs=0.06)
        assert not breaches(self.reported(driven, 5.7, "basestation", "r2 is not where it says"), "named")
        assert judge(driving(standing, 1, 6.0, 7.7))["named"].evaluated == 0  # the lie is over before it is one

    def test_a_carried_one_is_not_judged_while_no_picture_of_it_arrives(self) -> None:
        """A lie is: what a robot says needs no picture."""
        for kind, seen_until, evaluated in (("carry", 1.9, 0), ("carry", 2.1, 1), ("lie", 1.9, 1)):
            record = moved_by_hand(with_effect(still(), kind, 2.0, 4.0, x=0.7), 2.0, 4.0, 0.35)
            blind = aged(record.good_pose, record.time, 1, seen_until)
            assert judge(dataclasses.replace(record, good_pose=blind))["named"].evaluated == evaluated

    @pytest.mark.parametrize(("speed", "evaluated"), [(0.5, 1), (0.3, 0), (0.2, 0), (-0.2, 1)])
    def test_a_carried_one_has_to_leave_its_own_way(self, speed: float, evaluated: int) -> None:
        """It drives at 0.2 m/s itself; carried on at 0.5 m/s it is 0.12 m off after 0.4 s."""
        record = with_effect(driving(still(), 1, 1.0, 9.0), "carry", 2.0, 4.0, x=0.7)
        carried = moved_by_hand(record, 2.0, 4.0, speed - 0.2)
        judged = judge(carried)["named"]
        assert judged.evaluated == evaluated
        assert [breach.time for breach in judged.breaches] == pytest.approx([3.0] * evaluated, abs=0.06)

    def test_one_that_stands_and_is_carried_slowly_is_judged(self) -> None:
        carried = moved_by_hand(with_effect(still(), "carry", 2.0, 4.0, x=0.4), 2.0, 4.0, 0.2)
        (breach,) = breaches(carried, "named")
        assert breach.time == pytest.approx(3.0, abs=0.06)
        slower = moved_by_hand(with_effect(still(), "carry", 2.0, 4.0, x=0.2), 2.0, 4.0, 0.1)
        assert judge(slower)["named"].evaluated == 0

    @pytest.mark.parametrize(("set_at", "evaluated"), [(0.5, 0), (-3.0, 1)])
    def test_not_judged_until_clocks_are_compared_again(self, set_at: float, evaluated: int) -> None:
        step = fault("clock_step", "basestation", 0.0, 0.4, step=-2.0)
        effect = Incident(step, set_at, set_at + 0.4, {"r1": Activity.DRIVING})
        record = self.lied()
        judged = judge(dataclasses.replace(record, effects=(*record.effects, effect)))["named"]
        assert judged.evaluated == evaluated

    def test_not_judged_while_the_base_station_is_down(self) -> None:
        effect = Incident(fault("crash", "basestation", 2.5, 2.0), 2.5, 4.5, {"r1": Activity.DRIVING})
        record = self.lied()
        judged = judge(dataclasses.replace(record, effects=(*record.effects, effect)))["named"]
        assert (judged.evaluated, judged.breaches) == (0, ())


class TestBlind:
    @pytest.mark.parametrize(("field", "limit"), [("good_command", 0.45), ("good_pose", 0.6), ("good_snapshot", 0.6)])
    def test_wheels_turn_without_fresh_information(self, field: str, limit: float) -> None:
        record = driving(still(), 0, 1.0, 3.0 + limit + 0.1)
        record = dataclasses.replace(record, **{field: aged(getattr(record, field), record.time, 0, 3.0)})
        (breach,) = breaches(record, "blind")
        assert breach.robots == ("r1",)
        assert breach.time == pytest.approx(3.0 + limit, abs=2.5 * PERIOD)

    @pytest.mark.parametrize(("field", "limit"), [("good_command", 0.45), ("good_pose", 0.6), ("good_snapshot", 0.6)])
    def test_wheels_stop_in_time(self, field: str, limit: float) -> None:
        record = driving(still(), 0, 1.0, 3.0 + limit - PERIOD)
        record = dataclasses.replace(record, **{field: aged(getattr(record, field), record.time, 0, 3.0)})
        assert not breaches(record, "blind")

    def test_before_any_information(self) -> None:
        record = driving(still(), 0, 1.0, 2.0)
        never = record.good_pose.copy()
        never[:, 0] = -np.inf
        (breach,) = breaches(dataclasses.replace(record, good_pose=never), "blind")
        assert "never" in breach.what

    def test_somebody_else_drives_it(self) -> None:
        record = driving(still(), 1, 1.0, 5.0)
        record = dataclasses.replace(record, good_command=aged(record.good_command, record.time, 1, 1.0))
        assert breaches(record, "blind")
        assert not breaches(with_effect(record, "foreign_driver", 1.0, 5.0, v=0.2), "blind")


class TestBraking:
    @staticmethod
    def stopping(way: float) -> Record:
        """At 0.2 m/s; from 3 s on commanded zero, it rolls on for so long [m]."""
        record = driving(still(), 0, 1.0, 3.0)
        rolls = (record.time > 3.0) & (record.time <= 3.0 + way / 0.2)
        record.twist[rows_of(rolls), 0, 0] = 0.2
        record.pose[:, 0, 0] += np.cumsum(np.where(rolls, 0.2 * PERIOD, 0.0))
        return record

    def test_within_its_braking_distance(self) -> None:
        record = self.stopping(0.05)  # 0.2 m/s * 0.12 s + 0.2^2 / (2 * 0.8) m + 0.01 m = 0.059 m
        assert not breaches(record, "braking")
        assert judge(record)["braking"].evaluated == 1

    def test_further(self) -> None:
        (breach,) = breaches(self.stopping(0.08), "braking")
        assert "travels 0.08 m after its command is zero, expected at most 0.06 m" in breach.what


def rows_of(flags: np.ndarray) -> np.ndarray:
    return np.flatnonzero(flags)


class TestStop:
    @staticmethod
    def stopped(end: float, resumed: float | None = None, latched_until: float = 10.0) -> Record:
        record = driving(still(), 0, 1.0, end)
        record.latched[(record.time >= 2.0) & (record.time < latched_until), 0] = True
        orders = (Ordered(2.0, OrderRow(at=2.0, kind="stop"), True, 2.5),)
        if resumed is not None:
            orders += (Ordered(resumed, OrderRow(at=resumed, kind="resume"), True, resumed + 0.01),)
        return dataclasses.replace(record, orders=orders)

    def test_it_stands(self) -> None:
        assert not breaches(self.stopped(2.4), "stop")

    def test_it_drives_on(self) -> None:
        (breach,) = breaches(self.stopped(5.0), "stop")
        assert breach.time == pytest.approx(2.5, abs=0.05)

    def test_it_drives_after_a_resume(self) -> None:
        record = self.stopped(2.4, resumed=4.0, latched_until=4.0)
        assert not breaches(driving(record, 0, 4.0, 5.0), "stop")

    @pytest.mark.parametrize(("accepted", "allowed"), [(True, True), (None, True), (False, False)])
    def test_it_drives_after_a_resume_unless_that_was_refused(self, accepted: bool | None, allowed: bool) -> None:
        record = driving(self.stopped(2.4, latched_until=4.0), 0, 4.2, 5.0)
        resume = Ordered(4.0, OrderRow(at=4.0, kind="resume"), accepted, 4.5)
        assert bool(breaches(dataclasses.replace(record, orders=(*record.orders, resume)), "stop")) != allowed

    @pytest.mark.parametrize(("answered", "allowed"), [(1.9, False), (2.1, True)])
    def test_it_drives_after_a_resume_that_was_on_its_way_when_it_stopped(self, answered: float, allowed: bool) -> None:
        record = driving(self.stopped(2.4, latched_until=2.2), 0, 2.6, 5.0)
        resume = Ordered(1.0, OrderRow(at=1.0, kind="resume"), True, answered)
        assert bool(breaches(dataclasses.replace(record, orders=(*record.orders, resume)), "stop")) != allowed

    @pytest.mark.parametrize(("end", "broken"), [(2.4, False), (2.6, True)])
    def test_it_does_not_say_that_it_has_stopped(self, end: float, broken: bool) -> None:
        record = driving(still(), 0, 1.0, end)
        orders = (Ordered(2.0, OrderRow(at=2.0, kind="stop", robots=("r1",)), False, 2.5),)
        assert bool(breaches(dataclasses.replace(record, orders=orders), "stop")) == broken
        resume = Ordered(2.2, OrderRow(at=2.2, kind="resume"), True, 2.3)
        assert not breaches(dataclasses.replace(record, orders=(*orders, resume)), "stop")

    def test_it_cannot_hear_that_it_is_to_stop(self) -> None:
        orders = (Ordered(2.0, OrderRow(at=2.0, kind="stop"), False, 2.5),)
        effect = Incident(fault("partition", "r1", at=1.5, duration=2.0), 1.5, 3.5, {"r1": Activity.DRIVING})
        record = dataclasses.replace(driving(still(), 0, 1.0, 3.0), orders=orders, effects=(effect,))
        assert not breaches(record, "stop")

    @pytest.mark.parametrize(("name", "broken"), [("r1", False), ("r2", True)])
    def test_it_drives_after_another_robots_resume(self, name: str, broken: bool) -> None:
        record = driving(self.stopped(2.4, latched_until=4.0), 0, 4.2, 5.0)
        resume = Ordered(4.0, OrderRow(at=4.0, kind="resume", robots=(name,)), True, 4.01)
        assert bool(breaches(dataclasses.replace(record, orders=(*record.orders, resume)), "stop")) == broken

    def test_its_latch_opens_without_a_resume(self) -> None:
        record = self.stopped(2.4, latched_until=4.0)
        (breach,) = breaches(driving(record, 0, 5.0, 6.0), "stop")
        assert breach.time == pytest.approx(5.0, abs=0.05)


class TestInside:
    def test_it_leaves(self) -> None:
        # From -0.5 m on at 0.3 m/s; its body reaches the wall at 2.1 m when it is at 1.923 m.
        (breach,) = breaches(driving(still(1), 0, 0.0, 7.0, v=0.3), "inside")
        assert breach.time == pytest.approx(1.923 / 0.3, abs=0.05)
        assert str(breach) == "r1 leaves the arena (by 0.18 m) at 6.4 s"

    def test_it_touches_a_wall(self) -> None:
        record = driving(still(1), 0, 0.0, 6.0, v=0.3)
        wall = WallRow(start=(1.0, 0.1), end=(1.0, 1.5))
        record = dataclasses.replace(record, scenario=msgspec.structs.replace(record.scenario, wall=(wall,)))
        # Its body of 0.177 m, whose centre passes the wall's end 0.1 m beside it, reaches that at x = 0.854 m.
        (breach,) = breaches(record, "inside")
        assert breach.time == pytest.approx(0.854 / 0.3, abs=0.05)
        assert breach.what == "r1 touches the wall from (1, 0.1) to (1, 1.5) (by 0.08 m)"
        record.pose[:, 0, 1] = -0.1
        assert not breaches(record, "inside")

    def test_it_was_put_down_on_a_wall(self) -> None:
        record = with_effect(still(), "carry", 1.0, 1.5, x=1.0)
        wall = WallRow(start=(1.0, -1.5), end=(1.0, 1.5))
        record = dataclasses.replace(record, scenario=msgspec.structs.replace(record.scenario, wall=(wall,)))
        record.pose[record.time > 1.5, 1, 0] = 0.9
        assert not breaches(record, "inside")
        record.pose[record.time > 6.0, 1, 0] = 0.5
        record.pose[record.time > 8.0, 1, 0] = 0.9
        assert len(breaches(record, "inside")) == 1

    def test_it_turns_round_in_time(self) -> None:
        assert not breaches(driving(still(1), 0, 0.0, 6.0, v=0.3), "inside")

    def test_it_was_put_down_outside(self) -> None:
        record = with_effect(still(), "carry", 1.0, 1.5, x=2.5)
        record.pose[record.time > 1.5, 1, 0] = 3.0
        assert not breaches(record, "inside")
        record.pose[record.time > 6.0, 1, 0] = 0.5
        record.pose[record.time > 8.0, 1, 0] = 3.0
        assert len(breaches(record, "inside")) == 1


def test_a_behaviour_that_fails() -> None:
    record = still()
    error = "behaviour mine:turn: ZeroDivisionError"
    failed = HealthReport(2.0, "r1", reasons=(error,), failure=error)
    (breach,) = breaches(dataclasses.replace(record, reports=(*record.reports, failed, failed)), "behaves")
    assert "ZeroDivisionError" in breach.what


def test_a_process_that_fails() -> None:
    ends = (ProcessEnd(3.0, "r2/agent", "ValueError('x')"), ProcessEnd(4.0, "basestation", ""))
    (breach,) = breaches(dataclasses.replace(still(), ends=ends), "survives")
    assert breach.robots == ("r2",)
    assert breach.what == "the process r2/agent ends with ValueError('x')"
