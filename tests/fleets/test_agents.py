"""Real agents and bases on the in-memory bus, in virtual time: the loop closed from fix to wheel."""

from __future__ import annotations

import asyncio
import contextlib
import math
import sys
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import msgpack
import pytest

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import parse_scenario
from muro_zenoh.estimation.pose_filter import PoseEstimate, PoseFilter
from muro_zenoh.geometry import Pose2
from muro_zenoh.messages import (
    Behaviour,
    Circle,
    FleetSnapshot,
    Goal,
    PoseFix,
    Resume,
    RobotState,
    SetBehaviour,
    SetCircle,
    SpeedReference,
    Stop,
    StopOrder,
    VelocityCommand,
)
from muro_zenoh.runtime.virtual_time import run_virtually
from tests.support.memory_fleet import MemoryFleet, memory_fleet, scenario
from tests.support.memory_lab import agent, memory_lab
from tests.support.virtual import virtual

EXAMPLES = Path(__file__).parents[2] / "examples"
DEAD_MAN = channels.CMD_VEL.stale_after or 0.0


@contextlib.asynccontextmanager
async def circling(robots: int = 1, behaviour: str = "circle", **parameters: object) -> AsyncIterator[MemoryFleet]:
    """A fleet whose robots are all driving."""
    async with memory_fleet(scenario(robots, behaviour, **parameters)) as fleet:  # type: ignore[arg-type]
        await fleet.until(lambda: len(fleet.driving) == robots, 3, "all drive")
        yield fleet


# ---- following a circle


@pytest.mark.parametrize("clockwise", [False, True])
def test_circle_converges_in_both_directions(clockwise: bool) -> None:
    async def main() -> None:
        async with circling(2, clockwise=clockwise) as fleet:
            await asyncio.sleep(15.0)
            for name in ("r1", "r2"):
                for _ in range(20):
                    await asyncio.sleep(0.1)
                    assert fleet.radius_error(name) < 0.01
                turning = 0.2 / 0.8 * (-1 if clockwise else 1)
                assert fleet.turning(name) == pytest.approx(turning, rel=0.03)

    run_virtually(main())


@virtual
async def test_the_calibrations_find_the_hidden_drive_errors() -> None:
    async with circling(3) as fleet:
        bus = await fleet.bus()
        cal_v, cal_omega = bus.latest(channels.CAL_V, "*"), bus.latest(channels.CAL_OMEGA, "*")
        await fleet.until(lambda: max(map(fleet.radius_error, fleet.scenario.robots)) < 0.03, 20, "all on the circle")
        await asyncio.sleep(10.0)
        for row, name in enumerate(fleet.scenario.robots):
            assert cal_v.values()[name].message.value * fleet.plant.s_v[row] == pytest.approx(1.0, abs=0.05)
            assert cal_omega.values()[name].message.value * fleet.plant.s_omega[row] == pytest.approx(1.0, abs=0.05)


@virtual
async def test_circle_follows_the_velocity_that_another_process_publishes() -> None:
    async with circling(1, speed=0.2) as fleet:
        other = await fleet.bus()
        velocity = other.publisher(channels.VELOCITY, "r1")

        async def say(speed: float, duration: float) -> None:
            for _ in range(round(10 * duration)):
                velocity.put(SpeedReference(speed=speed))
                await asyncio.sleep(0.1)

        await asyncio.sleep(10.0)
        assert fleet.speed("r1") == pytest.approx(0.2, abs=0.01)
        await say(0.1, 3.0)
        assert fleet.speed("r1") == pytest.approx(0.1, abs=0.01)
        await say(0.3, 3.0)
        assert fleet.speed("r1") == pytest.approx(0.3, abs=0.015)
        # When the publisher of a speed times out, the default does not replace it.
        await fleet.until(lambda: fleet.holds("r1", "no velocity for"), 1.5, "it holds")
        assert fleet.commanded("r1") == (0.0, 0.0)
        await say(0.2, 2.0)
        assert fleet.speed("r1") == pytest.approx(0.2, abs=0.015)


@virtual
async def test_the_velocity_of_a_foreign_program_is_followed() -> None:
    async with circling(1) as fleet:
        for _ in range(30):
            fleet.network.put("muro/velocity/r1", msgpack.packb({"stamp": fleet.clock.now(), "speed": 0.12}))
            await asyncio.sleep(0.1)
        assert fleet.speed("r1") == pytest.approx(0.12, abs=0.01)


