"""``muro run`` on a real terminal: the table is drawn in place, and nothing is left behind."""

from __future__ import annotations

import json
import re
from pathlib import Path

import psutil
import pytest

from tests.support.terminal import Terminal
from tests.support.waiting import seconds

RUN = ("-m", "muro_zenoh", "run")
HIDE, SHOW = "\x1b[?25l", "\x1b[?25h"


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def gone(processes: list[psutil.Process]) -> bool:
    return not psutil.wait_procs(processes, timeout=seconds(5))[1]


def plain(text: str) -> str:
    """What was written, without control sequences."""
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text)


def test_the_table_is_drawn_in_place_and_ends_clean() -> None:
    with Terminal([*RUN, "hold", "--robots", "2", "--duration", "6", "--report", "r.json"]) as terminal:
        terminal.until("the behaviour is hold", 30)
        children = psutil.Process(terminal.pid).children()
        assert len(children) == 5
        assert terminal.wait(30) == 0
        assert gone(children)
    shown = terminal.shown
    (rows,) = {len(re.findall(r"│ r[12] ", plain(t))) for t in shown.split("┏")[2:-1]}
    assert rows == 2  # in every table
    assert shown.count("┏") > 5  # it was drawn again and again ...
    assert re.search(r"\x1b\[\d*A", shown)  # ... above itself
    assert "pose age" in shown
    assert shown.count(HIDE) == shown.count(SHOW) == 1
    after = plain(shown.rpartition("┘")[2])
    assert "hold: 2 robots, 6 s, seed 1" in after
    assert "nothing was checked" in after
    assert "Traceback" not in shown
    assert json.loads(Path("r.json").read_text())["ended"] == "duration"


@pytest.mark.parametrize("shown", ["hold: 2 robots", "the behaviour is hold"])
def test_ctrl_c_leaves_nothing_behind_and_restores_the_cursor(shown: str) -> None:
    with Terminal([*RUN, "hold", "--robots", "2"]) as terminal:
        terminal.until(shown, 30)
        children = psutil.Process(terminal.pid).children()
        terminal.type("\x03")
        assert terminal.wait(15) == 130
        assert gone(children)
    assert "interrupted" in terminal.shown
    assert terminal.shown.count(HIDE) == terminal.shown.count(SHOW)
    assert "Traceback" not in terminal.shown


def test_the_space_bar_stops_the_fleet_and_r_and_y_resume_it() -> None:
    with Terminal([*RUN, "hold", "--robots", "2", "--duration", "600"]) as terminal:
        terminal.until("the behaviour is hold", 30)
        assert "space: stop every robot   r, then y: resume   Ctrl-C: end the run" in terminal.shown
        assert not terminal.line_by_line
        terminal.type(" ")
        terminal.until("2 of 2 robots stopped", 15)
        terminal.until("stopped by order (all robots)", 5)
        assert re.search(r"r1 +\d\.\d{3} s +\d\.\d\d s +\d\.\d{3} m +has stopped", plain(terminal.shown))
        terminal.type("r")
        terminal.until("resume every robot? Press y", 5)
        terminal.type("y")
        terminal.until("resume: base station: accepted", 15)
        terminal.type("\x03")
        assert terminal.wait(15) == 130
        assert terminal.line_by_line  # as it was before
    assert "Traceback" not in terminal.shown
    (log,) = Path("runs").glob("*/muro.log")
    for said in ("stop sent", "2 of 2 robots stopped", "resume every robot?", "resume: base station: accepted"):
        assert said in log.read_text()


def test_a_run_in_the_background_is_not_suspended_by_its_terminal() -> None:
    """It has the terminal, and another process is in its foreground."""
    shell = (
        "import os, subprocess, sys; "
        "child = subprocess.Popen([sys.executable, '-P', *sys.argv[1:]], process_group=0); "
        "sys.exit(child.wait())"
    )
    with Terminal(["-c", shell, *RUN, "hold", "--robots", "1", "--duration", "2"]) as terminal:
        assert terminal.wait(30) == 0
    assert "hold: 1 robot, 2 s" in plain(terminal.shown)
    assert "space: stop" not in terminal.shown
