"""One robot's control loop, event by event: how old what it drives by may be, on both sides of each limit."""

from __future__ import annotations

import asyncio
import math
from typing import Any

import pytest

from agents.control_loop import ControlLoop, Outgoing, Surroundings
from muro_zenoh import channels
from muro_zenoh.behaviours.interface import Behaviour, Intent, Seen, ShownCell, Snapshot, hold
from muro_zenoh.channels import Channel
from muro_zenoh.config import Timeouts, parse_scenario
from muro_zenoh.estimation.pose_filter import PoseEstimate
from muro_zenoh.geometry import Circle, Pose2, State, Twist2
from muro_zenoh.messages import (
    Cell,
    Estimate,
    PlannedPath,
    PoseFix,
    SpeedReference,
    StopOrder,
    VelocityCommand,
)
from muro_zenoh.planning.path import Path, Segment

ROBOT = parse_scenario({"robots": 1}, "lab.toml", name="lab").robot["r1"]
T0 = 1000.0
FORWARD = Intent(Twist2(0.2, 0.0))
NOTHING = Surroundings()
ACCURATE = (1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 1e-5)


class Forward(Behaviour):
    def step(self, seen: Seen) -> Intent:
        return FORWARD


def commands(out: Outgoing) -> list[tuple[float, float]]:
    """The velocity commands in what was sent."""
    return [(m.v, m.omega) for channel, m in out if channel is channels.CMD_VEL and isinstance(m, VelocityCommand)]


def fix(age: float = 0.0) -> PoseFix:
    return PoseFix(x=0.0, y=0.0, theta=0.0, covariance=ACCURATE, camera="north", age=age)


def free(behaviour: Behaviour | None = None) -> ControlLoop:
    """A loop that has received the stop state, and saw its robot at T0."""
    loop = ControlLoop("r1", ROBOT)
    loop.take_stop(T0 - 1.0, StopOrder(all=False, revision=5))
    loop.behave(behaviour)
    loop.update(T0, [(T0, fix())], [], NOTHING)
    return loop


@pytest.mark.parametrize(("age", "drives"), [(0.05, True), (0.24, True), (0.26, False), (0.34, False), (0.5, False)])
def test_a_pose_is_used_for_0_25_s_from_its_capture(age: float, drives: bool) -> None:
    loop = free(Forward())
    (command,) = commands(loop.update(T0 + age, [], [], NOTHING))
    assert (command != (0.0, 0.0)) == drives
    assert loop.reasons == (() if drives else (f"no pose for {age:.1f} s",))


def test_the_age_of_a_pose_counts_from_its_capture_and_not_from_its_arrival() -> None:
    loop = free(Forward())
    captured = T0 + 0.01
    assert commands(loop.update(captured + 0.24, [(captured, fix(0.24))], [], NOTHING)) != [(0.0, 0.0)]
    loop = free(Forward())
    assert commands(loop.update(captured + 0.26, [(captured, fix(0.26))], [], NOTHING)) == [(0.0, 0.0)]


@pytest.mark.parametrize("back", [0.3, 0.9, 4.0])
def test_what_was_known_before_the_clock_was_set_back_is_forgotten(back: float) -> None:
    loop = free(Forward())
    for step in range(200):
        assert commands(loop.update(T0 + 0.05 * step - back, [], [], NOTHING)) in ([], [(0.0, 0.0)])
    now = T0 + 0.05 * 200 - back
    assert commands(loop.update(now, [(now, fix())], [], NOTHING)) != [(0.0, 0.0)]


@pytest.mark.parametrize("back", [0.01, 0.3, 4.0])
def test_a_behaviour_that_is_a_task_of_its_own_is_the_first_to_see_that_the_clock_was_set_back(back: float) -> None:
    loop = free()
    assert commands(loop.want(T0, FORWARD)) != [(0.0, 0.0)]
    assert commands(loop.want(T0 - back, FORWARD)) == [(0.0, 0.0)]
    assert loop.reasons == ("no pose yet: waiting for a camera to see this robot",)
    loop.update(T0 - back, [(T0 - back, fix())], [], NOTHING)
    assert commands(loop.want(T0 - back, FORWARD)) != [(0.0, 0.0)]


