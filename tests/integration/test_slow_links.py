"""Pursuit over slow links: it settles and nobody touches; with real processes, and with losses besides in memory."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from muro_zenoh.checking.record import Record
from muro_zenoh.checking.trial import run_trial
from muro_zenoh.config import parse_scenario
from tests.integration.test_run import run
from tests.support.waiting import seconds

pytestmark = pytest.mark.slow

FILE = Path(__file__).parents[2] / "examples/slow_links.toml"


def lossy(fraction: float) -> dict[str, Any]:
    """The example with losses on the same links."""
    table = tomllib.loads(FILE.read_text(encoding="utf-8"))
    links = {fault["target"]: None for fault in table["fault"]}
    assert list(links) == [f"r{k}/agent" for k in range(1, 6)]
    table["fault"] += [{"kind": "loss", "target": link, "fraction": fraction} for link in links]
    return table


def ring_errors(record: Record) -> tuple[float, float]:
    """The worst robot's error of radius [m] and of spacing [rad] in the last 15 s: their 95th percentiles."""
    last = record.time > record.time[-1] - 15.0
    x, y = record.pose[last, :, 0], record.pose[last, :, 1]
    angles = np.sort(np.arctan2(y, x), axis=1)
    gaps = np.diff(np.c_[angles, angles[:, :1] + 2 * np.pi], axis=1)
    errors = abs(np.hypot(x, y) - 0.8), abs(gaps - 2 * np.pi / angles.shape[1])
    radius, spacing = (float(np.quantile(error.max(axis=1), 0.95)) for error in errors)
    return radius, spacing


def test_with_a_fifth_of_the_messages_lost_besides_it_settles_and_nobody_touches() -> None:
    record, result = run_trial(parse_scenario({**lossy(0.2), "duration": 45.0}, "lab.toml", name="lab"), 1)
    assert len(record.effects) == 15, "one without effect is not recorded"
    assert not result.breaches
    assert not any(result.contacts.values())
    radius, spacing = ring_errors(record)
    assert radius < 0.1
    assert spacing < 0.15


def test_with_real_processes_it_settles_and_nobody_touches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with run(str(FILE), "--duration", "30", "--report", "r.json") as process:
        assert process.wait(seconds(60)) == 0, process.last_lines()
    sheet = json.loads(Path("r.json").read_text())
    assert sheet["collisions"] == 0
    assert sheet["settle_time_s"] is not None
    assert sheet["pose_age_ms"]["p50"] > 150
