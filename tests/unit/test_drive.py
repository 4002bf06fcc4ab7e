"""From the twist that a behaviour wants to the command: what the separation filter is asked, and what goes out."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.control_loop import ControlLoop, Surroundings
from agents.drive import OFF, Drive
from muro_zenoh.behaviours.interface import Neighbour, Snapshot, hold
from muro_zenoh.config import RobotSettings, parse_scenario
from muro_zenoh.estimation.pose_filter import PoseEstimate
from muro_zenoh.geometry import STILL, State, Twist2
from muro_zenoh.messages import StopOrder
from muro_zenoh.safety.separation import Body, Separated
from tests.unit.test_control_loop import FORWARD, T0, Filter, Recorder, commands

ROBOT = RobotSettings(v_max=0.5, omega_max=1.5, a_max=0.4, brake=0.9, alpha_max=2.0)
LAB = parse_scenario({"robots": 3}, "lab.toml", name="lab")


class Spy:
    """A separation filter that records what it is asked, and gives what it is told to."""

    def __init__(self, gives: Twist2 | None = None, reason: str = "") -> None:
        self.asked: list[tuple[float, State, Twist2 | None, Snapshot | None, Any, Body]] = []
        self.gives, self.reason = gives, reason

    def step(
        self,
        now: float,
        state: State,
        desired: Twist2 | None,
        snapshot: Snapshot | None,
        target: tuple[float, float] | None,
        body: Body,
    ) -> Separated:
        self.asked.append((now, state, desired, snapshot, target, body))
        return Separated(self.gives or desired or STILL, self.reason)


def estimate(s_v: float = 1.0, s_omega: float = 1.0) -> PoseEstimate:
    return PoseEstimate(1.0, 2.0, 0.5, 0.1, -0.2, (0.0,) * 9, s_v, s_omega, 0.0, 0.0, T0)


def drive(spy: Spy | None) -> Drive:
    return Drive(ROBOT, spy)  # type: ignore[arg-type]


scales = st.floats(0.5, 1.5)
speeds = st.floats(-9.0, 9.0)


@given(scales, scales, speeds, speeds)
def test_the_command_is_the_one_that_the_filter_passed(s_v: float, s_omega: float, v: float, omega: float) -> None:
    """What was clamped after it would drive another path than the one that it looked at."""
    spy = Spy()
    command = drive(spy).command(T0, estimate(s_v, s_omega), Twist2(v, omega), None, None)
    ((_, _, desired, _, _, body),) = spy.asked
    assert desired is not None
    assert (s_v * command.v, s_omega * command.omega) == pytest.approx(desired, abs=1e-12)
    assert abs(desired.v) <= body.v_max
    assert abs(desired.omega) <= body.omega_max


@given(scales, scales, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_whatever_the_filter_chooses_within_its_limits_goes_out_unclamped(
    s_v: float, s_omega: float, v: float, omega: float
) -> None:
    spy = Spy()
    it = drive(spy)
    it.command(T0, estimate(s_v, s_omega), STILL, None, None)
    body = spy.asked[0][-1]
    spy.gives = Twist2(v * body.v_max, omega * body.omega_max)
    command = it.command(T0, estimate(s_v, s_omega), STILL, None, None)
    assert (s_v * command.v, s_omega * command.omega) == pytest.approx(spy.gives, abs=1e-12)


def test_the_filter_knows_how_this_robots_wheels_really_drive_and_brake() -> None:
    spy, snapshot = Spy(), Snapshot((), 7.0, 3, 0.1)
    drive(spy).command(T0, estimate(0.8, 1.25), Twist2(0.2, 0.3), snapshot, (3.0, 4.0))
    body = Body(ROBOT.radius, 0.4, 1.875, 0.32, 2.5, 0.72, ROBOT.lag)
    ((now, state, desired, seen, target, asked),) = spy.asked
    assert (now, state, desired, seen, target) == (
        T0, State(1.0, 2.0, 0.5, 0.1, -0.2), Twist2(0.2, 0.3), snapshot, (3.0, 4.0),
    )  # fmt: skip
    assert asked == pytest.approx(body)


def test_a_robot_that_must_not_move_is_not_moved_by_the_filter() -> None:
    spy = Spy(gives=Twist2(0.3, 0.3), reason="makes room for r2")
    assert drive(spy).command(T0, estimate(), None, None, None) == STILL
    assert len(spy.asked) == 1  # it still sees where the others are


def test_what_the_filter_changes_is_noted_and_counted() -> None:
    spy = Spy(Twist2(0.1, 0.0), "keeps clear of r3")
    it = drive(spy)
    for _ in range(3):
        assert it.command(T0, estimate(0.8), Twist2(0.3, 0.0), None, None) == Twist2(pytest.approx(0.125), 0.0)
    spy.gives, spy.reason = None, ""
    it.command(T0, estimate(), Twist2(0.3, 0.0), None, None)
    assert it.changes == {"keeps clear of r3": 3}
    assert it.take_note() == "keeps clear of r3"  # since the last report
    assert it.take_note() == ""


def test_ever_new_reasons_do_not_fill_the_memory() -> None:
    spy = Spy()
    it = drive(spy)
    for k in range(1000):
        spy.reason = f"keeps clear of x{k}"
        it.command(T0, estimate(), STILL, None, None)
    assert len(it.changes) == 256
    spy.reason = "keeps clear of x1"
    it.command(T0, estimate(), STILL, None, None)
    assert it.changes[spy.reason] == 2


def test_without_the_filter_all_is_driven_and_said_so() -> None:
    it = drive(None)
    assert not it.needs_positions
    assert it.command(T0, estimate(0.8, 1.25), Twist2(0.2, 0.5), None, None) == Twist2(0.25, pytest.approx(0.4))
    assert it.take_note() == it.take_note() == OFF


# ---- in the control loop


def loop_of(spy: Spy) -> ControlLoop:
    loop = ControlLoop("r1", ROBOT, separation=spy)  # type: ignore[arg-type]
    loop.tracking.filter = Filter()  # type: ignore[assignment]
    loop.take_stop(T0, StopOrder(all=False, revision=5))
    return loop


def around(age: float) -> Surroundings:
    """Positions as the listener shows them: none when they are too old."""
    return Surroundings(snapshot=Snapshot((), 7.0, 3, age) if age <= 0.5 else None, snapshot_age=age)


@pytest.mark.parametrize(
    ("age", "reasons"),
    [
        (0.0, ()),
        (0.5, ()),
        (0.51, ("no positions of all robots for 0.5 s",)),
        (3.0, ("no positions of all robots for 3.0 s",)),
        (math.inf, ("no positions of all robots yet: waiting for the base station",)),
    ],
)
def test_a_robot_drives_only_while_it_knows_where_the_others_are(age: float, reasons: tuple[str, ...]) -> None:
    loop = loop_of(Spy())
    loop.behave(Recorder())
    (command,) = commands(loop.update(T0, [], [], around(age)))
    assert (command == (0.0, 0.0)) == bool(reasons)
    assert loop.reasons == reasons


def test_a_behaviour_that_is_a_task_of_its_own_is_kept_clear_too_with_the_positions_ages_of_then() -> None:
    spy = Spy(Twist2(0.1, 0.0), "keeps clear of r3")
    loop = loop_of(spy)
    loop.update(T0, [], [], around(0.46))
    assert commands(loop.want(T0 + 0.03, FORWARD._replace(target=(1.0, 1.0)))) == [(pytest.approx(0.125), 0.0)]
    now, _, desired, snapshot, target, _ = spy.asked[-1]
    assert (now, desired, target) == (T0 + 0.03, FORWARD.twist, (1.0, 1.0))
    assert snapshot is not None
    assert snapshot.age == pytest.approx(0.49)
    assert commands(loop.want(T0 + 0.05, FORWARD)) == [(0.0, 0.0)]
    assert loop.reasons == ("no positions of all robots for 0.5 s",)


def test_between_two_estimates_the_filter_is_asked_from_where_the_robot_is_then() -> None:
    spy = Spy()
    loop = loop_of(spy)
    loop.tracking.filter.at = lambda t: estimate()._replace(x=0.5 * (t - T0), t_fix=t)  # type: ignore[method-assign]
    loop.update(T0, [], [], around(0.0))
    loop.want(T0 + 0.04, FORWARD)
    assert spy.asked[-1][1].x == pytest.approx(0.02)


@pytest.mark.parametrize("how", ["hold", "stop", "end"])
def test_a_robot_that_holds_is_stopped_or_leaves_is_never_moved(how: str) -> None:
    loop = loop_of(Spy(Twist2(0.3, 0.3), "makes room for r2"))
    loop.behave(Recorder())
    assert commands(loop.update(T0, [], [], around(0.0))) != [(0.0, 0.0)]
    if how == "hold":
        loop.behave(Recorder(hold("enough")))
        out = loop.update(T0 + 0.05, [], [], around(0.0))
    elif how == "stop":
        out = loop.take_stop(T0 + 0.05, StopOrder(all=True, revision=6))
    else:
        out = loop.end(T0 + 0.05)
    assert commands(out) == [(0.0, 0.0)]


def test_a_real_filter_lets_no_robot_drive_into_another() -> None:
    loop = ControlLoop("r1", LAB.robot["r1"], LAB.timeouts, LAB.separation_of("r1"))
    loop.tracking.filter = Filter()  # type: ignore[assignment]  # at (1, 2), outside the arena, heading 0.5 rad
    loop.tracking.filter.at = lambda t: estimate()._replace(x=0.0, y=0.0, theta=0.0, t_fix=t)  # type: ignore[method-assign]
    clear, full = [], []
    loop.take_stop(T0, StopOrder(all=False, revision=5))
    loop.behave(Recorder())
    rows = (Neighbour("r1", 0.0, 0.0, 0.0, 0.1, 0.0, 0.0), Neighbour("r2", 0.4, 0.0, 0.0, 0.0, 0.0, 0.0))
    for k in range(60):  # alone at first
        seen = Snapshot(rows if k >= 40 else rows[:1], 7.0 + 0.05 * k, 3, 0.0)
        (command,) = commands(loop.update(T0 + 0.05 * k, [], [], Surroundings(snapshot=seen, snapshot_age=0.0)))
        (full if k >= 40 else clear).append(command[0])
    assert clear[-1] == pytest.approx(0.2)
    assert max(full) < 0.05
    assert loop.reasons == ()
    assert "r2" in loop.drive.take_note()


def test_the_filter_can_be_switched_off_for_an_experiment() -> None:
    assert LAB.separation_of("r1") is not None
    off = parse_scenario({"robots": 3, "separation": {"enabled": False}}, "lab.toml", name="lab")
    assert off.separation_of("r1") is None