def test_ever_new_names_in_stop_orders_do_not_fill_the_memory() -> None:
    loop = ControlLoop("r1", ROBOT)
    for order in range(50):
        loop.take_stop(T0, StopOrder(all=False, names=tuple(f"x{100 * order + number}" for number in range(100))))
    assert len(loop.stopped_names) == 1000
    loop.take_stop(T0, StopOrder(all=False, names=("r1", *(f"y{number}" for number in range(2000)))))
    assert len(loop.stopped_names) == 1000
    assert loop.latch.stopped
    loop.take_stop(T0, StopOrder(all=False, names=("r1",), revision=3))
    assert loop.stopped_names == {"r1"}


def test_how_old_a_pose_may_be_and_when_a_command_is_repeated_are_settings() -> None:
    loop = ControlLoop("r1", ROBOT, Timeouts(pose=0.5, command=0.6))
    loop.take_stop(T0, StopOrder(all=False, revision=5))
    loop.behave(Forward())
    loop.update(T0, [(T0, fix())], [], NOTHING)
    assert commands(loop.update(T0 + 0.49, [], [], NOTHING)) != [(0.0, 0.0)]
    assert commands(loop.update(T0 + 0.51, [], [], NOTHING)) == [(0.0, 0.0)]
    loop.behave(None)
    assert [len(commands(loop.update(T0 + t, [], [], NOTHING))) for t in (0.7, 0.72)] == [0, 1]
    assert loop.tracking.filter._settings.command_timeout == 0.6


# ---- after a pause


def woken(pause: float, behaviour: Behaviour | None = None) -> ControlLoop:
    """A loop that drove at T0, was not updated for a while, and has a fresh pose again."""
    loop, _ = converged(behaviour or Recorder())
    loop.update(T0, [], [], NOTHING)
    loop.update(T0 + pause, [], [], NOTHING)
    return loop


@pytest.mark.parametrize(("pause", "waits"), [(0.075, False), (0.49, False), (0.51, True), (3600.0, True)])
def test_a_process_that_was_frozen_drives_by_nothing_before_it_knows_the_stop_state(pause: float, waits: bool) -> None:
    loop = woken(pause)
    for k in range(1, 5):
        (command,) = commands(loop.update(T0 + pause + 0.1 * k, [], [], NOTHING))
        assert (command == (0.0, 0.0)) == waits
    assert loop.reasons == (
        (f"no stop state since a pause of {pause:.1f} s: waiting for the base station",) if waits else ()
    )


@pytest.mark.parametrize(
    ("age", "revision", "drives"),
    [
        (0.0, 5, True),
        (0.5, 5, True),
        (0.51, 5, False),
        (3.0, 5, False),
        (0.0, 0, False),
        (0.0, 4, False),
        (0.0, 6, True),
    ],
)
def test_only_todays_stop_state_ends_the_wait_after_a_pause(age: float, revision: int, drives: bool) -> None:
    loop = woken(10.0)
    loop.take_stop(T0 + 10.0, StopOrder(all=False, names=("r2",), revision=revision), age)
    (command,) = commands(loop.update(T0 + 10.05, [], [], NOTHING))
    assert (command != (0.0, 0.0)) == drives


def test_a_stop_that_was_given_during_a_pause_holds_however_late_it_comes() -> None:
    loop = woken(10.0)
    assert commands(loop.take_stop(T0 + 10.0, StopOrder(all=True, revision=6), 9.0)) == [(0.0, 0.0)]
    assert loop.reasons == ("stopped by order (all robots)",)


def test_an_intent_of_before_a_pause_is_not_driven_by_after_it() -> None:
    loop, _ = converged()
    loop.update(T0, [], [], NOTHING)
    loop.want(T0, FORWARD)
    loop.update(T0 + 0.4, [], [], NOTHING)
    assert loop.reasons == ("no command from the behaviour",)


@pytest.mark.parametrize(("silent", "drives"), [(0.15, True), (0.24, True), (0.26, False), (0.35, False)])
def test_an_intent_is_used_for_0_25_s(silent: float, drives: bool) -> None:
    loop, _ = converged()
    loop.update(T0, [], [], NOTHING)
    assert commands(loop.want(T0, FORWARD)) == [pytest.approx((0.25, 0.0))]
    (command,) = commands(loop.update(T0 + silent, [], [], NOTHING))
    assert (command != (0.0, 0.0)) == drives
    assert loop.reasons == (() if drives else ("no command from the behaviour",))


