"""The base's rules without a bus or a loop: each command and each beat at its time, on both sides of the limits."""

from __future__ import annotations

import pytest

from agents.base.base import DEAD_MAN, Base
from muro_zenoh.messages import BaseState, Odometry, VelocityCommand
from muro_zenoh.transport import Received
from tests.unit.test_base import Wheels

T0 = 1000.0


class Driven:
    """A base at rest, its wheels, and what it last set them to."""

    def __init__(self, dead_man: float = DEAD_MAN) -> None:
        self.wheels = Wheels()
        self.base = Base("r1", self.wheels, dead_man)

    def obey(
        self, at: float, v: float = 0.2, *, late: float = 0.0, epoch: int = 7, seq: int = 0
    ) -> tuple[float, float] | None:
        """What the wheels are set to, after a command that came at a time, and had waited before."""
        command = VelocityCommand(v=v, omega=0.1, epoch=epoch, seq=seq)
        self.base.obey(Received("r1", command, T0 + at, late, 0.0), T0 + at)
        return self.wheels.now

    def beat(self, at: float) -> tuple[float, float] | None:
        """What the wheels are set to, after a beat."""
        self.base.beat(T0 + at)
        return self.wheels.now


STILL = (0.0, 0.0)
DRIVING = (0.2, 0.1)


def test_a_new_base_has_commanded_nothing_and_zeroes_at_its_first_beat() -> None:
    driven = Driven()
    assert driven.wheels.now is None
    assert driven.beat(0.0) == STILL


@pytest.mark.parametrize(("late", "obeyed"), [(0.0, True), (0.29, True), (0.31, False), (3.0, False)])
def test_a_command_is_obeyed_that_is_no_older_than_0_3_s(late: float, obeyed: bool) -> None:
    assert Driven().obey(0.0, late=late) == (DRIVING if obeyed else None)


def test_how_old_a_command_may_be_is_a_setting(caplog: pytest.LogCaptureFixture) -> None:
    driven = Driven(dead_man=0.5)
    assert driven.obey(0.0, late=0.51) is None
    assert driven.obey(0.0, late=0.49) == DRIVING
    assert driven.beat(0.009) == DRIVING
    assert driven.beat(0.011) == STILL
    assert caplog.messages[-1] == "r1: no fresh command for 0.5 s, wheels at zero"


def test_a_base_that_was_frozen_obeys_nothing_of_before_or_meanwhile() -> None:
    driven = Driven()
    driven.obey(0.0)
    before = Received("r1", VelocityCommand(v=0.3, omega=0.1, epoch=7), T0 + 0.05, 0.0, 0.0)  # filed, and not yet read
    driven.base.obey(before, T0 + 20.0)
    assert driven.beat(20.0) == STILL
    for waited in (19.0, 5.0, 0.31):  # what has waited in the link until now
        assert driven.obey(20.0, 0.3, late=waited) == STILL
    assert driven.obey(20.01, 0.3) == (0.3, 0.1)


def test_what_waited_for_its_reader_is_older_by_that() -> None:
    driven = Driven()
    command = Received("r1", VelocityCommand(v=0.2, omega=0.1, epoch=7), T0, 0.1, 0.0)
    driven.base.obey(command, T0 + 0.21)
    assert driven.wheels.now is None
    driven.base.obey(command, T0 + 0.19)
    assert driven.wheels.now == DRIVING


@pytest.mark.parametrize("late", [0.0, 0.2])
def test_it_is_driven_by_until_it_is_0_3_s_old(late: float) -> None:
    driven = Driven()
    driven.obey(0.0, late=late)
    assert driven.beat(0.29 - late) == DRIVING
    assert driven.beat(0.31 - late) == STILL


def test_the_limits_themselves_are_fresh() -> None:
    driven = Driven()
    driven.base.obey(Received("r1", VelocityCommand(v=0.2, omega=0.1, epoch=7), 0.0, 0.3, 0.0), 0.0)
    assert driven.wheels.now == DRIVING
    driven.base.beat(0.0)  # its 0.3 s are over at this very moment, and not before
    assert driven.wheels.now == DRIVING


def test_a_command_too_late_takes_nothing_from_the_one_before() -> None:
    driven = Driven()
    driven.obey(0.0)
    assert driven.obey(0.1, v=0.5, late=0.31, epoch=8) == DRIVING
    assert driven.beat(0.29) == DRIVING


