"""A fleet in memory with faults: each fault has its effect, there is none without it, and a seed repeats the run."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from muro_zenoh import channels
from muro_zenoh.checking.fleet import VirtualFleet
from muro_zenoh.checking.run import run_fleet
from muro_zenoh.checking.trace import Trace
from muro_zenoh.checking.trial import run_trial
from muro_zenoh.checking.world import World
from muro_zenoh.config import Scenario, parse_scenario
from muro_zenoh.messages import Estimate
from tests.support.waiting import seconds

ROOT = Path(__file__).parents[2]


def lab(
    *faults: dict[str, Any], robots: int = 2, duration: float = 6.0, behaviour: str = "circle", **more: object
) -> Scenario:
    """Robots that do not look at each other, so that what changes is the fault's work."""
    table = {
        "robots": robots,
        "duration": duration,
        "behaviour": {"name": behaviour},
        "separation": {"enabled": False},
        "fault": list(faults),
    }
    return parse_scenario({**table, **more}, "lab.toml", name="lab")


FAULTS: list[dict[str, Any]] = [
    {"kind": "delay", "target": "r1", "delay": 0.1},
    {"kind": "jitter", "target": "basestation", "jitter": 0.05},
    {"kind": "loss", "target": "r2/agent", "fraction": 0.2},
    {"kind": "duplicate", "target": "router", "fraction": 0.2},
    {"kind": "reorder", "target": "r1", "fraction": 0.2},
    {"kind": "partition", "target": "r1"},
    {"kind": "stall", "target": "camera"},
    {"kind": "crash", "target": "r1/agent"},
    {"kind": "restart", "target": "basestation"},
    {"kind": "restart", "target": "router"},
    {"kind": "freeze", "target": "r2/base"},
    {"kind": "freeze", "target": "router"},
    {"kind": "camera_dropout", "target": "r2"},
    {"kind": "clock_offset", "target": "r1", "offset": 3.0},
    {"kind": "clock_step", "target": "basestation", "step": -1.0},
    {"kind": "halt", "target": "r1"},
    {"kind": "carry", "target": "r2", "x": 0.3},
    {"kind": "lie", "target": "r1", "x": 0.4},
    {"kind": "foreign_driver", "target": "r1"},
    {"kind": "foreign_driver", "target": "r1", "by": "wheels"},
]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: f"{fault['kind']} {fault['target']}")
def test_every_fault_begins_does_something_and_ends(fault: dict[str, Any]) -> None:
    [effect] = run_fleet(lab({**fault, "at": 2.0, "until": 3.0}), 1).effects
    assert (effect.begun, effect.ended) == pytest.approx((2.0, 3.0))
    assert effect.occurred, str(effect)


@pytest.mark.parametrize("target", ["router", "basestation", "r1/agent"])
def test_a_kill_that_lasts_to_the_end_of_the_run_has_its_effect_too(target: str) -> None:
    trace = run_fleet(lab({"kind": "crash", "target": target, "at": 4.0}), 1)
    assert trace.effects[0].occurred
    assert not np.isfinite(trace.effects[0].ended)
    assert not commanded(trace, "r1", 5.9)


@pytest.fixture(scope="module")
def unharmed() -> Trace:
    """A run without faults."""
    return run_fleet(lab(), 1)


def moment(trace: Trace, time: float) -> int:
    """The step at a time."""
    return int(np.searchsorted(trace.times, time + 1e-9)) - 1


def commanded(trace: Trace, name: str, time: float) -> bool:
    """Whether the wheels of a robot are commanded to turn."""
    return bool(trace.commands[moment(trace, time), trace.robots.index(name)].any())


def place(trace: Trace, name: str, time: float) -> tuple[float, float, float]:
    """Where a robot is."""
    x, y, theta = trace.poses[moment(trace, time), trace.robots.index(name)].tolist()
    return x, y, theta


def ages(trace: Trace, name: str, time: float) -> tuple[float, float]:
    """The age of the newest pose and of the newest command that have reached a robot [s]."""
    step, known = moment(trace, time), trace.informed[name]
    now = trace.times[step]
    return float(now - known.pose[step]), float(now - known.command[step])