@pytest.mark.parametrize(("later", "repeated"), [(0.05, False), (0.099, False), (0.101, True), (0.29, True)])
def test_a_command_is_repeated_after_a_third_of_the_dead_mans_time(later: float, repeated: bool) -> None:
    loop = free()  # a behaviour that is a task of its own, and makes no calls
    loop.want(T0, FORWARD)
    assert len(commands(loop.update(T0 + later, [], [], NOTHING))) == repeated


def test_a_command_is_repeated_when_its_tenth_of_a_second_is_over() -> None:
    loop = ControlLoop("r1", ROBOT)
    assert [len(commands(loop.update(t, [], [], NOTHING))) for t in (0.0, 0.1, 0.2)] == [1, 1, 1]


def test_zero_is_repeated_where_there_was_never_a_pose() -> None:
    loop = ControlLoop("r1", ROBOT)
    assert commands(loop.update(T0, [], [], NOTHING)) == [(0.0, 0.0)]
    assert commands(loop.update(T0 + 0.09, [], [], NOTHING)) == []
    assert commands(loop.update(T0 + 0.11, [], [], NOTHING)) == [(0.0, 0.0)]
    stop, pose = loop.reasons[:2]
    assert stop.startswith("no stop state received yet")
    assert pose.startswith("no pose yet")


@pytest.mark.parametrize(
    "order",
    [StopOrder(all=True, revision=0), StopOrder(all=False, names=("r1",), revision=6), StopOrder(all=True, revision=9)],
)
def test_a_stop_is_answered_with_zero_and_not_with_the_next_command(order: StopOrder) -> None:
    loop = free(Forward())
    assert commands(loop.update(T0 + 0.05, [], [], NOTHING)) != [(0.0, 0.0)]
    loop.changed = False
    assert commands(loop.take_stop(T0 + 0.051, order)) == [(0.0, 0.0)]
    assert loop.changed  # so that it is reported now
    assert loop.reasons[0].startswith("stopped by order")


def test_a_stop_of_another_robot_commands_nothing() -> None:
    loop = free(Forward())
    assert commands(loop.take_stop(T0 + 0.01, StopOrder(all=False, names=("r2",), revision=6))) == []


def test_a_hold_is_commanded_at_once() -> None:
    loop = free()
    loop.want(T0, FORWARD)
    loop.changed = False
    assert commands(loop.want(T0 + 0.001, hold("enough"))) == [(0.0, 0.0)]
    assert loop.reasons == ("enough",)
    assert loop.changed


def test_the_last_command_is_zero() -> None:
    loop = free(Forward())
    assert commands(loop.end(T0 + 0.01)) == [(0.0, 0.0)]


# ---- what a behaviour sees, and what is sent

ESTIMATE = PoseEstimate(
    1.0, 2.0, 0.5, 0.11, -0.3, ACCURATE, s_v=0.8, s_omega=1.25, sigma_v=0.02, sigma_omega=0.05, t_fix=T0
)
"""A robot whose wheels give 0.8 of the speed and 1.25 of the turning that they are commanded."""

AHEAD = State(1.01, 2.02, 0.48, 0.12, -0.2)


class Filter:
    """A pose filter that has converged, and records what it is given."""

    def __init__(self) -> None:
        self.twists: list[tuple[float, float, float]] = []
        self.commands: list[tuple[float, float, float]] = []
        self.asked: list[tuple[object, ...]] = []

    def twist(self, t: float, v: float, omega: float) -> None:
        self.twists.append((t, v, omega))

    def command(self, t: float, v: float, omega: float) -> None:
        self.commands.append((t, v, omega))

    def at(self, t: float) -> PoseEstimate:
        return ESTIMATE._replace(t_fix=t)

    def look_ahead(self, estimate: PoseEstimate, now: float, lag: float) -> State:
        self.asked.append((estimate, now, lag))
        return AHEAD


