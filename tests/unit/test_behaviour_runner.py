"""Running behaviours: how they are changed, how they end, and how they fail."""

from __future__ import annotations

import asyncio
import itertools
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from agents.control_loop import ControlLoop, Surroundings
from muro_zenoh import channels
from muro_zenoh.behaviours.dubins import GoalRide
from muro_zenoh.behaviours.interface import Intent, Seen
from muro_zenoh.channels import Role
from muro_zenoh.config import RobotSettings
from muro_zenoh.geometry import Twist2
from muro_zenoh.messages import Goal, Resume, SetBehaviour, SetCircle, Stop, StopOrder, VelocityCommand
from muro_zenoh.runtime.virtual_time import run_virtually
from tests.support.memory_fleet import memory_fleet, scenario

STUBBORN = """
import asyncio

async def deaf(robot):
    while True:
        try:
            await asyncio.sleep(0.05)
        except asyncio.CancelledError:
            if OVER.is_set():
                raise
        robot.drive(0.2, 0.0)

async def forgetful(robot):
    async def drive_on():
        while not OVER.is_set():
            robot.drive(0.2, 0.0)
            robot.velocity(0.2)
            await asyncio.sleep(0.05)
    KEPT.append(asyncio.create_task(drive_on()))
    await asyncio.sleep(600)

KEPT = []
OVER = asyncio.Event()
"""

LEFTOVER = """
import asyncio

async def drive_on(robot):
    while not OVER.is_set():
        robot.drive(0.2, 0.0)
        await asyncio.sleep(0.05)

async def set_out_again(robot):
    while not OVER.is_set():
        robot.goal(0.5, 0.5)
        await asyncio.sleep(0.5)

async def fails(robot):
    await leave_behind(drive_on, robot)
    raise RuntimeError("out of water")

async def returns(robot):
    await leave_behind(drive_on, robot)

async def cancelled(robot):
    await leave_behind(drive_on, robot)
    raise asyncio.CancelledError

async def fails_with_a_goal(robot):
    await leave_behind(set_out_again, robot)
    raise RuntimeError("out of water")

async def leave_behind(function, robot):
    async for _ in robot.estimates():
        break
    KEPT.append(asyncio.create_task(function(robot)))
    await asyncio.sleep(1.0)

KEPT = []
OVER = asyncio.Event()
"""


FAILING = """
import asyncio

async def swim(robot):
    async for _ in robot.estimates():
        robot.drive(0.1, 0.0)
        if robot.state.x > -99.0:
            dive()

def dive():
    raise RuntimeError("out of\\nwater")

async def group(robot):
    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(asyncio.sleep(600))
        tasks.create_task(swim(robot))

async def leave(robot):
    raise SystemExit(3)

async def brief(robot):
    robot.drive(0.2, 0.0)

async def cancelled(robot):
    raise asyncio.CancelledError

def called(robot):
    return 1.0 / 0.0

def wrong(robot):
    return "straight on"

def exits(robot):
    raise SystemExit(3)

STARTS = []

async def counts(robot):
    STARTS.append(robot.now)
    raise ValueError("again")

def cancels(robot):
    raise asyncio.CancelledError
"""

