"""Faults of a scenario that `muro run` applies: which ones, to which processes, and when."""

from __future__ import annotations

import asyncio
import signal
import tomllib
from pathlib import Path
from typing import Any

import pytest

from muro_zenoh.cli.live import line_of, table_of
from muro_zenoh.config import Fault, Scenario, parse_scenario
from muro_zenoh.config.fault_rows import fault_of, read_faults
from muro_zenoh.config.faults import KINDS as ALL_KINDS
from muro_zenoh.config.faults import OF_THE_ROOM, RUN_KINDS, Place
from muro_zenoh.config.origin import Origin
from muro_zenoh.config.writing import faults_as_toml
from muro_zenoh.errors import ConfigError, OrderRefused
from muro_zenoh.messages import Break
from muro_zenoh.runtime.virtual_time import VirtualClock, run_virtually
from muro_zenoh.scoring.observed import FaultSeen
from muro_zenoh.scoring.view import View
from muro_zenoh.supervision.child import Child, ChildSpec
from muro_zenoh.supervision.fault_targets import befallen, cameras_apart, check_faults, relayed
from muro_zenoh.supervision.faults import Faults, Links, conditions, described
from muro_zenoh.supervision.launch import fleet_specs
from muro_zenoh.supervision.relay import GOOD, Conditions, Passage

NUMBERS: dict[str, dict[str, float]] = {
    "delay": {"delay": 0.1},
    "jitter": {"jitter": 0.05},
    "loss": {"fraction": 0.1},
    "duplicate": {"fraction": 0.1},
    "reorder": {"fraction": 0.1},
    "clock_step": {"step": 1.0},
    "carry": {"duration": 1.0},
}


def lab(*faults: dict[str, Any]) -> Scenario:
    cameras: dict[str, Any] = {"north": {}, "south": {}}
    return parse_scenario({"robots": 2, "camera": cameras, "fault": list(faults)}, "lab.toml", name="lab")


def fault(kind: str, target: str, **more: Any) -> dict[str, Any]:
    return {"kind": kind, "target": target, **NUMBERS.get(kind, {}), **more}


def target_of(kind: str) -> str:
    places = ALL_KINDS[kind].places
    return "r1/agent" if Place.AGENT in places else str(places[0])


class TestWhatIsRefused:
    @pytest.mark.parametrize("kind", sorted(set(ALL_KINDS) - set(RUN_KINDS)))
    def test_what_only_a_fleet_in_memory_can_have(self, kind: str) -> None:
        with pytest.raises(ConfigError) as refused:
            check_faults(lab(fault("freeze", "r1/agent"), fault(kind, target_of(kind))), "lab.toml")
        said = str(refused.value)
        assert said.startswith(f"lab.toml: fault[1].kind: got '{kind}', which cannot befall processes: ")
        assert "expected one of crash, restart, freeze, delay, jitter, stall, partition" in said
        assert "muro check" in said
        reasons = {"loss": "loses, duplicates and reorders nothing", "clock_step": "the clock of this machine"}
        assert reasons.get(kind, "") in said

    @pytest.mark.parametrize("kind", sorted(set(RUN_KINDS) - set(OF_THE_ROOM)))
    @pytest.mark.parametrize("target", ["r1/agent", "basestation", "camera", "camera/south", "router"])
    def test_everything_else_is_not(self, kind: str, target: str) -> None:
        check_faults(lab(fault(kind, target)), "lab.toml")

    @pytest.mark.parametrize(("kind", "target"), [("delay", "r2"), ("partition", "r2/base"), ("crash", "r2/base")])
    def test_a_base_is_not_a_process_of_its_own(self, kind: str, target: str) -> None:
        with pytest.raises(ConfigError, match=r"fault\[0\]\.target: got .*one simulator runs.*expected 'r2/agent'"):
            check_faults(lab(fault(kind, target)), "lab.toml")

    def test_the_router_of_others(self) -> None:
        there = "tcp/10.0.0.1:7447"
        check_faults(lab(fault("partition", "router"), fault("crash", "r1/agent")), "lab.toml", there)
        with pytest.raises(ConfigError, match=r"fault\[0\]\.target: got 'router', which is not a process of this run"):
            check_faults(lab(fault("freeze", "router")), "lab.toml", there)
        with pytest.raises(ConfigError, match=r"--connect: got tls/10\.0\.0\.1:7447"):
            check_faults(lab(fault("partition", "r1/agent")), "lab.toml", "tls/10.0.0.1:7447")
        check_faults(lab(fault("crash", "r1/agent")), "lab.toml", "tls/10.0.0.1:7447")