class Recorder(Behaviour):
    """Wants one thing, and keeps what it saw."""

    def __init__(self, intent: Intent = FORWARD) -> None:
        self.intent = intent
        self.seen: list[Seen] = []

    def step(self, seen: Seen) -> Intent:
        self.seen.append(seen)
        return self.intent


def converged(behaviour: Behaviour | None = None) -> tuple[ControlLoop, Filter]:
    """A loop that may drive, with a filter that has converged."""
    loop, pose_filter = ControlLoop("r1", ROBOT), Filter()
    loop.tracking.filter = pose_filter  # type: ignore[assignment]
    loop.take_stop(T0, StopOrder(all=False, revision=5))
    loop.behave(behaviour)
    return loop, pose_filter


def of(channel: Channel[Any], out: Outgoing) -> list[Any]:
    """What was sent on a channel."""
    return [message for on, message in out if on is channel]


def test_a_new_loop_has_nothing_to_report() -> None:
    loop = ControlLoop("r1", ROBOT)
    assert (loop.reasons, loop.seen, loop.changed, loop.tracking.fixes, loop.commands) == ((), None, False, 0, 0)


def test_a_robot_whose_behaviour_has_said_nothing_says_so() -> None:
    loop = free()
    loop.update(T0 + 0.2, [(T0 + 0.2, fix())], [], NOTHING)
    assert loop.reasons == ("no behaviour yet",)
    assert not loop.update(T0 + 0.25, [], [], NOTHING)[1:]  # zero is not sent with each estimate


def test_before_the_first_pose_a_behaviour_that_is_stepped_is_not_blamed() -> None:
    loop = ControlLoop("r1", ROBOT)
    loop.take_stop(T0, StopOrder(all=False, revision=5))
    loop.behave(Recorder(hold("not now")))
    loop.update(T0 + 1.0, [], [], NOTHING)
    assert len(loop.reasons) == 1
    assert loop.reasons[0].startswith("no pose yet")


def test_what_a_behaviour_sees_is_the_estimate_of_now_and_what_others_say() -> None:
    behaviour = Recorder()
    loop, pose_filter = converged(behaviour)
    snapshot = Snapshot((), 7.0, 3, 0.05)
    around = Surroundings(Circle(0.1, 0.2, 0.7), 0.15, 0.3, snapshot, 0.06)
    loop.take_stop(T0, StopOrder(all=False, names=("r2",), revision=6))
    loop.update(T0 + 0.1, [], [], around)
    assert behaviour.seen == [
        Seen(T0 + 0.1, State(1.0, 2.0, 0.5, 0.11, -0.3), AHEAD, *around, frozenset({"r2"}), may_drive=True)
    ]
    assert behaviour.seen == [loop.seen]
    assert pose_filter.asked == [(ESTIMATE._replace(t_fix=T0 + 0.1), T0 + 0.1, ROBOT.lag)]


def test_a_behaviour_sees_whether_its_last_command_was_driven() -> None:
    behaviour = Recorder()
    loop, _ = converged(behaviour)
    loop.take_stop(T0, StopOrder(all=True, revision=5))
    loop.update(T0, [], [], NOTHING)
    loop.take_stop(T0, StopOrder(all=False, revision=6))
    loop.update(T0 + 0.05, [], [], NOTHING)
    loop.update(T0 + 0.1, [], [], NOTHING)
    assert [seen.may_drive for seen in behaviour.seen] == [False, False, True]


@pytest.mark.parametrize(
    ("revision", "stopped"),
    [(0, {"r2", "r3"}), (5, {"r2", "r3"}), (6, {"r2", "r3"}), (7, {"r2"}), (2**53, {"r2", "r3"})],
)
def test_the_robots_that_stand_are_those_of_the_newest_order_and_of_all_that_came_since(
    revision: int, stopped: set[str]
) -> None:
    loop, _ = converged(Recorder())
    loop.take_stop(T0, StopOrder(all=False, names=("r3",), revision=6))
    loop.take_stop(T0, StopOrder(all=False, names=("r2",), revision=revision))
    loop.update(T0, [], [], NOTHING)
    assert loop.seen is not None
    assert loop.seen.stopped == stopped