def test_without_faults_nothing_happens(unharmed: Trace) -> None:
    assert unharmed.effects == ()
    assert unharmed.ends == ()
    for name in unharmed.robots:
        for time in np.arange(1.0, 6.0, 0.1):
            assert commanded(unharmed, name, time)
            pose, command = ages(unharmed, name, time)
            assert pose < 0.11
            assert command < 0.06
    assert {report.state for report in unharmed.reports if report.time > 1.0} <= {"circle", "running"}


@pytest.mark.parametrize(("kind", "sends_zero"), [("crash", False), ("restart", True)])
def test_a_killed_agent_sends_no_zero_and_one_that_is_asked_to_end_does(kind: str, sends_zero: bool) -> None:
    trace = run_fleet(lab({"kind": kind, "target": "r1/agent", "at": 3.02, "until": 4.0}), 1)
    _, command = ages(trace, "r1", 3.9)
    assert (command < 0.885) is sends_zero  # sent at 3.02; the last fix was before 3.01
    assert commanded(trace, "r1", 3.2) is not sends_zero
    assert not commanded(trace, "r1", 3.35), "the dead-man"
    assert commanded(trace, "r1", 4.5), "started anew"
    assert commanded(trace, "r2", 3.5), "the other one drives on"


@pytest.mark.parametrize("kind", ["crash", "freeze"])
def test_wheels_without_their_base_are_stopped_by_their_own_watchdog(kind: str) -> None:
    scenario = lab({"kind": kind, "target": "r1/base", "at": 3.02, "until": 4.5})
    trace, watchdog = run_fleet(scenario, 1), scenario.timeouts.command
    assert commanded(trace, "r1", 3.0 + watchdog - 0.03), "a killed base sends its wheels no zero either"
    assert not commanded(trace, "r1", 3.0 + watchdog + 0.03)
    assert commanded(trace, "r1", 5.0)


def test_a_frozen_agent_sends_nothing_and_executes_nothing_old() -> None:
    trace = run_fleet(lab({"kind": "freeze", "target": "r1/agent", "at": 3.0, "until": 4.0}), 1)
    assert ages(trace, "r1", 3.99) == pytest.approx((1.04, 0.99), abs=0.06)
    assert not commanded(trace, "r1", 3.9)
    assert commanded(trace, "r1", 4.2)
    pose, command = ages(trace, "r1", 4.2)
    assert pose < 0.11
    assert command < 0.06


@pytest.mark.parametrize("target", ["r1", "router", "basestation"])
def test_a_partition_lets_no_pose_through_but_the_wheels_hear_their_agent(target: str) -> None:
    trace = run_fleet(lab({"kind": "partition", "target": target, "at": 3.0, "until": 4.0}), 1)
    pose, command = ages(trace, "r1", 3.99)
    assert pose > 1.0
    assert command < 0.15
    assert commanded(trace, "r1", 3.1)
    assert not commanded(trace, "r1", 3.5)
    assert commanded(trace, "r1", 4.3)
    assert commanded(trace, "r2", 3.5) is (target == "r1")


def test_a_delay_ages_the_poses() -> None:
    trace = run_fleet(lab({"kind": "delay", "target": "r1", "at": 3.0, "until": 5.0, "delay": 0.08}), 1)
    assert ages(trace, "r1", 4.0)[0] > 0.12
    assert ages(trace, "r2", 4.0)[0] < 0.11


@pytest.mark.parametrize(
    ("target", "blind"), [("camera", {"r1", "r2"}), ("camera/north", {"r1", "r2"}), ("r2", {"r2"})]
)
def test_a_robot_that_no_camera_sees_stands_still(target: str, blind: set[str]) -> None:
    fault = {"kind": "camera_dropout", "target": target, "at": 3.0, "until": 4.0}
    trace = run_fleet(lab(fault, camera={"north": {}}), 1)
    for name in trace.robots:
        assert commanded(trace, name, 3.8) is (name not in blind)
        assert (ages(trace, name, 3.99)[0] > 0.9) is (name in blind)
        assert commanded(trace, name, 4.5)


def test_jammed_wheels_stand_still_whatever_they_are_commanded() -> None:
    trace = run_fleet(lab({"kind": "halt", "target": "r1", "at": 3.0, "until": 4.0}), 1)
    assert place(trace, "r1", 3.02) == place(trace, "r1", 4.0)
    assert commanded(trace, "r1", 3.5)
    assert place(trace, "r1", 5.0) != place(trace, "r1", 4.0)