NUMBERS = """
import asyncio
import numpy as np

CALLS = {
    "double": lambda robot: robot.drive(np.float64(0.1), np.float64(0.0)),
    "single": lambda robot: robot.drive(np.float32(0.1), np.float32(0.0)),
    "integers": lambda robot: robot.drive(np.int64(1), 0),
    "speed": lambda robot: robot.velocity(np.float32(0.2)),
    "reason": lambda robot: robot.hold(7),
    "none": lambda robot: robot.drive(None, 0.0),
    "text": lambda robot: robot.drive("0.1", 0.0),
    "nan": lambda robot: robot.drive(0.1, float("nan")),
    "infinite": lambda robot: robot.drive(np.inf, 0.0),
    "huge": lambda robot: robot.drive(10**400, 0.0),
    "speed_nan": lambda robot: robot.velocity(float("nan")),
    "speed_huge": lambda robot: robot.velocity(1e13),
    "goal_nan": lambda robot: robot.goal(float("nan"), 0.0),
    "goal_text": lambda robot: robot.goal(0.5, 0.5, "north"),
}

RETURNS = {
    "pair_double": lambda: np.array([0.1, 0.0]),
    "pair_single": lambda: np.array([0.1, 0.0], dtype=np.float32),
    "pair_text": lambda: ("0.1", 0.0),
    "pair_nan": lambda: (float("nan"), 0.0),
    "pair_huge": lambda: (0.1, -(10**400)),
    "three": lambda: (0.1, 0.2, 0.3),
    "one": lambda: 0.1,
}

def plain(robot):
    call = robot.parameters["call"]
    if call in RETURNS:
        return RETURNS[call]()
    CALLS[call](robot)

async def waiting(robot):
    async for _ in robot.estimates():
        CALLS[robot.parameters["call"]](robot)

async def careless(robot):
    count = 0
    async for _ in robot.estimates():
        count += 1
        try:
            if count < 20:
                robot.drive(0.1, 0.0)
                continue
            CALLS[robot.parameters["call"]](robot)
        except ValueError:
            pass

async def sets_out(robot):
    async for _ in robot.estimates():
        break
    robot.goal(np.float32(0.5), np.float32(0.5), np.float32(0.0))
    await asyncio.sleep(600)

def sets_out_plain(robot):
    if not robot.parameters["call"]:
        return None
    if not STARTED:
        STARTED.append(robot.goal(np.float32(0.5), np.float32(0.5), np.float32(0.0)))

STARTED = []
"""

RUNNING = """
STARTS = []

async def go(robot):
    STARTS.append(robot.now)
    async for _ in robot.estimates():
        robot.drive(0.1, 0.0)
"""


@pytest.fixture
def users_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, str], None]:
    """Puts a module of a user's own where behaviours are looked for."""

    def put(name: str, text: str) -> None:
        (tmp_path / f"{name}.py").write_text(text)
        monkeypatch.delitem(sys.modules, name, raising=False)

    monkeypatch.syspath_prepend(str(tmp_path))
    return put


@pytest.mark.parametrize("behaviour", ["deaf", "forgetful"])
def test_a_behaviour_that_does_not_end_is_revoked(
    behaviour: str, users_own: Callable[[str, str], None], caplog: pytest.LogCaptureFixture
) -> None:
    users_own("lab_stubborn", STUBBORN)

    async def main() -> None:
        async with memory_fleet(scenario(1, f"lab_stubborn:{behaviour}")) as fleet:
            try:
                await fleet.until(lambda: fleet.commanded("r1") != (0.0, 0.0), 3, "it drives")
                await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="hold"))
                await fleet.until(lambda: fleet.commanded("r1") == (0.0, 0.0), 0.2, "it is stationary")
                for _ in range(30):
                    await asyncio.sleep(0.1)
                    assert fleet.commanded("r1") == (0.0, 0.0)
                assert fleet.holds("r1", "the behaviour is hold")
                assert any("has not ended" in r.message for r in caplog.records) == (behaviour == "deaf")
                await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="circle"))
                await fleet.until(lambda: fleet.commanded("r1") != (0.0, 0.0), 2, "the next one is taken")
            finally:
                sys.modules["lab_stubborn"].OVER.set()
                await asyncio.sleep(0.2)

    run_virtually(main())


@pytest.mark.parametrize("behaviour", ["deaf", "forgetful"])
def test_nothing_is_sent_after_the_last_zero(behaviour: str, users_own: Callable[[str, str], None]) -> None:
    users_own("lab_stubborn", STUBBORN)

    async def main() -> None:
        async with memory_fleet(scenario(1, f"lab_stubborn:{behaviour}")) as fleet:
            try:
                commands = (await fleet.bus()).every(channels.CMD_VEL, "r1", depth=1024)
                await fleet.until(lambda: fleet.commanded("r1") != (0.0, 0.0), 3, "it drives")
                fleet.agents["r1"].cancel()
                await asyncio.sleep(2.0)
                sent = [(received.message.v, received.message.omega) for received in commands.drain()]
                assert sent[-1] == (0.0, 0.0)
                assert sent[-2] != (0.0, 0.0)  # there is one zero, and nothing after it
            finally:
                sys.modules["lab_stubborn"].OVER.set()
                await asyncio.sleep(0.2)

    run_virtually(main())