@virtual
async def test_the_circle_changes_live() -> None:
    async with circling(1) as fleet:
        await asyncio.sleep(8.0)
        await fleet.order(channels.SET_CIRCLE, SetCircle(x=0.3, radius=0.6, clockwise=True))
        await asyncio.sleep(12.0)
        assert fleet.radius_error("r1") < 0.01
        assert fleet.turning("r1") == pytest.approx(-0.2 / 0.6, rel=0.03)


@virtual
async def test_a_fix_gives_a_command_at_once_and_the_estimate_continues_without() -> None:
    async with circling(1) as fleet:
        bus = await fleet.bus()
        fixes = bus.every(channels.POSE, "r1", depth=512)
        estimates = bus.every(channels.ESTIMATE, "r1", depth=512)
        commands = bus.every(channels.CMD_VEL, "r1", depth=512)
        await asyncio.sleep(2.0)
        sent = {command.message.stamp for command in commands.drain()}
        arrived = [fix.arrival for fix in fixes.drain()]
        assert len(arrived) == 40
        assert all(arrival in sent for arrival in arrived)  # no timer between pose and command
        assert len(estimates.drain()) == 40  # and no estimate between two fixes
        numbers, samples = fleet.healths["r1"].numbers, fleet.healths["r1"].samples
        assert numbers["command_rate_hz"] == pytest.approx(len(sent) / 2.0, abs=3.0)
        assert samples["pose_to_command_s"] == pytest.approx([0.0] * 20, abs=1e-6)
        assert samples["pose_age_s"] == pytest.approx([0.05] * 20, abs=0.011)  # the camera's latency is in it
        fleet.seeing = False
        await asyncio.sleep(0.2)
        estimates.drain()
        await asyncio.sleep(1.0)
        assert 12 <= len(estimates.drain()) <= 14  # a fix is overdue after 1.5 periods


# ---- cyclic pursuit


@virtual
async def test_pursuit_spreads_and_changes_its_parameters_and_its_behaviour_live() -> None:
    async with circling(3, "pursuit", cruise=0.2) as fleet:
        await fleet.until(lambda: fleet.spacing_error() < 0.1, 40, "an even ring")
        await asyncio.sleep(5.0)
        assert fleet.spacing_error() < 0.1
        assert max(map(fleet.radius_error, fleet.scenario.robots)) < 0.03
        assert [fleet.speed(name) for name in fleet.scenario.robots] == pytest.approx([0.2] * 3, abs=0.02)

        await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="pursuit", parameters={"cruise": 0.1}))
        await asyncio.sleep(3.0)
        assert [fleet.speed(name) for name in fleet.scenario.robots] == pytest.approx([0.1] * 3, abs=0.02)
        assert fleet.spacing_error() < 0.1

        await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="hold", names=("r2",)))
        await fleet.until(lambda: fleet.holds("r2", "the behaviour is hold"), 1, "r2 holds")
        assert fleet.commanded("r2") == (0.0, 0.0)
        await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="circle", names=("r2",)))
        await fleet.until(lambda: abs(fleet.speed("r2") - 0.2) < 0.02, 5, "r2 follows the circle")


@virtual
async def test_a_ring_spreads_again_when_a_robot_is_stopped_by_order() -> None:
    async with circling(3, "pursuit") as fleet:
        await fleet.until(lambda: fleet.spacing_error() < 0.1, 40, "an even ring")
        await fleet.order(channels.STOP_ORDER, Stop(names=("r3",)))
        # A stopped robot does not count: the other two take half the circle each.
        await fleet.until(lambda: fleet.spacing_error(["r1", "r2"]) < 0.1, 40, "a ring of two")
        assert "r3" not in fleet.driving


@virtual
async def test_a_ring_spreads_again_when_an_agent_dies_and_when_it_is_back() -> None:
    """The robot is stationary on the circle, and the cameras still see it."""
    async with circling(3, "pursuit") as fleet:
        await fleet.until(lambda: fleet.spacing_error() < 0.1, 40, "an even ring")
        fleet.agents["r3"].cancel()
        await fleet.until(lambda: fleet.spacing_error(["r1", "r2"]) < 0.1, 30, "a ring of two")
        await asyncio.sleep(5.0)
        assert fleet.spacing_error(["r1", "r2"]) < 0.5  # each has to drive round it, and is delayed by that
        assert {"r1", "r2"} <= fleet.driving
        assert fleet.plant.contacts == 0
        assert fleet.speed("r3") == pytest.approx(0.0, abs=1e-3)
        await fleet.start_agent("r3")
        await fleet.until(lambda: fleet.spacing_error() < 0.1, 30, "a ring of three")
        await asyncio.sleep(5.0)
        assert fleet.spacing_error() < 0.1