class TestWhichProcesses:
    @pytest.mark.parametrize(
        ("kind", "target", "names"),
        [
            ("freeze", "r2/agent", ("r2",)),
            ("freeze", "basestation", ("basestation",)),
            ("freeze", "router", ("router",)),
            ("freeze", "camera/south", ("camera-south",)),
            ("freeze", "camera", ("camera-north", "camera-south")),
            ("delay", "r2/agent", ("r2",)),
            ("delay", "router", ("r1", "r2", "basestation", "simulator")),
        ],
    )
    def test_a_fault_befalls(self, kind: str, target: str, names: tuple[str, ...]) -> None:
        scenario = lab(fault(kind, target))
        assert befallen(scenario.faults[0], scenario) == names
        assert relayed(scenario) == (names if kind == "delay" else ())

    def test_cameras_are_processes_only_when_a_fault_befalls_them(self, tmp_path: Path) -> None:
        for target, apart in (("basestation", False), ("camera/north", True)):
            scenario = lab(fault("stall", target), fault("delay", "router"))
            assert cameras_apart(scenario) is apart
            names = relayed(scenario)
            assert ("camera-south" in names) is apart
            specs = fleet_specs(scenario, tmp_path / "s.json", 3, tmp_path, {name: f"tcp/{name}:1" for name in names})
            commands = {spec.name: " ".join(spec.command) for spec in specs}
            assert set(commands) == set(names), "each of them has its link relayed"
            for name, command in commands.items():
                assert command.endswith(f" --connect tcp/{name}:1")
            assert ("--bases" in commands["simulator"]) is apart
            if apart:
                assert f"sim {tmp_path / 's.json'} --seed 3 --camera south" in commands["camera-south"]

    def test_a_process_without_a_fault_of_its_link_connects_to_the_router(self, tmp_path: Path) -> None:
        specs = fleet_specs(lab(), tmp_path / "s.json", 1, tmp_path, {})
        assert all("--connect" not in spec.command for spec in specs)


class TestTheStateOfALink:
    def test_faults_add_up_and_the_worst_passage_counts(self) -> None:
        kinds = ("delay", "delay", "jitter", "stall", "partition", "stall")
        faults: list[Any] = list(lab(*(fault(kind, "r1/agent") for kind in kinds)).faults)
        assert conditions(faults[:3], "in") == Conditions(0.2, 0.05)
        assert conditions(faults[3:4], "out") == Conditions(passage=Passage.STALLED)
        assert conditions(faults[3:], "out") == Conditions(passage=Passage.PARTITIONED)
        assert conditions([], "in") == GOOD

    @pytest.mark.parametrize(
        ("target", "direction", "inward", "outward"),
        [
            ("r1/agent", "both", 0.1, 0.1),
            ("r1/agent", "in", 0.1, 0.0),
            ("r1/agent", "out", 0.0, 0.1),
            ("router", "both", 0.1, 0.1),
            ("router", "in", 0.0, 0.1),
            ("router", "out", 0.1, 0.0),
        ],
    )
    def test_directions_are_as_the_target_sees_them(
        self, target: str, direction: str, inward: float, outward: float
    ) -> None:
        faults: Any = lab(fault("delay", target, direction=direction)).faults
        assert conditions(faults, "in").delay == inward
        assert conditions(faults, "out").delay == outward


class FakeChild(Child):
    """A child that only records what is done to it."""

    def __init__(self, name: str, log: list[tuple[float, str, str]]) -> None:
        super().__init__(ChildSpec(name, (), {}), Path(), -1)
        self.pid = 1
        self._done = log

    def note(self, what: str) -> None:
        self._done.append((round(asyncio.get_running_loop().time(), 3), self.spec.name, what))

    def signal(self, number: signal.Signals) -> bool:
        self.note(number.name)
        return True

    def kill(self) -> None:
        self.note("kill, " + ("may restart" if self.may_restart.is_set() else "stays dead"))