@pytest.mark.parametrize(
    ("behaviour", "state"),
    [("fails", "failed"), ("returns", "ended"), ("cancelled", "ended"), ("fails_with_a_goal", "failed")],
)
def test_a_task_that_a_failed_or_ended_behaviour_leaves_behind_moves_nothing(
    behaviour: str, state: str, users_own: Callable[[str, str], None]
) -> None:
    users_own("lab_leftover", LEFTOVER)

    async def main() -> None:
        async with memory_fleet(scenario(1, f"lab_leftover:{behaviour}")) as fleet:
            try:
                await fleet.until(lambda: fleet.commanded("r1") != (0.0, 0.0), 3, "the task drives")
                await fleet.until(lambda: fleet.healths["r1"].state == state, 3, "the behaviour fails or ends")
                (task,) = sys.modules["lab_leftover"].KEPT
                for _ in range(20):
                    await asyncio.sleep(0.1)
                    assert fleet.commanded("r1") == (0.0, 0.0)
                    assert fleet.healths["r1"].reasons == (fleet.healths["r1"].failure,)
                assert not task.done()  # it still calls
            finally:
                sys.modules["lab_leftover"].OVER.set()
                await asyncio.sleep(0.6)

    run_virtually(main())


def test_a_control_loop_that_has_ended_sends_nothing() -> None:
    loop = ControlLoop("r1", RobotSettings())
    ((channel, last),) = loop.end(1.0)
    assert channel is channels.CMD_VEL
    assert isinstance(last, VelocityCommand)
    assert (last.v, last.omega) == (0.0, 0.0)
    assert loop.want(1.01, Intent(Twist2(0.2, 0.0))) == []
    assert loop.take_stop(1.02, StopOrder(all=True, revision=3)) == []
    assert loop.update(2.0, [], [], Surroundings()) == []


@pytest.mark.parametrize(
    ("behaviour", "state", "said"),
    [
        ("swim", "failed", "RuntimeError: out of water (lab_failing.py, line 11)"),
        ("group", "failed", "RuntimeError: out of water (lab_failing.py, line 11)"),
        ("leave", "failed", "SystemExit: 3 (lab_failing.py, line 19)"),
        ("called", "failed", "ZeroDivisionError: float division by zero (lab_failing.py, line 28)"),
        (
            "wrong",
            "failed",
            "return value: got 'straight on', expected `return v, omega` [m/s, rad/s] (lab_failing.py, line 30)",
        ),
        ("exits", "failed", "SystemExit: 3 (lab_failing.py, line 34)"),
        ("cancels", "failed", "CancelledError (lab_failing.py, line 43)"),
        ("brief", "ended", "has ended: its function has returned"),
        ("cancelled", "ended", "has ended: it was cancelled by itself"),
    ],
)
def test_a_behaviour_that_fails_or_ends_leaves_the_robot_stationary_with_the_reason(
    behaviour: str, state: str, said: str, users_own: Callable[[str, str], None], caplog: pytest.LogCaptureFixture
) -> None:
    users_own("lab_failing", FAILING)

    async def main() -> None:
        async with memory_fleet(scenario(2, "circle")) as fleet:
            await fleet.until(lambda: len(fleet.driving) == 2, 3, "both drive")
            order = SetBehaviour(behaviour=f"lab_failing:{behaviour}", names=("r1",))
            await fleet.order(channels.SET_BEHAVIOUR, order)
            await fleet.until(lambda: fleet.healths["r1"].state == state, 0.5, "it reports it at once")
            health = fleet.healths["r1"]
            assert health.failure == f"behaviour lab_failing:{behaviour}{' ' if state == 'ended' else ': '}{said}"
            assert health.reasons == (health.failure,)
            for _ in range(20):
                await asyncio.sleep(0.1)
                assert fleet.commanded("r1") == (0.0, 0.0)
            assert fleet.commanded("r2") != (0.0, 0.0)
            assert not fleet.agents["r1"].done()
            assert fleet.healths["r1"].failure == health.failure
            await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="circle"))
            await fleet.until(lambda: fleet.commanded("r1") != (0.0, 0.0), 1.5, "the next one is taken")
            await fleet.until(lambda: not fleet.healths["r1"].failure, 1.5, "it reports it")
            assert fleet.healths["r1"].state == "circle"

    run_virtually(main())
    if state == "failed" and behaviour != "wrong":  # what it returned was found out outside of it
        assert 'lab_failing.py", line' in caplog.text  # the traceback
    assert said in caplog.text