def test_a_robot_is_carried_as_far_as_the_fault_says() -> None:
    trace = run_fleet(lab({"kind": "carry", "target": "r2", "at": 3.0, "duration": 1.0, "x": -0.5, "theta": 1.0}), 1)
    begin, middle, end = (place(trace, "r2", time) for time in (3.0, 3.5, 4.0))
    assert np.subtract(end, begin) == pytest.approx((-0.5, 0.0, 1.0), abs=0.02)
    assert np.subtract(middle, begin) == pytest.approx((-0.25, 0.0, 0.5), abs=0.02)
    assert trace.twists[moment(trace, 3.5), 1].tolist() == pytest.approx([0.5, 1.0])
    assert str(trace.effects[0]) == "carry of r2 at 3 s: 0.5 m carried"


def estimates(*faults: dict[str, Any]) -> list[Estimate]:
    """What others hear of r1's estimate, at 50 Hz."""
    heard: list[Estimate] = []

    async def listen(fleet: VirtualFleet) -> None:
        async for received in fleet.operator.every(channels.ESTIMATE, "r1"):
            heard.append(received.message)

    run_fleet(lab(*faults), 1, listen)
    return heard


def test_a_lie_is_what_others_hear_and_not_what_the_robot_drives_by() -> None:
    lie = {"kind": "lie", "target": "r1", "at": 3.02, "until": 4.02, "x": 0.4, "v": 0.1}
    truth = {**lie, "x": 0.0, "v": 0.0}  # no fault at all would put its base into the same process as the others'
    right, wrong = estimates(truth), estimates(lie)
    assert len(right) == len(wrong)
    for one, other in zip(right, wrong, strict=True):
        lies = 3.02 < one.stamp - 1.7e9 < 4.02
        assert other.x - one.x == pytest.approx(0.4 if lies else 0.0, abs=1e-9)
        assert other.v - one.v == pytest.approx(0.1 if lies else 0.0, abs=1e-9)
    assert run_fleet(lab(lie), 1).poses.tobytes() == run_fleet(lab(truth), 1).poses.tobytes()


def test_an_estimate_that_is_stuck_has_new_stamps() -> None:
    said = estimates({"kind": "lie", "target": "r1", "at": 3.02, "until": 4.02, "stuck": True})
    stuck = [estimate for estimate in said if 3.02 < estimate.stamp - 1.7e9 < 4.02]
    assert len({estimate.stamp for estimate in stuck}) == len(stuck) > 15
    assert len({(estimate.x, estimate.y, estimate.theta) for estimate in stuck}) == 1


def test_a_foreign_program_on_the_bus_and_the_agent_stop_each_other() -> None:
    trace = run_fleet(lab({"kind": "foreign_driver", "target": "r1", "at": 3.0, "until": 4.0}), 1)
    assert not commanded(trace, "r1", 3.5), "two processes command these wheels"
    assert commanded(trace, "r1", 4.5)


@pytest.mark.parametrize("step", [2.0, -2.0])
def test_a_foreign_program_is_named_soon_after_the_base_stations_clock_was_set(step: float) -> None:
    """It learns of it from the bases' reports, which are few, and are late only until clocks are compared again."""
    set_clock = {"kind": "clock_step", "target": "basestation", "at": 3.0, "step": step}
    foreign = {"kind": "foreign_driver", "target": "r1", "at": 6.0, "until": 7.5}
    trace = run_fleet(lab(set_clock, foreign, duration=8.0), 1)
    named = [report.time for report in trace.reports if any("the wheels of r1" in reason for reason in report.reasons)]
    assert named
    assert 6.0 < named[0] < 7.0


@pytest.mark.parametrize("at", [3.0, 3.25, 3.5, 3.75])
def test_a_robot_that_is_carried_off_faster_than_one_can_drive_is_named_at_once(at: float) -> None:
    trace = run_fleet(lab({"kind": "carry", "target": "r1", "at": at, "duration": 0.3, "x": 0.6}, duration=5.5), 1)
    named = [report.time for report in trace.reports if any("sees r1" in reason for reason in report.reasons)]
    assert named
    assert at < named[0] < at + 0.5


