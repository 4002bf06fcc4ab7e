"""What `muro check` is asked to check: random trials, scenarios, a student's file."""

from __future__ import annotations

import importlib
import pickle
import sys
import tomllib
from collections import Counter
from pathlib import Path

import pytest

from muro_zenoh.checking.coverage import CELLS, ROLES, Activity
from muro_zenoh.checking.random_trial import DURATION, random_trial
from muro_zenoh.checking.source import QUICK_DURATION, QUICK_ROBOTS, Trials, trials_of
from muro_zenoh.config import Scenario, parse_scenario
from muro_zenoh.config.writing import as_toml
from muro_zenoh.errors import ConfigError

FLOCK = "def flock(robot):\n    return 0.1, 0.2\n"


def trials(given: str, *, robots: int | None = None, duration: float | None = None, quick: bool = False) -> Trials:
    return trials_of(given, robots=robots, duration=duration, quick=quick, overrides={})


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delitem(sys.modules, "mine", raising=False)
    importlib.invalidate_caches()


class TestRandomTrials:
    def test_the_same_seed_gives_the_same_trial(self) -> None:
        assert random_trial(17) == random_trial(17) != random_trial(18)

    def test_each_has_two_faults_and_a_change_of_behaviour_in_thirty_seconds(self) -> None:
        for seed in range(60):
            trial = random_trial(seed)
            assert len(trial.faults) == 2
            assert trial.duration == DURATION >= 30.0
            assert any(order.kind == "behaviour" and 1.0 < order.at < 25.0 for order in trial.orders)
            assert len(trial.robots) == 10

    def test_every_cell_of_the_coverage_table_has_a_trial_that_aims_at_it(self) -> None:
        aimed = Counter()
        for seed in range(len(CELLS)):
            trial = random_trial(seed)
            fault = trial.faults[0]
            kinds = {order.kind for order in trial.orders if order.at < fault.at and order.kind != "resume"}
            if fault.at < 1.0:
                aimed[fault.kind, ROLES[fault.place], Activity.STARTING] += 1
            elif any(order.behaviour == "hold" and order.at < fault.at for order in trial.orders):
                aimed[fault.kind, ROLES[fault.place], Activity.HOLDING] += 1
            elif "stop" in kinds:
                aimed[fault.kind, ROLES[fault.place], Activity.STOPPED] += 1
            else:
                aimed[fault.kind, ROLES[fault.place], Activity.DRIVING] += 1
        # A stop at another time may come before a fault that is aimed at a robot that drives.
        missed = [cell for cell in CELLS if not aimed[tuple(cell)] and cell.activity is not Activity.DRIVING]
        assert missed == []
        assert sum(1 for cell in CELLS if aimed[tuple(cell)]) > 0.9 * len(CELLS)

    def test_robots_are_stopped_while_the_base_station_is_cut_off(self) -> None:
        during = Counter()
        for seed in range(len(CELLS)):
            trial = random_trial(seed)
            for fault in trial.faults:
                stops = [order.at for order in trial.orders if order.kind == "stop" and not order.robots]
                during[fault.kind, fault.target] += any(fault.at <= at < fault.end for at in stops)
        for kind in ("delay", "partition", "stall", "freeze", "crash"):
            assert during[kind, "basestation"], kind

    def test_one_robot_is_stopped_while_messages_to_the_base_station_are_lost(self) -> None:
        """It hears of that stop by the order and that robot's health, and repeats that nobody is stopped until then."""
        lost = [
            order.robots
            for trial in map(random_trial, range(1000))
            for fault in trial.faults
            for order in trial.orders
            if (fault.kind, fault.target, order.kind) == ("loss", "basestation", "stop")
            and fault.at <= order.at < fault.end
        ]
        assert sum(len(robots) == 1 for robots in lost) >= 5

    def test_nothing_else_takes_robots_out_of_the_state_that_a_cell_of_the_table_is_about(self) -> None:
        for seed in range(2 * len(CELLS)):
            trial = random_trial(seed)
            begin, orders = trial.faults[0].at, trial.orders
            holds = [order.at for order in orders if order.behaviour == "hold"]
            if holds:
                assert not [o for o in orders if o.kind == "behaviour" and holds[0] < o.at <= begin], seed
            stops = [order for order in orders if order.kind == "stop" and order.at < begin]
            others = [fault for fault in trial.faults if fault.target == "basestation"]
            if begin > 1.0 and stops and not others:
                lifts = [o.at for o in orders if o.kind == "resume" and o.robots in ((), stops[0].robots)]
                assert not [at for at in lifts if stops[0].at < at <= begin], seed

    def test_one_can_be_written_to_a_file_and_read_again(self) -> None:
        for seed in range(60):
            trial = random_trial(seed)
            assert parse_scenario(tomllib.loads(as_toml(trial)), "random.toml", name="random") == trial

    def test_it_takes_no_settings(self) -> None:
        with pytest.raises(ConfigError, match="everything in a random trial is drawn from its seed"):
            trials("random", robots=5)