NOT_A_TWIST = [
    ("none", "v: got None, expected a finite number [m/s]"),
    ("text", "v: got '0.1', expected a finite number [m/s]"),
    ("nan", "omega: got nan, expected a finite number [rad/s]"),
    ("infinite", "v: got inf, expected a finite number [m/s]"),
    ("huge", "v: got 1000000000"),
    ("speed_nan", "speed: got nan, expected a finite number [m/s]"),
    ("speed_huge", "speed: got 10000000000000.0, expected a finite number of at most 1e+12"),
    ("goal_nan", "x: got nan, expected a finite number [m]"),
    ("goal_text", "theta: got 'north', expected a finite number [rad]"),
]


@pytest.mark.parametrize(
    ("function", "call", "said"),
    [
        *((function, *row) for row in NOT_A_TWIST for function in ("plain", "waiting")),
        ("plain", "pair_text", "v: got '0.1', expected a finite number [m/s]"),
        ("plain", "pair_nan", "v: got nan, expected a finite number [m/s]"),
        ("plain", "pair_huge", "omega: got -1000000000"),
        ("plain", "three", "return value: got (0.1, 0.2, 0.3), expected `return v, omega` [m/s, rad/s]"),
        ("plain", "one", "return value: got 0.1, expected `return v, omega` [m/s, rad/s]"),
    ],
)
def test_what_is_not_a_number_fails_the_behaviour_and_not_the_agent(
    function: str, call: str, said: str, users_own: Callable[[str, str], None], caplog: pytest.LogCaptureFixture
) -> None:
    users_own("lab_numbers", NUMBERS)

    async def main() -> None:
        async with memory_fleet(scenario(1, "circle")) as fleet:
            await fleet.until(lambda: fleet.commanded("r1") != (0.0, 0.0), 3, "it drives")
            order = SetBehaviour(behaviour=f"lab_numbers:{function}", parameters={"call": call})
            await fleet.order(channels.SET_BEHAVIOUR, order)
            await fleet.until(lambda: fleet.healths["r1"].state == "failed", 0.5, "it reports it at once")
            health = fleet.healths["r1"]
            assert said in health.failure
            assert "(lab_numbers.py, line " in health.failure
            assert health.reasons == (health.failure,)
            for _ in range(10):
                await asyncio.sleep(0.1)
                assert fleet.commanded("r1") == (0.0, 0.0)
            assert not fleet.agents["r1"].done()
            await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="circle"))
            await fleet.until(lambda: fleet.commanded("r1") != (0.0, 0.0), 1.5, "the next one is taken")

    run_virtually(main())
    assert "Traceback" in caplog.text


@pytest.mark.parametrize("call", [call for call, _ in NOT_A_TWIST])
def test_an_async_behaviour_that_catches_the_error_has_asked_for_nothing(
    call: str, users_own: Callable[[str, str], None]
) -> None:
    users_own("lab_numbers", NUMBERS)

    async def main() -> None:
        async with memory_fleet(scenario(1, "hold")) as fleet:
            order = SetBehaviour(behaviour="lab_numbers:careless", parameters={"call": call})
            await fleet.order(channels.SET_BEHAVIOUR, order)
            await fleet.until(lambda: fleet.commanded("r1") != (0.0, 0.0), 2, "it drives at first")
            await fleet.until(lambda: fleet.holds("r1", "no command from the behaviour"), 2, "it counts as silent")
            for _ in range(10):
                await asyncio.sleep(0.1)
                assert fleet.commanded("r1") == (0.0, 0.0)
            assert fleet.healths["r1"].failure == ""

    run_virtually(main())


