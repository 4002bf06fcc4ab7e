"""Thirty of the thousand random trials: whole fleets with faults, each judged by every promise; and they can fail."""

from __future__ import annotations

import dataclasses
import json
import logging
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner

from muro_zenoh.checking.random_trial import random_trial
from muro_zenoh.checking.trial import run_trial
from muro_zenoh.cli.main import main


@pytest.mark.slow
def test_thirty_random_trials_break_no_promise(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = ["check", "random", "--trials", "30", "--jobs", "2", "--json", "c.json", "--out", "breach"]
    result = CliRunner().invoke(main, arguments, prog_name="muro")
    assert result.exit_code == 0, result.output
    table = json.loads(Path("c.json").read_text())
    assert table["trials"] == 30
    assert table["unfinished"] == table["left_arena"] == table["blind_moves"] == 0
    assert table["collisions"]["ours"] == table["collisions"]["standing"] == 0
    assert all(table["evaluated"].values()), table["evaluated"]


def test_with_the_filter_off_a_random_trial_collides(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.CRITICAL)
    scenario = random_trial(1)
    off = dataclasses.replace(scenario.separation, enabled=False)
    _, result = run_trial(msgspec.structs.replace(scenario, separation=off, duration=3.0), 1)
    assert result.duration == 3.0
    assert result.contacts["ours"]
    assert any(breach.promise == "no contact" for breach in result.breaches)