@pytest.mark.parametrize("step", [-30.0, 30.0])
def test_robots_drive_on_after_the_base_stations_clock_was_set(step: float) -> None:
    trace = run_fleet(lab({"kind": "clock_step", "target": "basestation", "at": 3.0, "step": step}, duration=7.0), 1)
    assert commanded(trace, "r1", 6.5)
    assert commanded(trace, "r2", 6.5)


def test_late_pictures_are_late_to_a_base_station_that_was_restarted_meanwhile() -> None:
    """The camera's question was under way to the one before, so it compares clocks with this one only seconds later."""
    slow = {"kind": "delay", "target": "camera/north", "at": 3.0, "until": 11.0, "delay": 0.7}
    restart = {"kind": "restart", "target": "basestation", "at": 4.0, "until": 4.4}
    _, result = run_trial(lab(slow, restart, duration=10.0, camera={"north": {}}), 1)
    assert not result.breaches


def test_a_joystick_drives_past_our_base() -> None:
    joystick = {"kind": "foreign_driver", "target": "r1", "at": 3.0, "until": 4.0, "by": "wheels", "v": -0.2}
    trace = run_fleet(lab(joystick), 1)
    assert (trace.twists[moment(trace, 3.9), 0, 0]) < -0.1
    assert (trace.twists[moment(trace, 4.9), 0, 0]) > 0.1


@pytest.mark.parametrize(
    ("fault", "during", "after"),
    [
        ({"kind": "clock_offset", "offset": 3.0}, 3.0, 0.0),
        ({"kind": "clock_offset", "offset": 1.0, "drift": 0.01}, 1.01, 0.0),
        ({"kind": "clock_step", "step": -2.0}, -2.0, -2.0),
    ],
    ids=["offset", "drift", "step"],
)
def test_a_wrong_clock_is_wrong_by_so_much(fault: dict[str, Any], during: float, after: float) -> None:
    errors: list[float] = []

    async def look(fleet: VirtualFleet) -> None:
        for time in (1.0, 3.0, 5.0):
            await asyncio.sleep(time - fleet.elapsed)
            clocks = (fleet.processes["r1/agent"].clock, fleet.base_of("r1").clock)
            [error] = {round(clock.now() - fleet.clock.now(), 5) for clock in clocks}
            errors.append(error)
            assert fleet.base_of("r2").clock.now() == fleet.clock.now()

    run_fleet(lab({**fault, "target": "r1", "at": 2.0, "until": 4.0}), 1, look)
    assert errors == pytest.approx([0.0, during, after], abs=1e-4)


@pytest.mark.parametrize(
    ("process", "also"),
    [
        ("r1/base", {"kind": "crash", "target": "r1/agent", "at": 2.99}),
        ("r1/agent", {"kind": "camera_dropout", "target": "r1", "at": 3.02}),
        ("r1/agent", {"kind": "partition", "target": "r1/agent", "at": 3.02}),
    ],
)
def test_a_clock_that_is_set_back_makes_nothing_young(process: str, also: dict[str, Any]) -> None:
    faults = ({"kind": "clock_step", "target": process, "at": 3.0, "step": -2.0}, {**also, "duration": 4.0})
    trace = run_fleet(lab(*faults, duration=7.0), 1)
    assert commanded(trace, "r1", 2.9)
    assert not any(commanded(trace, "r1", 3.7 + 0.1 * step) for step in range(32))


def test_two_faults_of_one_kind_at_once_end_one_after_the_other() -> None:
    kinds: list[dict[str, Any]] = [
        {"kind": "crash", "target": "r1/agent"},
        {"kind": "halt", "target": "r1"},
        {"kind": "carry", "target": "r1"},
        {"kind": "camera_dropout", "target": "r1"},
        {"kind": "lie", "target": "r1"},
        {"kind": "foreign_driver", "target": "r1", "by": "wheels"},
        {"kind": "foreign_driver", "target": "r1"},
        {"kind": "freeze", "target": "basestation"},
        {"kind": "partition", "target": "r2"},
    ]
    faults = [{**kind, "at": at, "until": at + 1.0} for kind in kinds for at in (2.0, 2.5)]
    trace = run_fleet(lab(*faults), 1)
    assert all(np.isfinite(effect.ended) for effect in trace.effects)
    assert trace.ends == ()
    assert commanded(trace, "r1", 5.5)