@pytest.mark.parametrize(
    ("function", "call"),
    [
        *((f, c) for c in ("double", "single", "integers", "speed") for f in ("plain", "waiting")),
        ("plain", "pair_double"),
        ("plain", "pair_single"),
        ("sets_out", ""),
        ("sets_out_plain", "goal"),
    ],
)
def test_a_number_of_numpy_is_one(function: str, call: str, users_own: Callable[[str, str], None]) -> None:
    users_own("lab_numbers", NUMBERS)

    async def main() -> None:
        async with memory_fleet(scenario(1, "hold")) as fleet:
            order = SetBehaviour(behaviour=f"lab_numbers:{function}", parameters={"call": call})
            await fleet.order(channels.SET_BEHAVIOUR, order)
            await fleet.until(lambda: fleet.commanded("r1") != (0.0, 0.0), 2, "it drives")
            await asyncio.sleep(1.0)
            assert fleet.commanded("r1") != (0.0, 0.0)
            assert fleet.healths["r1"].failure == ""

    run_virtually(main())


WAITING = """
async def sets_out(robot):
    async for _ in robot.estimates():
        break
    robot.goal(0.5, 0.5)
    async for _ in robot.estimates():
        try:
            STEPS.append(robot.now)
            if robot.revoked:
                robot.drive(0.2, 0.0)
        except Exception:
            pass

STEPS = []
"""


@pytest.mark.parametrize("behaviour", ["dubins", "lab_waiting:sets_out"])
def test_a_ride_that_fails_in_its_step_fails_the_behaviour_and_not_the_agent(
    behaviour: str,
    users_own: Callable[[str, str], None],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    users_own("lab_waiting", WAITING)
    whole, raising = GoalRide.step, False

    def step(self: GoalRide, seen: Seen) -> Intent:
        if raising:
            raise ZeroDivisionError("no such radius")
        return whole(self, seen)

    monkeypatch.setattr(GoalRide, "step", step)

    async def main() -> None:
        nonlocal raising
        async with memory_fleet(scenario(1, "hold")) as fleet:
            order = SetBehaviour(behaviour=behaviour)
            if behaviour == "dubins":
                order = SetBehaviour(behaviour=behaviour, parameters={"goals": ((0.5, 0.5),)})
            await fleet.order(channels.SET_BEHAVIOUR, order)
            await fleet.until(lambda: fleet.commanded("r1") != (0.0, 0.0), 2, "it drives")
            raising = True
            await fleet.until(lambda: fleet.healths["r1"].state == "failed", 0.5, "it reports it at once")
            health = fleet.healths["r1"]
            assert health.failure == f"behaviour {behaviour}: ZeroDivisionError: no such radius"
            steps = len(getattr(sys.modules.get("lab_waiting"), "STEPS", ()))
            for _ in range(10):
                await asyncio.sleep(0.1)
                assert fleet.commanded("r1") == (0.0, 0.0)
                assert fleet.healths["r1"].reasons == (health.failure,)
            assert len(getattr(sys.modules.get("lab_waiting"), "STEPS", ())) == steps  # its task has ended
            raising = False
            await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="circle"))
            await fleet.until(lambda: fleet.commanded("r1") != (0.0, 0.0), 1.5, "the next one is taken")

    run_virtually(main())
    assert "Traceback" in caplog.text


def test_a_goal_for_a_behaviour_that_has_failed_is_refused_with_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def step(self: GoalRide, seen: Seen) -> Intent:
        raise ZeroDivisionError("no such radius")

    monkeypatch.setattr(GoalRide, "step", step)

    async def main() -> None:
        async with memory_fleet(scenario(1, "dubins")) as fleet:
            await fleet.until(lambda: "r1" in fleet.healths and fleet.healths["r1"].failure != "", 3, "it fails")
            operator = await fleet.bus(Role.OPERATOR)
            reply = await operator.ask(channels.GOAL_ORDER, Goal(x=0.5, y=0.5), name="r1")
            assert (reply.accepted, reply.reason) == (False, fleet.healths["r1"].failure)

    run_virtually(main())


def test_a_reason_that_is_no_text_is_shown_as_one(users_own: Callable[[str, str], None]) -> None:
    users_own("lab_numbers", NUMBERS)

    async def main() -> None:
        async with memory_fleet(scenario(1, "hold")) as fleet:
            order = SetBehaviour(behaviour="lab_numbers:plain", parameters={"call": "reason"})
            await fleet.order(channels.SET_BEHAVIOUR, order)
            await fleet.until(lambda: fleet.healths["r1"].reasons == ("7",), 2, "it holds")

    run_virtually(main())