def test_a_beat_while_all_is_well_commands_nothing() -> None:
    driven = Driven()
    driven.obey(0.0)
    before = len(driven.wheels.commanded)
    for k in range(10):
        driven.beat(0.02 * k)
    assert len(driven.wheels.commanded) == before


# ---- one writer, out of order

ZEROED = (0.0, 0.1)


@pytest.mark.parametrize("seq", [1, 11, 12])
def test_a_command_that_a_later_one_overtook_is_ignored_and_counted(seq: int, caplog: pytest.LogCaptureFixture) -> None:
    driven = Driven()
    driven.obey(0.0, seq=10)
    assert driven.obey(0.1, v=0.0, seq=12) == ZEROED
    assert driven.base.overtaken == 0
    for _ in range(3):
        assert driven.obey(0.15, late=0.1, seq=seq) == ZEROED
    assert driven.base.overtaken == 3
    assert caplog.text.count("expected them in order") == 1
    assert driven.obey(0.2, seq=13) == DRIVING


def test_an_overtaken_command_does_not_keep_the_wheels_turning() -> None:
    driven = Driven()
    driven.obey(0.0, seq=12)
    driven.obey(0.2, seq=11)
    assert driven.beat(0.31) == STILL


@pytest.mark.parametrize(("later", "obeyed"), [(0.29, False), (0.31, True)])
def test_a_wrong_number_locks_its_writer_out_no_longer_than_its_command_lasts(later: float, obeyed: bool) -> None:
    driven = Driven()
    driven.obey(0.0, v=0.0, seq=2**40)
    assert driven.obey(later, seq=5) == (DRIVING if obeyed else ZEROED)
    if obeyed:
        assert driven.obey(later + 0.05, seq=6) == DRIVING


def test_at_the_moment_at_which_a_command_expires_an_overtaken_one_is_still_ignored() -> None:
    driven = Driven()
    driven.base.obey(Received("r1", VelocityCommand(v=0.0, omega=0.1, epoch=7, seq=9), 0.0, 0.3, 0.0), 0.0)
    driven.base.obey(Received("r1", VelocityCommand(v=0.2, omega=0.1, epoch=7, seq=8), 0.0, 0.0, 0.0), 0.0)
    assert driven.wheels.now == ZEROED


def test_commands_without_a_number_are_all_obeyed() -> None:
    driven = Driven()
    assert driven.obey(0.0, v=0.0) == ZEROED
    assert driven.obey(0.1) == DRIVING
    assert driven.obey(0.15, v=0.0, seq=9) == ZEROED
    assert driven.obey(0.2) == DRIVING


def test_a_writer_that_starts_again_counts_from_one() -> None:
    driven = Driven()
    driven.obey(0.0, seq=500)
    assert driven.obey(0.31, epoch=8, seq=1) == DRIVING
    assert driven.obey(0.36, epoch=8, seq=2) == DRIVING
    assert driven.base.overtaken == 0


# ---- two writers


def test_the_first_writer_is_not_taken_for_a_second() -> None:
    driven = Driven()
    assert driven.obey(-T0) == DRIVING  # at time zero, too


def test_between_two_writers_the_wheels_stand_until_the_others_last_command_has_expired() -> None:
    driven = Driven()
    driven.obey(0.0)
    assert driven.obey(0.1, epoch=8) == STILL
    assert driven.obey(0.29, epoch=8) == STILL
    assert driven.obey(0.31, epoch=8) == DRIVING
    assert driven.obey(0.5, epoch=8) == DRIVING


@pytest.mark.parametrize(("later", "driven_at_once"), [(0.29, False), (0.31, True)])
def test_a_writer_that_follows_another_is_obeyed_when_that_ones_command_has_expired(
    later: float, driven_at_once: bool
) -> None:
    driven = Driven()
    driven.obey(0.0)
    assert driven.obey(later, epoch=8) == (DRIVING if driven_at_once else STILL)


def test_two_writers_by_turns_never_drive_and_are_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    driven = Driven()
    driven.obey(0.0)
    for k in range(1, 10):
        assert driven.obey(0.1 * k, epoch=7 + k % 2) == STILL
    warnings = [record.message for record in caplog.records if record.levelname == "WARNING"]
    assert len(warnings) == 1
    assert warnings[0].startswith("r1: two processes command these wheels")
    driven.obey(3.0)
    driven.obey(3.1, epoch=8)  # once more, after a time with one writer
    assert caplog.messages.count(warnings[0]) == 2