def test_before_any_order_no_robot_is_known_to_stand() -> None:
    loop = ControlLoop("r1", ROBOT)
    loop.tracking.filter = Filter()  # type: ignore[assignment]
    loop.update(T0, [], [], NOTHING)
    assert loop.seen is not None
    assert loop.seen.stopped == frozenset()


def test_the_filter_is_given_the_odometry_and_each_command_as_it_was_sent() -> None:
    loop, pose_filter = converged(Recorder())
    loop.update(T0, [], [(T0 - 0.02, 0.1, 0.2), (T0 - 0.01, 0.3, 0.4)], NOTHING)
    assert pose_filter.twists == [(T0 - 0.02, 0.1, 0.2), (T0 - 0.01, 0.3, 0.4)]
    assert pose_filter.commands == [(T0, pytest.approx(0.25), 0.0)]


def test_odometry_is_believed_for_as_long_as_its_channel_says() -> None:
    loop = free()
    settings = loop.tracking.filter._settings
    assert (settings.odometry_timeout, settings.command_timeout) == (0.15, 0.3)


def test_the_filter_knows_this_robots_wheels() -> None:
    slow = parse_scenario({"robot": {"r1": {"tag": 1, "lag": 0.3, "a_max": 0.25}}}, "lab.toml", name="lab").robot["r1"]
    limits = ControlLoop("r1", slow).tracking.filter._limits
    assert (limits.lag, limits.a_max) == (0.3, 0.25)


def test_a_command_makes_up_for_the_drive_scales_within_the_robots_limits() -> None:
    loop, _ = converged(Recorder(Intent(Twist2(0.2, 0.5))))
    (command,) = of(channels.CMD_VEL, loop.update(T0, [], [], NOTHING))
    assert (command.stamp, command.v, command.omega) == (T0, pytest.approx(0.25), pytest.approx(0.4))
    loop.behave(Recorder(Intent(Twist2(-99.0, 99.0))))
    assert commands(loop.update(T0 + 0.1, [], [], NOTHING)) == [(-ROBOT.v_max, ROBOT.omega_max)]


def test_the_estimate_is_sent_with_its_time() -> None:
    loop, _ = converged()
    (estimate,) = of(channels.ESTIMATE, loop.update(T0, [], [], NOTHING))
    assert estimate == Estimate(stamp=T0, x=1.0, y=2.0, theta=0.5, v=0.11, omega=-0.3, covariance=ACCURATE)


def test_the_calibration_is_sent_at_the_first_estimate_and_once_a_period() -> None:
    loop, _ = converged()
    period = channels.CAL_V.period
    sent = [
        len(of(channels.CAL_V, loop.update(T0 + t, [], [], NOTHING))) for t in (0.0, 0.5 * period, period, 1.1 * period)
    ]
    assert sent == [1, 0, 1, 0]


def test_the_calibration_is_the_inverse_of_the_scale() -> None:
    loop, _ = converged()
    out = loop.update(T0, [], [], NOTHING)
    ((of_v,), (of_omega,)) = of(channels.CAL_V, out), of(channels.CAL_OMEGA, out)
    assert (of_v.value, of_v.sigma) == pytest.approx((1.25, 0.03125))  # 0.02 / 0.8^2
    assert (of_omega.value, of_omega.sigma) == pytest.approx((0.8, 0.032))  # 0.05 / 1.25^2


def test_what_a_behaviour_shows_is_sent_beside_its_command() -> None:
    path = Path(Pose2(0.1, 0.2, 0.3), (Segment(0.5, 0.0), Segment(0.25, -2.0)))
    corners = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
    loop, _ = converged()
    intent = FORWARD._replace(speed=0.17, path=path, path_has_heading=True, cell=ShownCell(corners, 0.3, 0.4))
    for out in (loop.want(T0, intent), (loop.behave(Recorder(intent)), loop.update(T0, [], [], NOTHING))[1]):
        assert of(channels.VELOCITY, out) == [SpeedReference(speed=0.17)]
        segments = ((0.5, 0.0), (0.25, -2.0))
        assert of(channels.PATH, out) == [PlannedPath(x=0.1, y=0.2, theta=0.3, segments=segments, goal_theta=True)]
        assert of(channels.CELL, out) == [Cell(corners=corners, x=0.3, y=0.4)]