def test_an_importance_that_raises_fails_the_behaviour_and_not_the_agent(
    users_own: Callable[[str, str], None], caplog: pytest.LogCaptureFixture
) -> None:
    users_own("lab_weights", "def weight(angle):\n    raise RuntimeError('no table')\n")

    async def main() -> None:
        async with memory_fleet(scenario(1, "hold")) as fleet:
            order = SetBehaviour(
                behaviour="pursuit", parameters={"pursuit": "importance", "importance": "lab_weights:weight"}
            )
            await fleet.order(channels.SET_BEHAVIOUR, order)
            await fleet.until(lambda: fleet.holds("r1", "got RuntimeError('no table') at angle"), 1.5, "it says why")
            assert fleet.healths["r1"].state == "failed"
            assert not fleet.agents["r1"].done()

    run_virtually(main())
    assert 'lab_weights.py", line 2, in weight' in caplog.text


def test_a_behaviour_that_cannot_be_made_fails_and_not_its_agent(monkeypatch: pytest.MonkeyPatch) -> None:
    def make(*_: object) -> GoalRide:
        raise ZeroDivisionError("no such radius")

    monkeypatch.setattr("agents.tasks.behaviour.make_behaviour", make)

    async def main() -> None:
        async with memory_fleet(scenario(1, "hold")) as fleet:
            await fleet.until(lambda: fleet.holds("r1", "ZeroDivisionError: no such radius"), 3, "it says why")
            assert not fleet.agents["r1"].done()

    run_virtually(main())


def test_an_error_while_a_users_module_is_imported_shows_where(
    users_own: Callable[[str, str], None], caplog: pytest.LogCaptureFixture
) -> None:
    users_own("lab_broken", "import math\n\nSPEED = 1 / 0\n")

    async def main() -> None:
        async with memory_fleet(scenario(1, "hold")) as fleet:
            await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="lab_broken:go"))
            await fleet.until(
                lambda: fleet.holds("r1", "ZeroDivisionError('division by zero')"), 1.5, "it reports the reason"
            )
            assert fleet.healths["r1"].state == "failed"

    run_virtually(main())
    assert 'lab_broken.py", line 3, in <module>' in caplog.text


def test_a_behaviour_that_failed_starts_again_when_it_is_ordered_again_and_only_then(
    users_own: Callable[[str, str], None],
) -> None:
    users_own("lab_failing", FAILING)

    async def main() -> None:
        async with memory_fleet(scenario(2, "circle")) as fleet:
            await asyncio.sleep(1.0)
            order = SetBehaviour(behaviour="lab_failing:counts", names=("r1",))
            await fleet.order(channels.SET_BEHAVIOUR, order)
            await fleet.until(lambda: fleet.healths["r1"].state == "failed", 1.5, "it fails")
            starts: list[float] = sys.modules["lab_failing"].STARTS
            assert len(starts) == 1
            await asyncio.sleep(3.0)  # the base station repeats it twice a second
            assert len(starts) == 1
            # Other changes of the kept state are no order to it.
            await fleet.order(channels.SET_CIRCLE, SetCircle(radius=0.7))
            await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="hold", names=("r2",)))
            await fleet.order(channels.STOP_ORDER, Stop(names=("r2",)))
            await fleet.order(channels.RESUME, Resume(revision=fleet.kept.stop.revision))
            await asyncio.sleep(1.5)
            assert len(starts) == 1
            for count in itertools.islice(itertools.count(2), 2):
                await fleet.order(channels.SET_BEHAVIOUR, order)
                await asyncio.sleep(1.5)
                assert len(starts) == count

    run_virtually(main())


def test_a_behaviour_that_runs_goes_on_when_it_is_ordered_again(users_own: Callable[[str, str], None]) -> None:
    users_own("lab_running", RUNNING)

    async def main() -> None:
        async with memory_fleet(scenario(1, "lab_running:go")) as fleet:
            await fleet.until(lambda: fleet.commanded("r1") != (0.0, 0.0), 3, "it drives")
            await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="lab_running:go"))
            await asyncio.sleep(1.0)
            assert len(sys.modules["lab_running"].STARTS) == 1

    run_virtually(main())