@virtual
async def test_the_ring_ignores_a_robot_with_another_behaviour() -> None:
    async with circling(3, "pursuit") as fleet:
        await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="hold", names=("r2",)))
        await fleet.until(lambda: fleet.spacing_error(["r1", "r3"]) < 0.1, 40, "a ring of two")
        await asyncio.sleep(5.0)
        assert fleet.spacing_error(["r1", "r3"]) < 0.1


@virtual
async def test_pursuit_holds_when_the_positions_time_out() -> None:
    """The agent has its own pose and no positions of the other robots."""
    async with memory_fleet(scenario(2, "pursuit")) as fleet:
        await fleet.until(lambda: len(fleet.driving) == 2, 3, "all drive")
        fleet.silence(channels.ALL_POSITIONS)
        await fleet.until(lambda: fleet.holds("r1", "no positions for"), 1.0, "it holds")
        await fleet.until(lambda: not fleet.driving, 1, "all stand")


@virtual
async def test_pursuit_uses_positions_up_to_0_5_s_old() -> None:
    async with memory_fleet(scenario(2, "pursuit")) as fleet:
        await fleet.until(lambda: len(fleet.driving) == 2, 3, "all drive")
        await asyncio.sleep(2.0)
        snapshots = (await fleet.bus()).latest(channels.ALL_POSITIONS)
        last = await snapshots.next()
        fleet.silence(channels.ALL_POSITIONS)
        for age, driving in ((0.45, {"r1", "r2"}), (0.56, set())):  # an estimate comes every 0.05 s
            await asyncio.sleep(age - last.age(fleet.clock.now()))
            assert snapshots.get() == last  # there is no newer one
            assert fleet.driving == driving, age
        await fleet.until(lambda: fleet.holds("r1", "no positions for 0."), 0.2, "it reports the reason, with the age")


@virtual
async def test_pursuit_holds_while_there_are_no_positions() -> None:
    """A single robot that never receives a snapshot: pursuit has no speed, and no default replaces it."""
    async with memory_fleet(scenario(1, "pursuit"), agents=False) as fleet:
        fleet.silence(channels.ALL_POSITIONS)
        await fleet.start_agent("r1")
        await fleet.until(lambda: fleet.holds("r1", "no positions received yet"), 2, "it holds")
        await asyncio.sleep(1.0)
        assert fleet.commanded("r1") == (0.0, 0.0)


# ---- what keeps robots from driving


@virtual
async def test_an_agent_never_reports_that_it_drives_before_it_does() -> None:
    """Not in its very first report either, which a page may show."""
    async with memory_lab() as lab:
        reports = lab.bus.every(channels.HEALTH, "r1")
        lab.start(scenario(1, "hold"), agent("r1"))
        await asyncio.sleep(3.0)
        reasons = [report.message.reasons for report in reports.drain()]
    assert reasons[0] == ("it has just started",)
    assert all(reasons)


@virtual
async def test_a_robot_holds_until_it_receives_a_stop_state() -> None:
    async with memory_fleet(scenario(2, "circle"), agents=False) as fleet:
        fleet.silence(channels.STOP)
        await fleet.start_agent("r1")
        await fleet.until(lambda: fleet.holds("r1", "no stop state received yet"), 2, "it reports the reason")
        await asyncio.sleep(2.0)
        assert fleet.commanded("r1") == (0.0, 0.0)
        # Nothing else is missing.
        assert fleet.healths["r1"].reasons == ("no stop state received yet: waiting for the base station",)


@virtual
async def test_a_stop_order_keeps_the_wheels_at_zero_until_it_is_lifted() -> None:
    async with circling(2) as fleet:
        await fleet.order(channels.STOP_ORDER, Stop())
        await fleet.until(lambda: not fleet.driving, 0.1, "zero at once")
        await fleet.until(lambda: all(fleet.healths[n].stop_latched for n in ("r1", "r2")), 0.1, "said at once")
        assert fleet.holds("r1", "stopped by order (all robots)")
        await asyncio.sleep(1.5)
        assert fleet.speed("r1") == pytest.approx(0.0, abs=1e-3)
        assert not fleet.dead_man("r1")  # zero is commanded, not left to the dead-man
        await fleet.order(channels.RESUME, Resume(revision=fleet.kept.stop.revision))
        await fleet.until(lambda: len(fleet.driving) == 2, 0.5, "all drive")


