"""``[[fault]]`` in ``muro run``, with real processes: what happens, what is reported, and that nothing is left."""

from __future__ import annotations

import json
import signal
import time
from pathlib import Path
from typing import Any

import psutil
import pytest

from benchmarks.stopping import LIMITS, Case, StationaryError, measure
from tests.support.process import Process
from tests.support.waiting import seconds

HOLD = 'robots = 2\nduration = {duration}\n[camera.north]\n[behaviour]\nname = "hold"\n'


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def run(*faults: dict[str, Any], duration: float = 60.0) -> Process:
    text = HOLD.format(duration=duration)
    for fault in faults:
        text += "[[fault]]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in fault.items())
    Path("lab.toml").write_text(text)
    return Process(["-m", "muro_zenoh", "run", "lab.toml", "--headless", "--report", "r.json"], name="muro run")


def children(process: Process) -> list[psutil.Process]:
    return psutil.Process(process.pid).children()


def all_gone(processes: list[psutil.Process]) -> bool:
    gone, left = psutil.wait_procs(processes, timeout=seconds(5))
    for process in left:
        process.kill()  # a frozen one would stay for ever
    return len(gone) == len(processes) and not left


FROZEN = [{"kind": "freeze", "target": target, "at": 0.2} for target in ("r1/agent", "basestation", "camera", "router")]


def _frozen(process: Process) -> list[psutil.Process]:
    """All children of a run, when four of them are frozen."""
    process.line("all processes ready")
    for _ in FROZEN:
        process.line("fault: freeze")
    started = children(process)
    assert len(started) == 6
    deadline = time.monotonic() + seconds(2.0)  # one that runs on another core takes a moment to stop
    while sum(child.status() == psutil.STATUS_STOPPED for child in started) < len(FROZEN):
        assert time.monotonic() < deadline, [child.status() for child in started]
        time.sleep(0.01)
    return started


def test_ctrl_c_during_a_freeze_leaves_nothing_and_kills_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # One that leaves may be late on a machine that stands still; one that is not woken is killed each time.
    for attempt in range(2):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        monkeypatch.chdir(folder)
        log = _log_of_an_interrupted_run()
        if "did not exit" not in log:
            return
    pytest.fail(log)


def _log_of_an_interrupted_run() -> str:
    with run(*FROZEN) as process:
        started = _frozen(process)
        began = time.monotonic()
        process.send(signal.SIGINT)
        assert process.wait(10) == 130
        assert time.monotonic() - began < seconds(5)
        assert all_gone(started)
    faults = json.loads(Path("r.json").read_text())["faults"]
    assert [(f["begin_s"] is not None, f["end_s"], f["note"]) for f in faults] == [(True, None, "")] * len(FROZEN)
    (folder,) = Path("runs").iterdir()
    return (folder / "muro.log").read_text()


def test_kill_9_of_the_run_during_a_freeze_leaves_nothing() -> None:
    with run(*FROZEN) as process:
        started = _frozen(process)
        process.send(signal.SIGKILL)
        process.wait(5)
        assert all_gone(started)


def test_what_breaks_is_shown_logged_and_reported_and_a_killed_process_stays_dead_until_the_end() -> None:
    faults: list[dict[str, Any]] = [
        {"kind": "crash", "target": "r1/agent", "at": 1.0, "duration": 2.5},
        {"kind": "stall", "target": "r2/agent", "at": 2.0, "duration": 0.5},
    ]
    with run(*faults, duration=7.0) as process:
        process.line("all processes ready")
        assert len(children(process)) == 5
        process.line("fault: crash r1/agent")
        process.line("fault: stall r2/agent")
        assert len(children(process)) == 4
        process.line("fault over: stall r2/agent")
        process.line("fault over: crash r1/agent")
        assert process.wait(20) == 0
    (folder,) = Path("runs").iterdir()
    log = (folder / "muro.log").read_text()
    assert all(f"fault{over}: {what}" in log for over in ("", " over") for what in ("crash r1", "stall r2"))
    sheet = json.loads(Path("r.json").read_text())
    assert sheet["restarts"] == 1
    for row, fault in zip(sheet["faults"], faults, strict=True):
        assert (row["kind"], row["target"], row["note"]) == (fault["kind"], fault["target"], "")
        begin, end = fault["at"], fault["at"] + fault["duration"]
        assert begin - 0.01 <= row["begin_s"] < begin + seconds(0.5)
        assert end - 0.01 <= row["end_s"] < end + seconds(0.5)
    assert (folder / "r1.log").read_text().count("READY") == 2
    relay = (folder / "r2.log").read_text()
    assert " r2 --connect tcp/127.0.0.1:" in relay
    assert relay.count("READY") == 1


def test_a_fault_that_processes_cannot_have_is_refused_before_anything_starts() -> None:
    with run({"kind": "loss", "target": "r1/agent", "fraction": 0.2}) as process:
        said = process.line("muro: ")
        assert "fault[0].kind: got 'loss', which cannot befall processes: the link is a TCP connection" in said
        assert process.wait(5) == 2
    assert not Path("runs").exists()


@pytest.mark.slow
def test_wheels_stop_in_time_and_turn_again_whatever_happens_to_whichever_process(tmp_path: Path) -> None:
    """All roles and kinds, ten times: benchmarks/stopping.py."""
    cases = [
        Case("agent", "crash"),
        Case("basestation", "freeze"),
        Case("router", "partition"),
        Case("camera", "crash"),
    ]
    # A machine that stands still for 0.2 s takes a case beyond its limit, or had the robots wait for pictures when it
    # began. One that has failed has to succeed twice.
    missing, failed = dict.fromkeys(cases, 1), list[str]()
    for attempt in range(4):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        try:
            times = measure(list(missing), folder)
        except StationaryError as error:
            failed.append(str(error))
            continue
        for case, took in zip(list(missing), times, strict=True):
            if not 0.0 < took.stopped <= LIMITS[case.role]:
                failed.append(f"{case}: {took}")
                missing[case] = 2
            elif missing[case] == 1:
                del missing[case]
            else:
                missing[case] -= 1
        if not missing:
            return
    pytest.fail("\n".join(failed))