def test_a_process_that_ends_by_itself_is_noted_and_started_anew() -> None:
    async def break_it(fleet: VirtualFleet) -> None:
        await asyncio.sleep(2.0)
        agent = fleet.processes["r1/agent"].task
        assert agent is not None
        agent.cancel()

    trace = run_fleet(lab(), 1, break_it)
    assert [(end.name, round(end.time, 2)) for end in trace.ends] == [("r1/agent", 2.0)]
    assert not commanded(trace, "r1", 2.4)
    assert commanded(trace, "r1", 3.0)


def test_what_a_fault_keeps_down_no_supervisor_starts() -> None:
    async def break_it(fleet: VirtualFleet) -> None:
        await asyncio.sleep(2.0)
        agent = fleet.processes["r1/agent"].task
        assert agent is not None
        agent.cancel()  # it would be started anew at 2.5

    trace = run_fleet(lab({"kind": "crash", "target": "r1/agent", "at": 2.2, "until": 4.0}), 1, break_it)
    assert not trace.effects[0].occurred
    assert not commanded(trace, "r1", 3.9)
    assert commanded(trace, "r1", 4.5)


def test_a_router_that_is_started_anew_at_once_is_found_again_after_a_second() -> None:
    trace = run_fleet(lab({"kind": "restart", "target": "router", "at": 3.0}), 1)
    assert ages(trace, "r1", 3.95)[0] > 0.9
    assert ages(trace, "r1", 4.2)[0] < 0.2
    assert trace.effects[0].occurred


def test_a_fault_that_cannot_be_applied_is_an_error_and_not_a_line_in_a_log(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise LookupError("no such thing")

    monkeypatch.setattr(World, "carry", fail)
    with pytest.raises(ExceptionGroup) as error:
        run_fleet(lab({"kind": "carry", "target": "r1", "at": 1.0, "duration": 1.0}), 1)
    assert error.group_contains(LookupError, match="no such thing")


def test_what_the_script_raises_ends_the_run() -> None:
    async def fail(fleet: VirtualFleet) -> None:
        raise LookupError("no such thing")

    with pytest.raises(ExceptionGroup) as error:
        run_fleet(lab(), 1, fail)
    assert error.group_contains(LookupError)


# ---- the same seed


_DIGEST = """
from muro_zenoh.checking.run import run_fleet
from tests.fleets.test_virtual_fleet import FAULTS, lab
faults = [{**fault, "at": 1.0 + 0.2 * number, "duration": 0.5} for number, fault in enumerate(FAULTS)]
print(run_fleet(lab(*faults, behaviour="pursuit", robots=4, separation={}), 3).digest())
"""


def test_the_same_seed_gives_the_same_bits_in_another_process() -> None:
    digests = [
        subprocess.run(
            [sys.executable, "-c", _DIGEST],
            cwd=ROOT,
            env={**os.environ, "PYTHONHASHSEED": number},
            capture_output=True,
            text=True,
            timeout=seconds(60),
            check=True,
        ).stdout
        for number in ("1", "2")
    ]
    assert digests[0] == digests[1]


def test_a_robot_that_nobody_hears_stands_until_it_is_heard_again() -> None:
    """Only its link outward is cut: it still has poses and snapshots, but nobody knows how fast it drives."""
    table = {
        "robots": 2,
        "duration": 9.0,
        "camera": {"north": {}},
        "behaviour": {"name": "circle"},
        "fault": [{"kind": "partition", "target": "r1", "direction": "out", "at": 3.0, "duration": 3.0}],
    }
    record, result = run_trial(parse_scenario(table, "lab.toml", name="lab"), 1)
    assert result.breaches == ()

    def drives(robot: int, begin: float, end: float) -> bool:
        rows = (record.time >= begin) & (record.time < end)
        return bool(np.any(record.command[rows, robot] != 0.0, axis=1).all())

    def stands(robot: int, begin: float, end: float) -> bool:
        rows = (record.time >= begin) & (record.time < end)
        return not record.command[rows, robot].any()

    assert drives(0, 2.5, 3.5)
    assert stands(0, 3.9, 6.0)
    assert drives(1, 2.5, 9.0)
    assert drives(0, 7.5, 9.0)