class Run:
    """Faults that are applied to fake children in virtual time, from 10 s on."""

    def __init__(self, scenario: Scenario, missing: str = "") -> None:
        self.done: list[tuple[float, str, str]] = []
        self.said: list[str] = []
        self.links: list[tuple[float, tuple[str, ...]]] = []
        self.children = {name: FakeChild(name, self.done) for name in ("r1", "r2", "basestation", "router")}
        if missing:
            self.children[missing].pid = None
        links = Links(scenario, 1)
        links.befall = self._note  # type: ignore[method-assign]
        self.room: list[tuple[float, str]] = []
        self.refused = ""
        self.changes = 0
        self.faults = Faults(
            scenario, links, lambda: self.children, VirtualClock(), self.said.append, self._in_room, self._changed
        )

    def _changed(self) -> None:
        self.changes += 1

    async def _in_room(self, fault: Fault) -> None:
        if self.refused:
            raise OrderRefused(self.refused)
        self.room.append((round(asyncio.get_running_loop().time(), 3), described(fault)))

    def _note(self, lasting: Any) -> None:
        self.links.append((asyncio.get_running_loop().time(), tuple(described(fault) for fault in lasting)))

    async def to_its_end(self) -> None:
        await asyncio.sleep(10.0)
        await self.faults.run(10.0)


def test_each_fault_begins_and_ends_at_its_time() -> None:
    async def main() -> None:
        run = Run(
            lab(
                fault("crash", "r1/agent", at=1.0),
                fault("freeze", "r2/agent", at=2.0, duration=1.0),
                fault("crash", "basestation", at=4.0, until=6.0),
                fault("restart", "router", at=5.0),
                fault("delay", "r1/agent", at=0.5, duration=3.0),
                fault("partition", "r2/agent", at=1.5, direction="in"),
            )
        )
        await run.to_its_end()
        assert run.done == [
            (11.0, "r1", "kill, may restart"),
            (12.0, "r2", "SIGSTOP"),
            (13.0, "r2", "SIGCONT"),
            (14.0, "basestation", "kill, stays dead"),
            (15.0, "router", "SIGTERM"),
            (15.0, "router", "SIGCONT"),
        ]
        assert run.children["basestation"].may_restart.is_set()
        assert run.links == [
            (10.5, ("delay 100 ms r1/agent",)),
            (11.5, ("delay 100 ms r1/agent", "partition in r2/agent")),
            (13.5, ("partition in r2/agent",)),
        ]
        assert run.faults.lasting == ("partition in r2/agent",)
        assert run.faults.seen == (
            FaultSeen("crash", "r1/agent", 1.0, None, 1.7e9 + 11.0),
            FaultSeen("freeze", "r2/agent", 2.0, 3.0, 1.7e9 + 12.0),
            FaultSeen("crash", "basestation", 4.0, 6.0, 1.7e9 + 14.0),
            FaultSeen("restart", "router", 5.0, None, 1.7e9 + 15.0),
            FaultSeen("delay", "r1/agent", 0.5, 3.5, 1.7e9 + 10.5),
            FaultSeen("partition", "r2/agent", 1.5, None, 1.7e9 + 11.5),
        )
        assert run.said == [
            "fault: delay 100 ms r1/agent",
            "fault: crash r1/agent",
            "fault: partition in r2/agent",
            "fault: freeze r2/agent",
            "fault over: freeze r2/agent",
            "fault over: delay 100 ms r1/agent",
            "fault: crash basestation",
            "fault: restart router",
            "fault over: crash basestation",
        ]

    run_virtually(main())


def test_a_fault_of_a_process_that_is_not_running_has_no_effect_and_says_so() -> None:
    async def main() -> None:
        run = Run(lab(fault("freeze", "r1/agent", at=1.0, duration=1.0)), missing="r1")
        await run.to_its_end()
        assert run.faults.seen[0].note == "r1 was not running"
        assert run.said[0] == "fault: freeze r1/agent: r1 was not running"

    run_virtually(main())


def test_what_has_not_begun_when_the_run_ends_is_reported_as_that() -> None:
    async def main() -> None:
        run = Run(lab(fault("freeze", "r1/agent", at=1.0), fault("freeze", "r2/agent", at=5.0)))
        befalling = asyncio.create_task(run.to_its_end())
        await asyncio.sleep(13.0)
        befalling.cancel()
        await asyncio.wait({befalling})
        assert run.faults.lasting == ("freeze r1/agent",)
        assert run.faults.seen[0].begin == 1.0
        assert run.faults.seen[1] == FaultSeen("freeze", "r2/agent")
        assert len(run.done) == 1

    run_virtually(main())