@virtual
async def test_an_operators_stop_needs_no_base_station() -> None:
    async with circling(2) as fleet:
        revision = fleet.kept.stop.revision
        operator = await fleet.bus()
        orders = operator.publisher(channels.STOP)
        orders.put(StopOrder(all=True, revision=0))
        await fleet.until(lambda: not fleet.driving, 0.1, "zero at once")
        # The base station never received it. Its repetitions lift nothing; it adopts the stop that the robots latched.
        await asyncio.sleep(1.0)
        assert not fleet.driving
        assert fleet.kept.stop.all
        assert fleet.kept.stop.revision > revision
        await fleet.order(channels.RESUME, Resume(revision=fleet.kept.stop.revision))
        await fleet.until(lambda: len(fleet.driving) == 2, 0.5, "all drive")


@virtual
async def test_a_stale_pose_stops_the_robot() -> None:
    async with circling(1) as fleet:
        fleet.seeing = False
        took = await fleet.until(lambda: fleet.commanded("r1") == (0.0, 0.0), 0.6, "zero")
        assert took > 0.25  # a few lost frames are no reason to stop
        await fleet.until(lambda: fleet.holds("r1", "no pose for"), 0.5, "it reports the reason")
        assert not fleet.dead_man("r1")
        fleet.seeing = True
        await fleet.until(lambda: fleet.commanded("r1") != (0.0, 0.0), 0.5, "it goes on")


@pytest.mark.parametrize(("limit", "stale"), [(0.25, "stale"), (0.6, "tracking")])
def test_the_ages_that_a_fleet_file_sets_hold_at_agent_base_and_base_station(limit: float, stale: str) -> None:
    """The base's limit shows with a killed agent, the others' without a camera, half a second after its last frame."""

    async def main() -> None:
        table = {
            "robots": 1,
            "behaviour": {"name": "circle"},
            "timeouts": {"command": limit, "pose": limit, "snapshot": 2.0},
            "separation": {"enabled": False},
        }
        async with memory_fleet(parse_scenario(table, "lab.toml", name="lab")) as fleet:
            await fleet.until(lambda: bool(fleet.driving), 5, "it drives")
            fleet.seeing = False
            await asyncio.sleep(0.5)
            assert bool(fleet.driving) == (limit > 0.5)
            (row,) = fleet.station._positions._table.snapshot(fleet.clock.now())
            assert row.state == stale
            fleet.seeing = True
            await fleet.until(lambda: bool(fleet.driving), 5, "it drives again")
            bus, name = await fleet.bus(), "r1"
            fleet.agents[name].cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await fleet.agents[name]
            await fleet.until(lambda: fleet.dead_man(name), 2.0, "its dead-man")
            bus.publisher(channels.CMD_VEL, name).put(VelocityCommand(v=0.1, omega=0.0))
            await asyncio.sleep(0.5)
            assert bool(fleet.driving) == (limit > 0.5)

    run_virtually(main())


@virtual
async def test_a_killed_agent_needs_the_dead_man_and_a_cancelled_one_does_not() -> None:
    async with circling(2) as fleet:
        fleet.agents["r1"].cancel()
        took = await fleet.until(lambda: fleet.commanded("r1") == (0.0, 0.0), 0.1, "its last command is zero")
        assert took < 0.05
        assert fleet.commanded("r2") != (0.0, 0.0)
        await fleet.until(lambda: fleet.dead_man("r1"), 0.5, "then the dead-man")


# ---- behaviours that are none


def holds_with(behaviour: str, parameters: dict[str, Any], reason: str) -> None:
    """An agent holds with the reason, and runs the next behaviour that is ordered."""

    async def main() -> None:
        async with circling(1) as fleet:
            fleet.silence(channels.BEHAVIOUR)
            foreign = (await fleet.bus(Role.BASESTATION)).publisher(channels.BEHAVIOUR, "r1")
            foreign.put(Behaviour(behaviour=behaviour, parameters=parameters, revision=7))
            await fleet.until(lambda: fleet.holds("r1", reason), 1.5, "it reports the reason")
            await asyncio.sleep(1.0)
            assert fleet.commanded("r1") == (0.0, 0.0)
            assert not fleet.agents["r1"].done()
            foreign.put(Behaviour(behaviour="circle", revision=8))
            await fleet.until(lambda: fleet.commanded("r1") != (0.0, 0.0), 1, "the next one is taken")

    run_virtually(main())