def test_a_path_ends_with_the_ride_and_a_cell_with_the_behaviour() -> None:
    """Both are kept for late joiners: what is over would be shown for good."""
    path = Path(Pose2(0.1, 0.2, 0.3), (Segment(0.5, 0.0),))
    shows = FORWARD._replace(path=path, cell=ShownCell(((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)), 0.3, 0.4))
    behaviour = Recorder(shows)
    loop, _ = converged(behaviour)
    assert len(of(channels.PATH, loop.update(T0 - 0.1, [], [], NOTHING))) == 1
    behaviour.intent = FORWARD
    assert of(channels.PATH, loop.update(T0, [], [], NOTHING)) == []
    behaviour.intent = hold("no goal")
    out = loop.update(T0 + 0.05, [], [], NOTHING)
    assert [message.segments for message in of(channels.PATH, out)] == [()]
    assert of(channels.CELL, out) == []
    loop.behave(None)
    out = loop.want(T0 + 0.1, hold("the behaviour is changing"))
    assert of(channels.PATH, out) == []
    assert [message.corners for message in of(channels.CELL, out)] == [()]
    assert of(channels.CELL, loop.want(T0 + 0.15, hold("again"))) == []


def test_a_reason_beside_a_twist_holds_nobody() -> None:
    loop, _ = converged(Recorder(FORWARD._replace(reason="slow here")))
    assert commands(loop.update(T0, [], [], NOTHING)) == [(pytest.approx(0.25), 0.0)]
    assert loop.reasons == ()


def test_fixes_their_ages_and_commands_are_counted() -> None:
    loop = free(Forward())  # one command at the update; none at a stop state that stops nobody
    assert (loop.tracking.fixes, loop.commands) == (1, 1)
    loop.update(T0 + 0.05, [(T0 + 0.01, fix()), (T0 + 0.02, fix())], [], NOTHING)
    assert (loop.tracking.fixes, loop.commands) == (3, 2)
    assert loop.tracking.pose_ages == [0.0, pytest.approx(0.04), pytest.approx(0.03)]


# ---- behaviours that fail


class Raising(Behaviour):
    """Drives, and then raises what it is given, or wants it."""

    def __init__(self, wrong: BaseException | Intent) -> None:
        self.steps = 0
        self._wrong = wrong

    def step(self, seen: Seen) -> Intent:
        self.steps += 1
        if self.steps == 1:
            return FORWARD
        if isinstance(self._wrong, Intent):
            return self._wrong
        raise self._wrong


CANNOT_BE_DRIVEN = [
    Intent(Twist2(math.nan, 0.0)),
    Intent(Twist2(0.0, -math.inf)),
    FORWARD._replace(speed=1e13),
    FORWARD._replace(cell=ShownCell(((0.0, math.nan),), 0.0, 0.0)),
]


@pytest.mark.parametrize(
    "wrong",
    [
        ZeroDivisionError("division"),
        SystemExit(3),
        asyncio.CancelledError(),
        BaseExceptionGroup("several", [SystemExit(3)]),
        *CANNOT_BE_DRIVEN,
    ],
)
def test_a_behaviour_that_fails_in_its_step_holds_and_is_not_stepped_again(wrong: BaseException | Intent) -> None:
    failures: list[BaseException] = []

    def on_failure(error: BaseException) -> str:
        failures.append(error)
        return "it has failed"

    loop, behaviour = ControlLoop("r1", ROBOT), Raising(wrong)
    loop.take_stop(T0 - 1.0, StopOrder(all=False, revision=5))
    loop.behave(behaviour, on_failure)
    assert commands(loop.update(T0, [(T0, fix())], [], NOTHING)) != [(0.0, 0.0)]
    out = loop.update(T0 + 0.05, [(T0 + 0.05, fix())], [], NOTHING)
    assert commands(out) == [(0.0, 0.0)]
    assert not of(channels.VELOCITY, out)
    for k in range(2, 12):
        loop.update(T0 + 0.05 * k, [(T0 + 0.05 * k, fix())], [], NOTHING)
        assert loop.reasons == ("it has failed",)
    assert behaviour.steps == 2
    (failure,) = failures
    assert failure is wrong or (isinstance(wrong, Intent) and isinstance(failure, ValueError))