def test_a_command_is_fresh_at_its_limit_beside_another_writers_too(caplog: pytest.LogCaptureFixture) -> None:
    driven = Driven()
    for epoch in (7, 8, 7, 8):
        at = 0.0 if driven.wheels.now is None else 0.3
        driven.base.obey(Received("r1", VelocityCommand(v=0.2, omega=0.1, epoch=epoch), at, 0.0, 0.0), at)
    assert driven.wheels.commanded == [DRIVING, STILL, STILL, STILL]
    assert sum("two processes" in message for message in caplog.messages) == 1


def test_a_command_without_epoch_is_no_writer(caplog: pytest.LogCaptureFixture) -> None:
    driven = Driven()
    assert driven.obey(0.0, epoch=0) is None
    driven.obey(0.1)
    assert driven.obey(0.2, v=0.4, epoch=0) == DRIVING
    assert driven.beat(0.39) == DRIVING
    assert driven.beat(0.41) == STILL  # it kept nothing alive
    assert sum("without `epoch`" in message for message in caplog.messages) == 1
    assert caplog.records[0].message.startswith("r1: ")


# ---- hazards


def test_a_hazard_stops_between_two_beats_and_its_end_alone_starts_nothing() -> None:
    driven = Driven()
    driven.obey(0.0)
    driven.wheels.reading = driven.wheels.reading._replace(cliff=True)
    assert driven.obey(0.01) == STILL  # no beat was in between
    driven.wheels.reading = driven.wheels.reading._replace(cliff=False)
    assert driven.beat(0.02) == STILL
    assert driven.obey(0.03) == DRIVING


def test_a_beat_stops_at_a_hazard_whatever_is_commanded() -> None:
    driven = Driven()
    driven.obey(0.0)
    driven.wheels.reading = driven.wheels.reading._replace(bumper=True)
    assert driven.beat(0.02) == STILL


# ---- what is reported


def test_the_log_says_when_commands_come_and_when_they_end(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    driven = Driven()
    for at in (0.0, 5.0):
        driven.obey(at)
        driven.obey(at + 0.1)
        driven.beat(at + 1.0)
        driven.beat(at + 1.1)
    assert caplog.messages == ["r1: receiving commands", "r1: no fresh command for 0.3 s, wheels at zero"] * 2


def test_odometry_is_the_last_beats() -> None:
    driven = Driven()
    assert driven.base.odometry(T0) == Odometry(stamp=T0, x=1.0, y=2.0, theta=0.5, v=0.1, omega=-0.2)
    driven.wheels.reading = driven.wheels.reading._replace(x=1.5)
    assert driven.base.odometry(T0).x == 1.0
    driven.beat(0.0)
    assert driven.base.odometry(T0).x == 1.5


def test_the_state_is_reported_at_first_on_change_and_each_half_second() -> None:
    driven = Driven()
    reading = driven.wheels.reading._replace(charging=True, bumper=True, cliff=True, wheel_drop=True)
    driven.wheels.reading = reading
    driven.beat(0.0)
    expected = BaseState(battery=0.7, charging=True, bumper=True, cliff=True, wheel_drop=True, dead_man=True)
    assert driven.base.state(T0) == expected
    assert driven.base.state(T0 + 0.49) is None
    assert driven.base.state(T0 + 0.5) == expected
    assert driven.base.state(T0 + 0.9) is None
    assert driven.base.state(T0 + 1.1) == expected


@pytest.mark.parametrize("change", ["battery", "charging", "bumper", "cliff", "wheel_drop", "dead_man"])
def test_each_part_of_the_state_is_reported_when_it_changes(change: str) -> None:
    driven = Driven()
    driven.beat(0.0)
    driven.base.state(T0)
    if change == "dead_man":
        driven.obey(0.01)
    else:
        driven.wheels.reading = driven.wheels.reading._replace(**{change: 0.1 if change == "battery" else True})
    driven.beat(0.02)
    state = driven.base.state(T0 + 0.02)
    assert state is not None
    assert getattr(state, change) == {"battery": 0.1, "dead_man": False}.get(change, True)


def test_where_the_wheels_only_move_the_state_has_not_changed() -> None:
    driven = Driven()
    driven.beat(0.0)
    driven.base.state(T0)
    driven.wheels.reading = driven.wheels.reading._replace(x=9.0, theta=1.0, v=0.2, omega=0.3)
    driven.beat(0.02)
    assert driven.base.state(T0 + 0.02) is None