@pytest.mark.parametrize(
    ("behaviour", "parameters", "reason"),
    [
        ("fly", {}, "got 'fly', expected one of circle, coverage"),
        ("nolab.swarm:flock", {}, "No module named 'nolab'"),
        ("circle", {"sped": 0.2}, "behaviour.sped: got an unknown key"),
        ("circle", {"speed": "fast"}, "behaviour.speed: got 'fast' (text), expected a number at least 0"),
        ("circle", {"speed": -0.1}, "behaviour.speed: got -0.1"),
        ("circle", {"law": "magic"}, "magic"),
        ("pursuit", {"pursuit": "magic"}, "magic"),
        ("pursuit", {"v_min": 0.5, "v_max": 0.1}, "v_m"),
        ("pursuit", {"pursuit": "importance", "importance": "nolab:weight"}, "No module named 'nolab'"),
        ("pursuit", {"pursuit": "importance", "angles": (0.0, 1.0), "weights": (1.0,)}, "weights: got 1 for"),
        ("dubins", {"turning_radius": 0}, "behaviour.turning_radius: got 0"),
        ("dubins", {"goals": ((0.5,),)}, "behaviour.goals[0]: got 1 numbers"),
        ("steer", {"reverse_from": 0.1}, "behaviour.reverse_from: got 0.1"),
        ("coverage", {"peaks": ((0.5, 0.5),)}, "behaviour.peaks[0]: got 2 numbers"),
        ("coverage", {"goals": ((0.5, 0.5),)}, "behaviour.goals: got an unknown key"),
    ],
)
def test_an_invalid_behaviour_is_refused_and_an_agent_that_receives_it_holds(
    behaviour: str, parameters: dict[str, Any], reason: str
) -> None:
    holds_with(behaviour, parameters, reason)

    async def refused() -> None:
        async with memory_fleet(scenario(1, "circle")) as fleet:
            order = SetBehaviour(behaviour=behaviour, parameters=parameters)
            assert reason in await fleet.refusal(channels.SET_BEHAVIOUR, order)
            await fleet.until(lambda: fleet.commanded("r1") != (0.0, 0.0), 3, "it drives all the same")

    if "nolab" not in f"{behaviour} {parameters}":  # only the robots load the user's code
        run_virtually(refused())


def users_own(folder: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    (folder / "lab_of_ours.py").write_text(text)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.delitem(sys.modules, "lab_of_ours", raising=False)


def test_a_crash_of_the_filter_ends_the_agent_and_the_robot_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    """An exception in a behaviour does not: see test_behaviour_runner.py."""
    at = PoseFilter.at

    def crashing(self: PoseFilter, t: float) -> PoseEstimate | None:
        if t > 1.7e9 + 3.0 and next(once, False):
            raise RuntimeError("out of water")
        return at(self, t)

    once = iter([True])
    monkeypatch.setattr(PoseFilter, "at", crashing)

    async def main() -> None:
        async with circling(2) as fleet:
            crashed = lambda: [name for name, task in fleet.agents.items() if task.done()]  # noqa: E731
            await fleet.until(lambda: len(crashed()) == 1, 4, "the crash")
            (name,) = crashed()
            error: BaseException | None = fleet.agents[name].exception()
            while isinstance(error, BaseExceptionGroup):
                error = error.exceptions[0]
            assert repr(error) == "RuntimeError('out of water')"
            await fleet.until(lambda: fleet.commanded(name) == (0.0, 0.0), 0.1, "its last command is zero")
            assert len(fleet.driving) == 1

    run_virtually(main())


def test_a_behaviour_that_makes_no_calls_times_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    users_own(
        tmp_path,
        monkeypatch,
        "import asyncio\n"
        "async def sleepy(robot):\n"
        "    robot.drive(0.2, 0.0)\n"
        "    await asyncio.sleep(60)\n"
        "async def brief(robot):\n"
        "    robot.drive(0.2, 0.0)\n",
    )

    async def main() -> None:
        async with memory_fleet(scenario(1, "hold")) as fleet:
            await fleet.until(lambda: fleet.holds("r1", "the behaviour is hold"), 2, "it holds")
            for behaviour, reason in (
                ("sleepy", "no command from the behaviour"),
                ("brief", "lab_of_ours:brief has ended"),
            ):
                await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour=f"lab_of_ours:{behaviour}"))
                await fleet.until(lambda r=reason: fleet.holds("r1", r), 1.5, reason)  # type: ignore[misc]
                assert fleet.commanded("r1") == (0.0, 0.0)

    run_virtually(main())