class TestOnAnOperatorsOrder:
    @staticmethod
    def now(run: Run, kind: str, target: str, **more: Any) -> Fault:
        at = run.faults.elapsed
        order = Break(fault=kind, target=target, duration=more.pop("duration", None), numbers=more)
        return fault_of(order, lab(), at)

    def test_it_happens_at_once_and_is_a_row_of_the_scenario(self) -> None:
        async def main() -> None:
            run = Run(lab())
            await run.to_its_end()
            await asyncio.sleep(2.0)
            assert await run.faults.let_happen(self.now(run, "freeze", "r1/agent", duration=1.0)) == ""
            assert await run.faults.let_happen(self.now(run, "carry", "r2", duration=0.5, x=0.3)) == ""
            await asyncio.sleep(0.1)
            assert run.faults.lasting == ("freeze r1/agent", "carry r2")
            await asyncio.sleep(2.0)
            assert run.done == [(12.0, "r1", "SIGSTOP"), (13.0, "r1", "SIGCONT")]
            assert run.room == [(12.0, "carry r2")], "once: the simulator ends it itself"
            assert run.faults.lasting == ()
            assert [(f.kind, f.at, f.duration) for f in run.faults.ordered] == [
                ("freeze", 2.0, 1.0),
                ("carry", 2.0, 0.5),
            ]
            assert [seen.end for seen in run.faults.seen] == [3.0, 2.5]
            assert run.changes == 4
            again = tomllib.loads(faults_as_toml(run.faults.ordered))["fault"]
            assert read_faults(again, 60.0, Origin("lab.toml"), ("r1", "r2"), ()) == run.faults.ordered

        run_virtually(main())

    def test_what_cannot_happen_leaves_no_trace(self) -> None:
        async def main() -> None:
            run = Run(lab())
            await run.to_its_end()
            run.refused = "no room for it"
            del run.children["basestation"]
            for kind, target, reason in (
                ("carry", "r1", "no room for it"),
                ("crash", "basestation", "this run has no process basestation"),
                ("crash", "camera", "this run has no process camera-north"),
                ("partition", "basestation", "this run has no process basestation"),
            ):
                with pytest.raises(OrderRefused, match=reason):
                    await run.faults.let_happen(self.now(run, kind, target, **NUMBERS.get(kind, {})))
            with pytest.raises(ConfigError, match="one simulator runs the bases"):
                await run.faults.let_happen(self.now(run, "crash", "r1/base"))
            run.children["basestation"] = FakeChild("basestation", run.done)
            with pytest.raises(OrderRefused, match="without a relay"):
                await run.faults.let_happen(self.now(run, "partition", "basestation"))
            assert (run.done, run.faults.ordered, run.faults.seen) == ([], (), ())

        run_virtually(main())

    def test_nothing_begins_or_ends_after_the_run(self) -> None:
        async def main() -> None:
            run = Run(lab())
            await run.to_its_end()
            await run.faults.let_happen(self.now(run, "freeze", "r1/agent", duration=5.0))
            await asyncio.sleep(1.0)
            await run.faults.close()
            await asyncio.sleep(10.0)
            assert run.done == [(10.0, "r1", "SIGSTOP")]

        run_virtually(main())


def test_a_fault_of_the_room_is_the_simulators() -> None:
    async def main() -> None:
        run = Run(lab(fault("carry", "r1", at=1.0), fault("camera_dropout", "camera", at=3.0, duration=1.0)))
        befalling = asyncio.create_task(run.to_its_end())
        await asyncio.sleep(11.5)
        run.refused = "no such camera here"
        await befalling
        assert run.room == [(11.0, "carry r1")]
        assert run.said == [
            "fault: carry r1",
            "fault over: carry r1",
            "fault: camera_dropout camera: no such camera here",
            "fault over: camera_dropout camera",
        ]
        assert run.done == []

    run_virtually(main())


def test_the_live_view_names_the_faults_that_last() -> None:
    view = View(1.0, 60.0, [], None, None, 0, ("freeze r1/agent", "delay 100 ms r2/agent"))
    assert "restarts 0  faults: freeze r1/agent, delay 100 ms r2/agent" in line_of(view)
    assert "faults: freeze r1/agent" in table_of(view).title
    assert "faults" not in line_of(view._replace(faults=()))
