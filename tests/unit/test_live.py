"""What an operator sees: the plain line and the table."""

from __future__ import annotations

import io
from typing import Any

import pytest
from rich.console import Console

from muro_zenoh.cli.live import PlainScreen, TableScreen, line_of, table_of
from muro_zenoh.scoring.observed import Calibrated
from muro_zenoh.scoring.view import RobotRow, View

KNOWN = RobotRow("r1", "pursuit", "", 0.0612, 0.0042, 1.257, 33.4, Calibrated(1.051, 0.912, None, None))
UNKNOWN = RobotRow("r2", "-", "no report yet", None, None, None, None, Calibrated(None, None, None, None))
HOLDING = RobotRow("r3", "holding", "no report yet", None, None, None, None, Calibrated(None, None, None, None))


def view(**changes: Any) -> View:
    return View(12.34, 60.0, [KNOWN, UNKNOWN], 0.0042, 0.031, 1)._replace(**changes)


def test_the_line_has_the_worst_of_all_robots() -> None:
    assert line_of(view(rows=[KNOWN, KNOWN._replace(name="r2", pose_age=0.08)])) == (
        "  12.3 s  driving 2/2  radius error 0.004 m  spacing error 0.031 rad  pose age 80 ms  restarts 1"
    )


def test_the_line_has_the_reasons_why_robots_do_not_drive() -> None:
    line = line_of(view(rows=[KNOWN, UNKNOWN, HOLDING], radius_error=None, spacing_error=None))
    assert "driving 1/3  radius error -  spacing error -" in line
    assert line.endswith("restarts 1  r2 r3: no report yet")


def test_the_table_shows_units_and_reasons_literally() -> None:
    # rich would take [m] for markup, and "[/x]" in a robot's reason for its end: an error that ends the whole run.
    screen = TableScreen()
    with screen._console.capture() as shown:
        screen._console.width = 160
        screen._console.print(table_of(view(rows=[HOLDING._replace(state="[b]", reasons="see [/x] and [m/s]")])))
    text = shown.get()
    for word in ("[ms]", "[m]", "[rad]", "[b]", "see [/x] and [m/s]"):
        assert word in text


def test_the_table_has_a_row_for_each_robot() -> None:
    out = io.StringIO()
    Console(file=out, width=120).print(table_of(view()))
    lines = out.getvalue().splitlines()
    (r1,) = [line for line in lines if "r1" in line]
    (r2,) = [line for line in lines if "r2" in line]
    assert r1.replace("│", " ").split() == ["r1", "pursuit", "61", "0.004", "1.26", "33.4", "1.051", "0.912"]
    assert r2.replace("│", " ").split() == ["r2", "-", "-", "-", "-", "-", "-", "-", "no", "report", "yet"]
    assert "12 of 60 s   radius error 0.004 m   spacing error 0.031 rad   restarts 1" in lines[0]


def test_complaints_are_shown_of_robots_that_drive_too() -> None:
    rows = [KNOWN._replace(complaints="clock 41 ms behind the base station's (limit 20 ms)")]
    assert line_of(view(rows=rows)).endswith("restarts 1  r1: clock 41 ms behind the base station's (limit 20 ms)")
    assert "driving 1/1" in line_of(view(rows=rows))
    out = io.StringIO()
    Console(file=out, width=200).print(table_of(view(rows=[HOLDING._replace(complaints="c2"), *rows])))
    assert "no report yet; c2" in out.getvalue()
    assert "clock 41 ms behind" in out.getvalue()


def test_the_keys_are_explained_where_there_are_any() -> None:
    for keys in ("space: stop", ""):
        out = io.StringIO()
        Console(file=out, width=120).print(table_of(view(), keys))
        assert ("space: stop" in out.getvalue()) == bool(keys)


def test_a_robot_that_drives_otherwise_than_it_wants_is_driving_and_the_table_says_why() -> None:
    row = KNOWN._replace(note="keeps clear of r3")
    assert row.driving
    assert "driving 1/1" in line_of(view(rows=[row]))
    out = io.StringIO()
    Console(file=out, width=160).print(table_of(view(rows=[row, HOLDING._replace(note="keeps clear of r1")])))
    assert "keeps clear of r3" in out.getvalue()
    assert "keeps clear of r1" not in out.getvalue()  # why it does not drive comes first


def test_a_plain_line_is_printed_every_five_seconds(capsys: pytest.CaptureFixture[str]) -> None:
    with PlainScreen() as screen:
        for t in (0.3, 0.6, 4.9, 5.1, 9.9, 17.0, 19.9, 20.0):
            screen.show(view(t=t))
        screen.notify("r1 restarts in 0.5 s")
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[:-1]] == ["0.3", "5.1", "17.0", "20.0"]
    assert lines[-1] == "r1 restarts in 0.5 s"
