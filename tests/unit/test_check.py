"""`muro check` as a command: trials on processes, verdicts, exit codes, replays; and that it can fail."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from muro_zenoh.checking.check import Plan, Report
from muro_zenoh.checking.random_trial import random_trial
from muro_zenoh.checking.source import Trials
from muro_zenoh.checking.summary import quick_verdict, summary
from muro_zenoh.checking.trial import run_trial
from muro_zenoh.cli.main import main
from muro_zenoh.config import load_scenario, parse_scenario
from tests.support.waiting import seconds

KEYS = {
    "trials",
    "collisions",
    "min_separation_m",
    "left_arena",
    "blind_moves",
    "unfinished",
    "times_real_time",
    "worst",
    "coverage",
}

# Two robots on one line, towards each other, with the filter off: they touch, whatever else happens.
HEAD_ON = """
duration = 6
separation = { enabled = false }
robots = 3
[camera.north]
[behaviour]
name = "steer"
speed = 0.3
[starts]
r1 = [-1.0, 0.0, 0.0]
r2 = [1.0, 0.0, 3.14]
r3 = [0.0, 1.2, 0.0]
[goals]
r1 = [[1.5, 0.0]]
r2 = [[-1.5, 0.0]]
[[fault]]
kind = "delay"
target = "r3"
at = 1
delay = 0.1
[[order]]
at = 0.5
behaviour = "hold"
robots = ["r3"]
"""


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])


def check(*arguments: str, code: int) -> str:
    result = CliRunner().invoke(main, ["check", *arguments], prog_name="muro")
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception  # which has the exit code 1, too
    assert result.exit_code == code, result.output
    return result.output


class TestAFleetThatCollides:
    @pytest.fixture(autouse=True)
    def _file(self) -> None:
        Path("mine.toml").write_text(HEAD_ON)

    def test_it_is_found_and_everything_is_written(self) -> None:
        output = check("mine.toml", "--trials", "2", "--jobs", "1", "--json", "c.json", "--out", "b", code=1)
        assert "r1 touches r2 at " in output
        assert "muro check mine.toml --replay " in output
        assert "NOT PASSED: 2 seeds broke a promise" in output
        table = json.loads(Path("c.json").read_text())
        assert table.keys() >= KEYS
        assert table["collisions"] == {"ours": 2, "standing": 0, "disturbed": 0}
        assert sorted(table["worst"]) == [1, 2]
        assert table["min_separation_m"] < 0.354
        seed = table["worst"][0]
        assert Path(f"b/seed-{seed}.png").stat().st_size > 10_000
        assert Path(f"b/seed-{seed}-animation.svg").read_text().startswith("<svg")

    def test_it_is_shrunk_to_a_file_that_replays(self) -> None:
        output = check("mine.toml", "--replay", "3", "--shrink", "--out", "b", code=1)
        assert "order: hold for r3" in output
        assert "delay of r3 begins to have an effect (r3 " in output
        smallest = load_scenario("b/seed-3.toml")
        assert smallest.robots == ("r1", "r2")
        assert smallest.faults == smallest.orders == ()
        assert smallest.duration < 6.0
        assert "r1 touches r2 at " in check("b/seed-3.toml", "--replay", "3", "--out", "again", code=1)

    def test_with_the_filter_on_they_do_not_touch(self) -> None:
        assert "no promise broken" in check("mine.toml", "--set", "separation.enabled=true", "--replay", code=0)


def test_a_report_that_comes_twice_or_late_latches_no_stop() -> None:
    table = {
        "robots": 2,
        "duration": 8.0,
        "camera": {"north": {}},
        "behaviour": {"name": "circle"},
        "fault": [{"kind": "duplicate", "target": "router", "fraction": 1.0, "delay": 0.5}],
        "order": [{"at": 2.0, "kind": "stop"}, {"at": 4.0, "kind": "resume"}],
    }
    record, result = run_trial(parse_scenario(table, "lab.toml", name="lab"), 1)
    assert [given.accepted for given in record.orders] == [True, True]
    assert result.judgements["stop"].evaluated == 4  # each at its start, and once by the order
    assert not result.breaches


class TestAStudentsBehaviour:
    def test_that_may_drive(self) -> None:
        Path("turning.py").write_text("def turn(robot):\n    return 0.1, 0.5\n")
        output = check("turning.py", "--quick", "--trials", "2", "--duration", "3", "--jobs", "2", code=0)
        assert "may drive (2 trials of 3 s, no promise broken" in output

    def test_the_command_of_the_smallest_trial_finds_it(self) -> None:
        Path("mine").mkdir()
        Path("mine/dividing.py").write_text("def divide(robot):\n    return 1.0 / (robot.now - robot.now), 0.0\n")
        short = ["--robots", "1", "--duration", "1", "--replay", "1", "--shrink"]
        check("mine/dividing.py", *short, "--out", "smallest", code=1)
        command = Path("smallest/seed-1.toml").read_text().split("\n")[2].removeprefix("#").split()
        assert command[0] == f"PYTHONPATH={Path('mine').resolve()}"
        assert command[1:4] == ["muro", "check", "smallest/seed-1.toml"]

    def test_that_fails(self) -> None:
        Path("failing.py").write_text("def divide(robot):\n    return 1.0 / (robot.now - robot.now), 0.0\n")
        output = check("failing.py", "--quick", "--trials", "1", "--duration", "2", "--jobs", "1", code=1)
        assert "ZeroDivisionError" in output
        assert "(seed 1): muro check failing.py --quick --duration 2 --replay 1" in output
        assert "may not drive" in output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["rendom"], "got 'rendom', which is not a file"),
        (["random", "--robots", "3"], "everything in a random trial is drawn from its seed"),
        (["random", "--json", "nowhere/c.json"], "whose folder cannot be written to"),
        (["rendom"], "steer, random, FILE.py[:function]. Did you mean random?"),
        (["other.py"], "other.py: got No such file or directory, expected a Python file"),
        (["random", "--trials", "0"], "--trials"),
    ],
)
def test_invalid_input(arguments: list[str], message: str) -> None:
    assert message in check(*arguments, code=2)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_what_was_done_so_far(tmp_path: Path, number: signal.Signals) -> None:
    command = [sys.executable, "-m", "muro_zenoh", "check", "pursuit", "--quick", "--duration", "1", "--jobs", "1"]
    process = subprocess.Popen(
        [*command, "--trials", "10000", "--json", "c.json"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # in the background shells ignore it
    )
    assert process.stderr is not None
    assert "1 of 10000 trials" in process.stderr.readline()
    process.send_signal(number)
    process.communicate(timeout=seconds(30.0))
    assert process.returncode == 130
    table = json.loads(Path("c.json").read_text())
    assert table["interrupted"]
    assert not table["passed"]
    assert table["trials"] < 10_000


def test_a_check_that_was_interrupted_has_neither_passed_nor_may_anything_drive() -> None:
    report = Report(Plan(random_trial, trials=100, seed=1, jobs=1))
    report.interrupted = True
    assert not report.passed
    assert summary(report, "muro check").endswith("NOT PASSED (interrupted after 0 of 100 trials)")
    assert quick_verdict(report, "muro check") == "no verdict (interrupted after 0 of 100 trials)"


def test_ctrl_c_is_never_the_exit_code_of_a_broken_promise(monkeypatch: pytest.MonkeyPatch) -> None:
    def impatient(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("muro_zenoh.checking.trial.run_trial", impatient)
    assert "interrupted" in check("random", "--replay", "1", code=130)


def test_the_same_seed_gives_the_same_trial_in_another_process() -> None:
    scenario = parse_scenario(
        {"robots": 3, "duration": 2, "camera": {"north": {}}, "behaviour": {"name": "pursuit"}}, "lab.toml", name="lab"
    )
    trials = Trials(scenario, faults=2)
    digests = {run_trial(trials(5), 5)[1].digest for _ in range(2)}
    assert len(digests) == 1
    assert run_trial(trials(6), 6)[1].digest not in digests


def test_the_help_of_replay_names_no_number_that_nobody_types() -> None:
    assert "-1" not in check("--help", code=0)
    assert "got 'x', expected a seed" in check("random", "--replay", "x", code=2)