class TestAScenario:
    def test_gets_two_faults_for_each_seed(self) -> None:
        given = trials("pursuit")
        first, second = given(1), given(2)
        assert first.behaviour.name == "pursuit"
        assert len(first.faults) == 2
        assert first.faults != second.faults
        assert first == given(1)
        assert first.duration == DURATION

    def test_that_says_what_happens_is_taken_as_it_is(self) -> None:
        Path("mine.toml").write_text(
            'duration = 9\n[camera.north]\n[[fault]]\nkind = "crash"\ntarget = "basestation"\nat = 3\n'
        )
        trial = trials("mine.toml")(5)
        assert [fault.kind for fault in trial.faults] == ["crash"]
        assert trial.duration == 9.0

    def test_quick_is_short_and_without_faults(self) -> None:
        trial = trials("pursuit", quick=True)(1)
        assert trial.faults == ()
        assert len(trial.robots) == QUICK_ROBOTS
        assert trial.duration == QUICK_DURATION

    def test_without_a_camera(self) -> None:
        Path("mine.toml").write_text("robots = 3\n")
        with pytest.raises(ConfigError, match=r"mine\.toml: camera: got none"):
            trials("mine.toml")


class TestAStudentsFile:
    @staticmethod
    def scenario(text: str, given: str = "mine.py") -> Scenario:
        sys.modules.pop("mine", None)
        Path("mine.py").write_text(text)
        return trials(given)(1)

    def test_its_one_function_is_the_behaviour(self) -> None:
        assert self.scenario(FLOCK).behaviour.name == "mine:flock"

    def test_the_function_of_a_robot_is_it_among_others(self) -> None:
        text = f"import math\n\ndef square(x):\n    return x * x\n\n\nasync {FLOCK}\n\ndef _own(robot):\n    pass\n"
        assert self.scenario(text).behaviour.name == "mine:flock"

    def test_which_of_two_is_asked(self) -> None:
        with pytest.raises(ConfigError, match=r"got 2 functions .*\(flock, spin\).*Name it: mine\.py:flock"):
            self.scenario(FLOCK + FLOCK.replace("flock", "spin"))
        assert self.scenario(FLOCK + FLOCK.replace("flock", "spin"), "mine.py:spin").behaviour.name == "mine:spin"

    def test_none(self) -> None:
        with pytest.raises(ConfigError, match=r"got 0 functions .*expected one `def f\(robot\)`"):
            self.scenario("x = 1\n")

    def test_that_is_not_python(self) -> None:
        with pytest.raises(ConfigError, match=r"mine\.py:2: got .*expected Python"):
            self.scenario("x = 1\ndef flock(robot:\n")

    def test_that_is_not_there(self) -> None:
        with pytest.raises(ConfigError, match=r"other\.py: got .*No such file"):
            trials("other.py")

    def test_it_can_be_sent_to_another_process(self) -> None:
        Path("mine.py").write_text(FLOCK)
        given = trials("mine.py")
        assert pickle.loads(pickle.dumps(given))(3) == given(3)
