"""``muro run pursuit`` with real processes: it meets its checks, and leaves nothing behind."""

from __future__ import annotations

import json
import signal
import time
from pathlib import Path

import psutil
import pytest

from tests.support.process import Process
from tests.support.waiting import seconds

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def run(*arguments: str) -> Process:
    command = ["-m", "muro_zenoh", "run", "pursuit", "--robots", "3", "--headless", *arguments]
    return Process(command, name="muro run")


def children(process: Process) -> list[psutil.Process]:
    return psutil.Process(process.pid).children(recursive=True)


def gone(processes: list[psutil.Process], limit: float) -> bool:
    _, left = psutil.wait_procs(processes, timeout=seconds(limit))
    return not left


# Wide enough for a machine that has much else to do; the scenario's own are for a quiet one.
CHECKS = ("--set", "checks.radius_error_p95=0.1", "--set", "checks.spacing_error_p95=0.25")


def test_pursuit_meets_its_checks_and_reports_it() -> None:
    with run("--duration", "25", "--seed", "1", "--report", "r.json", *CHECKS) as process:
        process.line("all processes ready", 30)
        started = children(process)
        assert len(started) == 6  # router, simulator, base station, three agents
        code = process.wait(45)
        assert gone(started, 5)
    sheet = json.loads(Path("r.json").read_text())
    assert code == 0, json.dumps(sheet, indent=1) + process.last_lines()
    assert sheet["passed"] is True
    assert 0.0 < sheet["settle_time_s"] <= 40.0
    for key in ("radius_error_m", "spacing_error_rad"):
        assert 0.0 < sheet[key]["p50"] <= sheet[key]["p95"] <= sheet[key]["max"], key
    assert sheet["radius_error_m"]["p95"] <= 0.1
    assert sheet["spacing_error_rad"]["p95"] <= 0.25
    assert sheet["robots"] == 3
    assert sheet["collisions"] == 0
    assert sheet["min_separation_m"] > 0.354
    for key in ("pose_to_command_ms", "pose_age_ms"):
        assert 0.0 < sheet[key]["p50"] <= sheet[key]["p99"], key
    assert set(sheet["fix_rate_hz"]) == {"r1", "r2", "r3"}
    assert sheet["restarts"] == 0
    assert set(sheet["processes"]) == {"router", "simulator", "basestation", "r1", "r2", "r3", "muro"}
    assert all(use["cpu_percent"] > 0.0 and use["rss_mb"] > 5.0 for use in sheet["processes"].values())
    for robot, found in sheet["calibration"].items():
        assert found["error_after_10s"] < 0.05, robot


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_driving_fleet_ends_with_the_run_within_five_seconds(number: signal.Signals) -> None:
    with run("--duration", "120") as process:
        process.line("all processes ready", 30)
        started = children(process)
        assert len(started) == 6
        time.sleep(1.0)  # they drive
        began = time.monotonic()
        process.send(number)
        code = process.wait(5)
        assert gone(started, 5 - (time.monotonic() - began) / seconds(1))
        assert code == (130 if number == signal.SIGTERM else -signal.SIGKILL)
