"""One robot's control loop, event by event: how old what it drives by may be, on both sides of each limit."""

from __future__ import annotations

import pytest

from agents.control_loop import ControlLoop, Outgoing, Surroundings
from muro_zenoh import channels
from muro_zenoh.behaviours.interface import Behaviour, Intent, Seen, hold
from muro_zenoh.config import parse_scenario
from muro_zenoh.geometry import Twist2
from muro_zenoh.messages import PoseFix, StopOrder, VelocityCommand

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


@pytest.mark.parametrize(("age", "drives"), [(0.05, True), (0.39, True), (0.41, False), (0.54, False), (60.0, False)])
def test_a_pose_is_driven_by_for_0_4_s_from_its_capture_on(age: float, drives: bool) -> None:
    loop = free(Forward())
    (command,) = commands(loop.update(T0 + age, [], [], NOTHING))
    assert (command != (0.0, 0.0)) == drives
    assert loop.reasons == (() if drives else (f"no pose for {age:.1f} s",))


def test_the_age_of_a_pose_counts_from_its_capture_and_not_from_its_arrival() -> None:
    loop = free(Forward())
    captured = T0 + 0.01
    assert commands(loop.update(captured + 0.39, [(captured, fix(0.39))], [], NOTHING)) != [(0.0, 0.0)]
    loop = free(Forward())
    assert commands(loop.update(captured + 0.41, [(captured, fix(0.41))], [], NOTHING)) == [(0.0, 0.0)]


@pytest.mark.parametrize(("silent", "drives"), [(0.15, True), (0.24, True), (0.26, False), (0.35, False)])
def test_what_a_behaviour_wanted_is_driven_for_0_25_s(silent: float, drives: bool) -> None:
    loop = free()
    assert commands(loop.want(T0, FORWARD)) == [pytest.approx((0.2, 0.0), abs=0.01)]
    (command,) = commands(loop.update(T0 + silent, [(T0 + silent, fix())], [], NOTHING))
    assert (command != (0.0, 0.0)) == drives
    assert loop.reasons == (() if drives else ("no command from the behaviour",))


@pytest.mark.parametrize(("later", "repeated"), [(0.05, False), (0.099, False), (0.101, True), (0.29, True)])
def test_a_command_is_repeated_after_a_tenth_of_a_second_a_third_of_the_dead_mans_time(
    later: float, repeated: bool
) -> None:
    loop = free()  # a behaviour that is a task of its own, and says nothing
    loop.want(T0, FORWARD)
    assert len(commands(loop.update(T0 + later, [], [], NOTHING))) == repeated


def test_zero_is_repeated_where_there_was_never_a_pose() -> None:
    loop = ControlLoop("r1", ROBOT)
    assert commands(loop.update(T0, [], [], NOTHING)) == [(0.0, 0.0)]
    assert commands(loop.update(T0 + 0.09, [], [], NOTHING)) == []
    assert commands(loop.update(T0 + 0.11, [], [], NOTHING)) == [(0.0, 0.0)]
    assert loop.reasons[:2] == ("no stop state received yet", "no pose yet")


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


def test_a_hold_is_a_command_of_its_own() -> None:
    loop = free()
    loop.want(T0, FORWARD)
    loop.changed = False
    assert commands(loop.want(T0 + 0.001, hold("enough"))) == [(0.0, 0.0)]
    assert loop.reasons == ("enough",)
    assert loop.changed


def test_the_last_command_is_zero() -> None:
    loop = free(Forward())
    assert commands(loop.end(T0 + 0.01)) == [(0.0, 0.0)]


# ---- what no camera and no wheels can have said


@pytest.mark.parametrize(("age", "taken"), [(0.0, True), (0.99, True), (1.01, False), (1e9, False), (-0.01, False)])
def test_a_fix_that_is_not_of_the_last_second_is_refused_and_counted(age: float, taken: bool) -> None:
    loop = ControlLoop("r1", ROBOT)
    loop.update(T0, [(T0 - age, fix())], [], NOTHING)
    assert loop.fixes == (1 if taken else 0)
    assert loop.refused == ({} if taken else {"fix untimely": 1})
    # Begun a thousand years ago, the filter would be busy for as long; begun in the future, it would wait for it.
    loop.update(T0 + 0.05, [(T0 + 0.05, fix())], [], NOTHING)
    assert loop.fixes == (2 if taken else 1)


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
    assert loop.refused == ({} if taken else {"odometry": 1})


def test_why_a_fix_was_not_used_is_counted() -> None:
    loop = free()
    far = PoseFix(x=9.0, y=9.0, theta=0.0, covariance=ACCURATE, camera="north", age=0.0)
    flat = PoseFix(x=0.0, y=0.0, theta=0.0, covariance=(0.0,) * 9, camera="north", age=0.0)
    loop.update(T0 + 0.1, [(T0 + 0.1, far), (T0 + 0.1, flat)], [], NOTHING)
    assert loop.refused == {"fix gated": 1, "fix bad covariance": 1}


def test_the_names_of_an_absurd_order_are_not_remembered() -> None:
    loop = free(Forward())
    loop.take_stop(T0, StopOrder(all=False, names=("r2",), revision=2**60))
    loop.update(T0 + 0.1, [], [], NOTHING)
    assert loop.seen is not None
    assert loop.seen.stopped == frozenset()