def test_an_agent_can_be_cancelled_while_its_behaviour_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    users_own(
        tmp_path,
        monkeypatch,
        "import asyncio\n"
        "async def slow_to_leave(robot):\n"
        "    try:\n"
        "        await asyncio.sleep(600)\n"
        "    finally:\n"
        "        await asyncio.sleep(0.5)\n",
    )

    async def main() -> None:
        async with memory_fleet(scenario(1, "lab_of_ours:slow_to_leave")) as fleet:
            await asyncio.sleep(1.0)
            await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="circle"))
            await asyncio.sleep(0.25)  # it is shutting down
            fleet.agents["r1"].cancel()
            await fleet.until(fleet.agents["r1"].done, 1, "the end")
            assert fleet.agents["r1"].cancelled()

    run_virtually(main())


def test_the_flock_runs_as_a_users_behaviour(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))

    async def main() -> None:
        async with memory_fleet(scenario(3, "flock:flock")) as fleet:
            await fleet.until(lambda: len(fleet.driving) == 3, 3, "all flock")
            assert {fleet.healths[name].state for name in fleet.scenario.robots} <= {"flock", "holding"}
            await asyncio.sleep(20.0)
            places = [Pose2(*row) for row in fleet.plant.pose.tolist()]
            assert all(math.hypot(p.x, p.y) < 1.5 for p in places)
            assert all(fleet.healths[name].state == "flock" for name in fleet.scenario.robots)

    run_virtually(main())


def test_the_example_is_as_short_as_documented() -> None:
    assert len((EXAMPLES / "flock.py").read_text().splitlines()) < 25


# ---- what strangers may send

_HUGE = (1e12, -1e12, 1e6, 1e-300, 0.0, 5e5)


@pytest.mark.parametrize("behaviour", ["circle", "pursuit", "dubins", "steer", "coverage"])
def test_no_message_ends_an_agent(behaviour: str) -> None:
    """Every number is finite, so that the codec accepts it, and absurd."""

    async def main() -> None:
        async with memory_fleet(scenario(2, behaviour)) as fleet:
            await fleet.until(lambda: set(fleet.healths) == {"r1", "r2"}, 3, "they live")
            await asyncio.sleep(1.0)
            stranger = await fleet.bus()
            poses = stranger.publisher(channels.POSE, "r1")
            circles = stranger.publisher(channels.CIRCLE)
            speeds = stranger.publisher(channels.VELOCITY, "r1")
            snapshots = stranger.publisher(channels.ALL_POSITIONS)
            stops = stranger.publisher(channels.STOP)
            for a in _HUGE:
                for b in _HUGE:
                    poses.put(PoseFix(age=abs(b), x=a, y=b, theta=a, covariance=(b,) * 9, camera="north"))
                    poses.put(
                        PoseFix(age=0.05, x=0.1, y=0.1, theta=0.0, covariance=(a, 0, 0, 0, b, 0, 0, 0, 1), camera="x")
                    )
                    poses.put(
                        PoseFix(
                            stamp=min(abs(a), 1e11) or 1.0,
                            age=0.05,
                            x=0.0,
                            y=b,
                            theta=b,
                            covariance=(1.0,) * 9,
                            camera="north",
                        )
                    )
                    circles.put(Circle(x=a, y=b, radius=abs(b) or 1e-300))
                    speeds.put(SpeedReference(speed=a))
                    await stranger.ask(channels.GOAL_ORDER, Goal(x=a, y=b, theta=a), name="r1")
                    states = (
                        RobotState("r2", a, b, a, b, a, b, "tracking"),
                        RobotState("r9", a, a, b, a, b, a, "lost"),
                    )
                    snapshots.put(FleetSnapshot(robots=states))
                    stops.put(StopOrder(all=False, names=("r9",), revision=2**64 - 1))
                    await asyncio.sleep(0.06)
                    for name, task in fleet.agents.items():
                        assert not task.done(), f"{name} ended at {a}, {b}: {task}"
                    for v, omega in fleet.floor.commands.tolist():
                        assert abs(v) <= 0.5
                        assert abs(omega) <= 1.5
            # Normal messages again: the robots recover.
            for name in ("r1", "r2"):
                await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="circle", parameters={"speed": 0.15}))
                await fleet.until(lambda n=name: fleet.commanded(n) != (0.0, 0.0), 8, f"{name} drives again")  # type: ignore[misc]

    run_virtually(main())