def test_a_failure_that_nobody_takes_is_raised() -> None:
    loop = free(Raising(ZeroDivisionError("division")))
    with pytest.raises(ZeroDivisionError):
        loop.update(T0 + 0.05, [], [], NOTHING)


@pytest.mark.parametrize("wrong", CANNOT_BE_DRIVEN)
def test_an_intent_that_cannot_be_driven_leaves_the_one_before_in_force(wrong: Intent) -> None:
    loop = free()
    (before,) = commands(loop.want(T0, FORWARD))
    with pytest.raises(ValueError, match="expected"):
        loop.want(T0 + 0.1, wrong)
    assert commands(loop.update(T0 + 0.24, [(T0 + 0.24, fix())], [], NOTHING)) == [pytest.approx(before, abs=0.01)]
    assert commands(loop.update(T0 + 0.34, [(T0 + 0.34, fix())], [], NOTHING)) == [(0.0, 0.0)]


# ---- what is refused


@pytest.mark.parametrize(
    ("age", "used"), [(-0.001, False), (0.0, True), (0.1, True), (1.0, True), (1.01, False), (40.0, False)]
)
def test_a_fix_from_the_future_or_older_than_the_filters_history_is_refused(age: float, used: bool) -> None:
    loop, now = ControlLoop("r1", ROBOT), 4096.0
    for _ in range(2):
        loop.update(now, [(now - age, fix())], [], NOTHING)
    assert loop.tracking.fixes == (2 if used else 0)
    assert loop.tracking.refused == ({} if used else {"fix untimely": 2})


def test_a_fix_that_the_filter_refuses_is_counted_with_its_reason() -> None:
    loop = free()
    for k in (1, 2):
        elsewhere = PoseFix(x=9.0, y=9.0, theta=0.0, covariance=ACCURATE, camera="north", age=0.0)
        loop.update(T0 + 0.01 * k, [(T0 + 0.01 * k, elsewhere)], [], NOTHING)
    assert loop.tracking.refused == {"fix gated": 2}
    assert loop.tracking.fixes == 1


@pytest.mark.parametrize(
    ("age", "v", "omega", "used"),
    [
        (0.0, 0.1, 0.1, True),
        (1.0, 0.1, 0.1, True),
        (-0.001, 0.1, 0.1, False),
        (1.01, 0.1, 0.1, False),
        (0.0, 4.0 * ROBOT.v_max, 0.0, True),
        (0.0, -4.0 * ROBOT.v_max, 0.0, True),
        (0.0, 4.01 * ROBOT.v_max, 0.0, False),
        (0.0, -4.01 * ROBOT.v_max, 0.0, False),
        (0.0, 0.0, 4.0 * ROBOT.omega_max, True),
        (0.0, 0.0, 4.01 * ROBOT.omega_max, False),
        (0.0, 0.0, -4.01 * ROBOT.omega_max, False),
    ],
)
def test_an_odometry_that_cannot_be_of_now_or_of_these_wheels_is_refused(
    age: float, v: float, omega: float, used: bool
) -> None:
    loop, pose_filter = converged()
    now = 4096.0
    for _ in range(2):
        loop.update(now, [], [(now - age, v, omega)], NOTHING)
    assert pose_filter.twists == ([(now - age, v, omega)] * 2 if used else [])
    assert loop.tracking.refused == ({} if used else {"odometry": 2})


# ---- what is reported at once


def test_what_has_changed_stays_so_until_it_is_reported() -> None:
    loop = free(Forward())
    loop.changed = False
    stop = StopOrder(all=True, revision=6)
    loop.take_stop(T0, stop)
    loop.take_stop(T0, stop)
    loop.update(T0 + 0.01, [], [], NOTHING)
    assert loop.changed


@pytest.mark.parametrize("stopped", [False, True])
def test_a_newer_order_is_reported_at_once_even_where_it_stops_nobody(stopped: bool) -> None:
    """The base station learns of the newer revision, and an operator of the resume, before the next command."""
    loop = free()
    if stopped:
        loop.take_stop(T0, StopOrder(all=True, revision=5))
    loop.changed = False
    loop.take_stop(T0 + 0.01, StopOrder(all=False, revision=6))
    assert loop.changed


