"""What a run's collector makes of the messages of a fleet, through restarts of its processes."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from typing import Any

import pytest
import pytest_asyncio

from muro_zenoh import channels, geometry
from muro_zenoh.config import find_scenario
from muro_zenoh.messages import (
    BaseState,
    Calibration,
    Circle,
    FleetSnapshot,
    Health,
    PlannedPath,
    RobotState,
    Truth,
    VelocityCommand,
)
from muro_zenoh.scoring import reports
from muro_zenoh.scoring.collector import Collector
from muro_zenoh.scoring.observed import Observed
from muro_zenoh.scoring.reports import keep_newest
from muro_zenoh.scoring.view import view_of
from muro_zenoh.transport import Bus, MemoryNetwork, make_bus
from tests.support.clock import ManualClock

SCENARIO = find_scenario("pursuit", 2)


@dataclass
class Lab:
    """A network with a collector, and processes that report."""

    network: MemoryNetwork
    clock: ManualClock
    collector: Collector
    buses: dict[str, Bus] = field(default_factory=dict)

    async def settle(self) -> None:
        for _ in range(8):
            await asyncio.sleep(0)

    def bus(self, name: str) -> Bus:
        if name not in self.buses:
            self.buses[name] = make_bus(self.network.link(), "muro", clock=self.clock)
        return self.buses[name]

    async def restart(self, name: str) -> None:
        await self.buses.pop(name).close()

    async def health(self, name: str, role: str = "agent", **fields: Any) -> None:
        self.bus(name).publisher(channels.HEALTH, name).put(Health(role=role, state="driving", **fields))
        await self.settle()

    async def truth(self, name: str, x: float, y: float) -> None:
        self.bus("simulator").publisher(channels.TRUTH, name).put(Truth(x=x, y=y, theta=0.0, v=0.0, omega=0.0))
        await self.settle()

    def observed(self) -> Observed:
        return self.collector.observed(duration=10.0, seed=1, ended="duration", restarts=0, processes={})


@pytest_asyncio.fixture
async def lab() -> AsyncIterator[Lab]:
    network, clock = MemoryNetwork(), ManualClock()
    async with make_bus(network.link(), "muro", clock=clock) as bus:
        collector = Collector(bus, SCENARIO)
        hearing = asyncio.create_task(collector.collect_health())
        await asyncio.sleep(0)
        lab = Lab(network, clock, collector)
        yield lab
        hearing.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await hearing
        for other in lab.buses.values():
            await other.close()


async def test_fixes_are_counted_between_reports(lab: Lab) -> None:
    lab.collector.begin()
    for fixes in (7, 27, 47):
        lab.clock.advance(1.0)
        await lab.health("r1", numbers={"fixes": fixes})
    assert lab.collector.fix_rate("r1") == pytest.approx(20.0)
    assert lab.collector.fix_rate("r2") is None


async def test_the_time_that_an_agent_was_dead_counts(lab: Lab) -> None:
    lab.collector.begin()
    for fixes in (10, 30):
        lab.clock.advance(1.0)
        await lab.health("r1", numbers={"fixes": fixes})
    await lab.restart("r1")
    lab.clock.advance(3.0)
    await lab.health("r1", numbers={"fixes": 16})
    # 20 fixes before the restart and 16 after it, in 4 s
    assert lab.collector.fix_rate("r1") == pytest.approx(9.0)


async def test_an_agent_that_died_before_its_first_report_counts_from_the_beginning(lab: Lab) -> None:
    await lab.health("r1", numbers={"fixes": 0})
    lab.collector.begin()
    await lab.restart("r1")
    lab.clock.advance(4.0)
    await lab.health("r1", numbers={"fixes": 40})
    assert lab.collector.fix_rate("r1") == pytest.approx(10.0)


async def test_the_first_report_covers_the_time_before_too(lab: Lab) -> None:
    await lab.health("r1", samples={"pose_age_s": (9.0,)})
    lab.collector.begin()
    for k in range(3):
        lab.clock.advance(1.0)
        await lab.health("r1", samples={"pose_age_s": (0.1 * k,), "pose_to_command_s": (0.001, 0.002)})
    seen = lab.observed()
    assert seen.pose_age == pytest.approx([0.1, 0.2])
    assert seen.pose_to_command == [0.001, 0.002] * 2


async def test_collisions_are_added_up_over_restarts_of_the_simulator(lab: Lab) -> None:
    assert lab.observed().collisions is None
    assert lab.observed().wall_contacts is None
    lab.collector.begin()
    await lab.health("simulator", "simulator", numbers={"collisions": 2, "min_separation_m": 0.3})
    await lab.health("simulator", "simulator", numbers={"collisions": 3, "wall_contacts": 1, "min_separation_m": 0.2})
    await lab.restart("simulator")
    await lab.health("simulator", "simulator", numbers={"collisions": 1, "wall_contacts": 2})
    seen = lab.observed()
    assert seen.collisions == 4
    assert seen.wall_contacts == 3
    assert seen.min_separation == 0.2


async def test_an_old_truth_is_ignored(lab: Lab) -> None:
    lab.collector.begin()
    await lab.truth("r1", 0.8, 0.0)
    await lab.truth("r2", -0.8, 0.0)
    lab.collector.take_sample()
    lab.clock.advance(0.4)
    await lab.truth("r2", -0.8, 0.1)
    lab.clock.advance(0.2)
    lab.collector.take_sample()
    first, second = lab.collector.samples
    assert first.positions == {"r1": (0.8, 0.0), "r2": (-0.8, 0.0)}
    assert second.positions == {"r2": (-0.8, 0.1)}
    assert second.t == pytest.approx(0.6)


async def test_nothing_is_kept_before_the_scenario_begins(lab: Lab) -> None:
    await lab.truth("r1", 0.8, 0.0)
    lab.collector.take_sample()
    assert lab.collector.samples == []
    assert lab.collector.latest.positions == {"r1": (0.8, 0.0)}


async def test_the_circle_is_the_current_one(lab: Lab) -> None:
    assert lab.collector.circle.radius == 0.8
    lab.bus("basestation").publisher(channels.CIRCLE).put(Circle(x=0.1, y=0.0, radius=0.9, clockwise=True))
    await lab.settle()
    assert lab.collector.circle == geometry.Circle(0.1, 0.0, 0.9, True)


async def test_calibrations_are_evaluated_after_ten_seconds_on_the_circle(lab: Lab) -> None:
    lab.collector.begin()
    await lab.health("simulator", "simulator", numbers={"scale_v_r1": 0.8, "scale_omega_r1": 1.1})

    async def calibrate(cal0: float, cal_d: float) -> None:
        lab.bus("r1").publisher(channels.CAL_OMEGA, "r1").put(Calibration(value=cal0, sigma=0.01))
        lab.bus("r1").publisher(channels.CAL_V, "r1").put(Calibration(value=cal_d, sigma=0.01))
        await lab.settle()

    await calibrate(1.0, 1.0)
    for k in range(201):
        await lab.truth("r1", 1.0 if k < 50 else 0.82, 0.0)  # on the circle from 5 s on
        if k == 100:
            await calibrate(0.9, 1.2)
        if k == 180:
            await calibrate(1 / 1.1, 1.25)
        lab.collector.take_sample()
        lab.clock.advance(0.1)
    seen = lab.observed()
    assert seen.calibration_error_10s == {"r1": pytest.approx(0.04)}  # 1.2 * 0.8 = 0.96; 0.9 * 1.1 = 0.99
    assert seen.calibration["r1"].error == pytest.approx(0.0)
    assert seen.calibration["r2"].error is None


async def test_a_failure_is_kept_though_the_next_behaviour_runs(lab: Lab) -> None:
    await lab.health("r1", failure="behaviour lab:early: before the beginning")
    lab.collector.begin()
    await lab.health("r2")
    await lab.health("r2", failure="behaviour lab:swim: out of water")
    await lab.health("r2", failure="behaviour lab:swim: another one")
    await lab.health("r2")
    assert lab.observed().failures == {
        "r1": "behaviour lab:early: before the beginning",
        "r2": "behaviour lab:swim: out of water",
    }


async def test_samples_have_the_stopped_robots(lab: Lab) -> None:
    lab.collector.begin()
    for latched in (False, True, False):
        await lab.health("r1", stop_latched=latched)
        lab.collector.take_sample()
    assert [sample.stopped for sample in lab.collector.samples] == [frozenset(), {"r1"}, frozenset()]


async def test_robots_are_seen_when_they_were_in_any_snapshot(lab: Lab) -> None:
    lab.collector.begin()
    snapshots = lab.bus("basestation").publisher(channels.ALL_POSITIONS)
    lab.collector.take_sample()
    assert set(lab.observed().seen) == set()
    for name in ("r1", "r9"):  # a restarted base station has seen no robot
        snapshots.put(FleetSnapshot(robots=(RobotState(name, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1, "lost"),)))
        await lab.settle()
        lab.collector.take_sample()
    assert set(lab.observed().seen) == {"r1", "r9"}


async def test_the_largest_command_of_all_is_kept() -> None:
    """Of every robot, over its limits of 0.5 m/s and 1.5 rad/s, forwards and backwards, driving and turning."""
    scenario = find_scenario("pursuit", 2, {"checks.command_ratio": 1.0, "all.v_max": 0.5})
    network, clock = MemoryNetwork(), ManualClock()
    async with make_bus(network.link(), "muro", clock=clock) as bus, make_bus(network.link(), "muro") as other:
        collector = Collector(bus, scenario)
        running = asyncio.create_task(collector.run())
        await asyncio.sleep(0)
        ratios = []
        for name, v, omega in (("r1", 0.2, 0.3), ("r2", -0.3, 0.0), ("r1", 0.0, -1.2), ("r2", 0.1, 0.0)):
            other.publisher(channels.CMD_VEL, name).put(VelocityCommand(v=v, omega=omega))
            for _ in range(8):
                await asyncio.sleep(0)
            seen = collector.observed(duration=1.0, seed=1, ended="duration", restarts=0, processes={})
            ratios.append(seen.command_ratio)
        running.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await running
    assert ratios == pytest.approx([0.4, 0.6, 0.8, 0.8])


async def test_the_operator_s_view(lab: Lab) -> None:
    lab.collector.begin()
    await lab.truth("r1", 0.8, 0.0)
    await lab.truth("r2", 0.0, 0.9)
    await lab.health(
        "r1",
        numbers={"command_rate_hz": 31.0},
        samples={"pose_age_s": (0.05, 0.06, 0.2)},
        reasons=("stopped by order",),
    )
    lab.collector.take_sample()
    view = view_of(lab.collector, SCENARIO, 3)
    one, two = view.rows
    assert (one.name, one.state, one.reasons, one.pose_age, one.command_rate) == (
        "r1",
        "driving",
        "stopped by order",
        0.06,
        31,
    )
    assert one.gap == pytest.approx(1.5708, abs=1e-4)
    assert (two.name, two.state, two.reasons, two.pose_age) == ("r2", "-", "no report yet", None)
    assert two.distance == pytest.approx(0.1)
    assert view.radius_error == pytest.approx(0.1)
    assert view.spacing_error == pytest.approx(1.5708, abs=1e-4)
    assert view.restarts == 3


async def test_a_frozen_agent_or_base_does_not_count_as_driving(lab: Lab) -> None:
    async def base(dead_man: bool) -> None:
        state = BaseState(battery=1.0, charging=False, bumper=False, cliff=False, wheel_drop=False, dead_man=dead_man)
        lab.bus("base").publisher(channels.BASE, "r1").put(state)
        await lab.settle()

    await lab.health("r1")
    await lab.health("r2", note="keeps clear of r1")
    r1, r2 = view_of(lab.collector, SCENARIO, 0).rows
    assert r1.driving
    assert (r2.driving, r2.note) == (True, "keeps clear of r1")
    await base(dead_man=False)
    assert view_of(lab.collector, SCENARIO, 0).driving == 2
    await base(dead_man=True)  # its agent has just been frozen, and has reported nothing else
    r1, _ = view_of(lab.collector, SCENARIO, 0).rows
    assert (r1.driving, r1.reasons) == (False, "its base receives no commands")
    await base(dead_man=False)
    lab.clock.advance(channels.BASE.stale_after + 0.01)
    r1, _ = view_of(lab.collector, SCENARIO, 0).rows
    assert (r1.driving, r1.reasons) == (False, "its base is silent")


async def test_a_robot_whose_agent_no_longer_reports_does_not_count_as_driving(lab: Lab) -> None:
    lab.collector.begin()
    for name in ("r1", "r2"):
        await lab.health(name, numbers={"command_rate_hz": 31.0}, samples={"pose_age_s": (0.05,)})
    lab.clock.advance(channels.HEALTH.stale_after)
    assert view_of(lab.collector, SCENARIO, 0).driving == 2
    lab.clock.advance(1.0)
    await lab.health("r1")
    view = view_of(lab.collector, SCENARIO, 0)
    assert view.driving == 1
    frozen = view.rows[1]
    assert (frozen.driving, frozen.state, frozen.reasons) == (False, "-", "no report for 4 s")
    assert (frozen.pose_age, frozen.command_rate) == (None, None)


@pytest.mark.parametrize(
    ("scenario", "circles", "spreads"),
    [("pursuit", True, True), ("circle", True, False), ("importance", True, False), ("hold", False, False)],
)
async def test_the_table_has_only_what_the_behaviour_is_to_achieve(scenario: str, circles: bool, spreads: bool) -> None:
    network, settings = MemoryNetwork(), find_scenario(scenario, 2)
    async with make_bus(network.link(), "muro", clock=ManualClock()) as bus:
        collector = Collector(bus, settings)
        for name in settings.robots:
            bus.publisher(channels.TRUTH, name).put(Truth(x=0.8, y=0.0, theta=0.0, v=0.0, omega=0.0))
        await asyncio.sleep(0)
        collector.take_sample()
        view = view_of(collector, settings, 0)
    assert (view.radius_error is not None, view.spacing_error is not None) == (circles, spreads)
    assert {row.distance is not None for row in view.rows} == {circles}
    assert {row.gap is not None for row in view.rows} == {spreads}


async def test_an_invalid_path_does_not_end_the_collector(lab: Lab, caplog: pytest.LogCaptureFixture) -> None:
    collecting = asyncio.create_task(lab.collector._collect_paths())
    await lab.settle()
    publisher = lab.bus("r1").publisher(channels.PATH, "r1")
    for length in (-1.0, 1.0):
        publisher.put(PlannedPath(x=0.0, y=0.0, theta=0.0, segments=((length, 0.0),)))
        await lab.settle()
    assert not collecting.done()
    assert [planned.path.length for planned in lab.collector._planned["r1"]] == [1.0]
    assert "r1 published an invalid path" in caplog.text
    collecting.cancel()
    await asyncio.wait({collecting})


def test_of_what_is_collected_the_newest_are_kept() -> None:
    items: list[int] = []
    for k in range(1000):
        items.append(k)
        keep_newest(items, 10)
        assert items[-1] == k
        assert min(10, k + 1) <= len(items) < 20
    assert items == list(range(items[0], 1000))


async def test_measurements_do_not_fill_the_memory(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reports, "_MAX_MEASUREMENTS", 100)
    lab.collector.begin()
    for _ in range(20):
        await lab.health("r1", samples={"pose_age_s": (0.1,) * 50, "pose_to_command_s": (0.01,) * 50})
    agents = lab.collector._agents
    assert 100 <= len(agents.pose_age) < 200
    assert 100 <= len(agents.pose_to_command) < 200


async def test_samples_and_paths_do_not_fill_the_memory(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("muro_zenoh.scoring.collector._MAX_SAMPLES", 10)
    monkeypatch.setattr("muro_zenoh.scoring.collector._MAX_PATHS", 10)
    collecting = asyncio.create_task(lab.collector._collect_paths())
    await lab.settle()
    lab.collector.begin()
    publisher = lab.bus("r1").publisher(channels.PATH, "r1")
    for k in range(35):
        lab.collector.take_sample()
        publisher.put(PlannedPath(x=0.0, y=0.0, theta=0.0, segments=((1.0 + k, 0.0),)))
        await lab.settle()
    assert 10 <= len(lab.collector.samples) < 20
    planned = lab.collector._planned["r1"]
    assert 10 <= len(planned) < 20
    assert planned[-1].path.length == 35.0
    collecting.cancel()
    await asyncio.wait({collecting})