def test_an_order_that_changes_nothing_is_not_reported() -> None:
    loop = free(Forward())
    loop.changed = False
    loop.take_stop(T0 + 0.01, StopOrder(all=False, revision=5))
    assert not loop.changed


def test_a_pose_that_grows_older_is_not_reported_at_each_estimate() -> None:
    loop = free(Forward())
    loop.update(T0 + 0.4, [], [], NOTHING)
    assert loop.changed
    loop.changed = False
    loop.update(T0 + 0.8, [], [], NOTHING)
    assert loop.reasons == ("no pose for 0.8 s",)
    assert not loop.changed


# ---- the end


def test_after_the_last_command_there_is_none() -> None:
    loop = free(Forward())
    assert commands(loop.end(T0)) == [(0.0, 0.0)]
    assert loop.reasons == ("the agent is shutting down",)
    assert loop.update(T0 + 0.2, [(T0 + 0.2, fix())], [], NOTHING) == []
    assert loop.want(T0 + 0.2, FORWARD) == []
    assert loop.take_stop(T0 + 0.2, StopOrder(all=True, revision=9)) == []


# ---- what no camera and no wheels can have said


@pytest.mark.parametrize(("age", "taken"), [(0.0, True), (0.99, True), (1.01, False), (1e9, False), (-0.01, False)])
def test_a_fix_that_is_not_of_the_last_second_is_refused_and_counted(age: float, taken: bool) -> None:
    loop = ControlLoop("r1", ROBOT)
    loop.update(T0, [(T0 - age, fix())], [], NOTHING)
    assert loop.tracking.fixes == (1 if taken else 0)
    assert loop.tracking.refused == ({} if taken else {"fix untimely": 1})
    # Begun a thousand years ago, the filter would be busy for as long; begun in the future, it would wait for it.
    loop.update(T0 + 0.05, [(T0 + 0.05, fix())], [], NOTHING)
    assert loop.tracking.fixes == (2 if taken else 1)


@pytest.mark.parametrize(
    ("age", "v", "omega", "taken"),
    [
        (0.0, 1.9, 0.0, True),
        (0.99, -1.9, 5.9, True),
        (1.01, 0.1, 0.0, False),
        (-0.01, 0.1, 0.0, False),
        (1e9, 0.1, 0.0, False),
        (0.0, 2.1, 0.0, False),
        (0.0, 0.0, -6.1, False),
        (0.0, 1e11, 0.0, False),
    ],
)
def test_odometry_that_these_wheels_cannot_have_sent_is_refused_and_counted(
    age: float, v: float, omega: float, taken: bool
) -> None:
    loop = free()
    loop.update(T0 + 1.0, [], [(T0 + 1.0 - age, v, omega)], NOTHING)
    assert loop.tracking.refused == ({} if taken else {"odometry": 1})


def test_why_a_fix_was_not_used_is_counted() -> None:
    loop = free()
    far = PoseFix(x=9.0, y=9.0, theta=0.0, covariance=ACCURATE, camera="north", age=0.0)
    flat = PoseFix(x=0.0, y=0.0, theta=0.0, covariance=(0.0,) * 9, camera="north", age=0.0)
    loop.update(T0 + 0.1, [(T0 + 0.1, far), (T0 + 0.1, flat)], [], NOTHING)
    assert loop.tracking.refused == {"fix gated": 1, "fix bad covariance": 1}


def test_the_names_of_an_absurd_order_are_forgotten_at_the_next_newer_one() -> None:
    loop = free(Forward())
    loop.take_stop(T0, StopOrder(all=False, names=("r2",), revision=2**60))  # r2 obeys it, as any other
    assert loop.stopped_names == {"r2"}
    loop.take_stop(T0, StopOrder(all=False, revision=6))
    assert loop.stopped_names == frozenset()


def test_a_change_of_the_stopped_names_is_reported_at_once() -> None:
    loop = free(Forward())
    loop.changed = False
    loop.take_stop(T0, StopOrder(all=False, names=("r2",), revision=5))
    assert loop.changed
    loop.changed = False
    loop.take_stop(T0, StopOrder(all=False, names=("r2",), revision=5))
    assert not loop.changed
