"""``muro run`` from end to end: a small fleet of real processes, and an operator beside it."""

from __future__ import annotations

import json
import re
import signal
import socket
import time
from pathlib import Path

import psutil
import pytest

from muro_zenoh.config import find_scenario
from muro_zenoh.supervision import launch
from muro_zenoh.supervision.faults import Links
from muro_zenoh.supervision.supervisor import Supervisor
from tests.support.process import MURO, Process, muro
from tests.support.waiting import seconds, within


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def run(*arguments: str) -> Process:
    return Process([*MURO, "run", *arguments, "--headless"], name="muro run")


def children(process: Process) -> list[psutil.Process]:
    return psutil.Process(process.pid).children()


def all_gone(processes: list[psutil.Process]) -> bool:
    gone, left = psutil.wait_procs(processes, timeout=seconds(5))
    return len(gone) == len(processes) and not left


def folder() -> Path:
    (found,) = Path("runs").iterdir()
    return found


def endpoint() -> str:
    found: str = json.loads((folder() / "scenario.json").read_text())["bus"]["connect"][0]
    return found


def named(processes: list[psutil.Process], words: str) -> psutil.Process:
    (found,) = [p for p in processes if words in " ".join(p.cmdline())]
    return found


def test_a_run_leaves_its_score_sheet_its_settings_and_its_logs_and_no_process() -> None:
    with run("hold", "--robots", "2", "--duration", "3", "--seed", "7", "--report", "r.json") as process:
        process.line("all processes ready")
        started = children(process)
        assert len(started) == 5  # router, simulator, base station, two agents
        assert process.wait(20) == 0
        assert process.line("nothing was checked")
        assert all_gone(started)
    sheet = json.loads(Path("r.json").read_text())
    assert (sheet["never_seen"], sheet["failures"], sheet["stopped_s"]) == ([], {}, {"r1": 0.0, "r2": 0.0})
    assert json.loads((folder() / "report.json").read_text()) == sheet
    assert re.fullmatch(r"\d{8}-\d{6}-hold", folder().name)
    logs = {path.name for path in folder().glob("*.log")}
    assert logs == {"router.log", "simulator.log", "basestation.log", "r1.log", "r2.log", "muro.log"}
    assert (sheet["scenario"], sheet["robots"], sheet["seed"], sheet["duration_s"]) == ("hold", 2, 7, 3.0)
    assert (sheet["ended"], sheet["restarts"], sheet["passed"]) == ("duration", 0, None)
    assert set(sheet["processes"]) == {"router", "simulator", "basestation", "r1", "r2", "muro"}
    assert all(use["rss_mb"] > 5.0 for use in sheet["processes"].values())
    assert sheet["min_separation_m"] > 2 * 0.177
    assert sheet["collisions"] == 0
    assert sheet["truth_known"] > 0.5
    assert all(rate > 5.0 for rate in sheet["fix_rate_hz"].values())
    assert sheet["pose_age_ms"]["p50"] > 40.0  # the camera's 50 ms are in it


def test_checks_that_are_not_met_are_exit_code_1() -> None:
    with run("circle", "--robots", "1", "--duration", "1", "--report", "r.json") as process:
        assert process.wait(20) == 1
    sheet = json.loads(Path("r.json").read_text())
    assert sheet["checks"]["settle_time"] == {"value": None, "limit": 40.0, "passed": False}
    assert sheet["passed"] is False


def test_a_taken_port_means_a_router_on_another_one() -> None:
    with socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            taken.bind(("127.0.0.1", 7447))
            taken.listen(1)
        except OSError:
            pass  # another fleet has it: as good
        with run("hold", "--robots", "1", "--duration", "1") as process:
            said = process.line("port 7447 is in use")
            assert process.wait(20) == 0
    assert endpoint() in said
    assert endpoint() != "tcp/127.0.0.1:7447"


async def test_another_port_is_chosen_when_one_is_taken_between_check_and_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    messages: list[str] = []
    looked: list[int] = []
    free_port = launch.free_port
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen(1)
        port = taken.getsockname()[1]

        def too_early(preferred: int) -> int:
            looked.append(preferred)
            return port if len(looked) == 1 else free_port(port)

        monkeypatch.setattr(launch, "free_port", too_early)
        scenario = find_scenario("hold", 1)
        async with Links(scenario, 1) as links, Supervisor(tmp_path, messages.append) as supervisor:
            starting_all = launch.start_all(supervisor, scenario, 1, tmp_path, links, "no page")
            connected, starting = await within(20, starting_all, "a router")
            await within(20, starting, "a fleet")
            assert [child.spec.name for child in supervisor.children] == ["router", "simulator", "basestation", "r1"]
            assert all(child.ready.is_set() for child in supervisor.children)
    assert connected.bus.connect != (f"tcp/127.0.0.1:{port}",)
    assert "router exited with code 1. Its last lines:" in messages[0]


def test_ctrl_c_ends_everything_with_the_score_so_far() -> None:
    with run("hold", "--robots", "2", "--duration", "60", "--report", "r.json") as process:
        process.line("all processes ready")
        started = children(process)
        time.sleep(1.0)
        begin = time.monotonic()
        process.send(signal.SIGINT)
        process.line("hold: 2 robots")  # the score sheet
        assert process.wait(10) == 130
        assert time.monotonic() - begin < seconds(5)
        assert all_gone(started)
    sheet = json.loads(Path("r.json").read_text())
    assert sheet["ended"] == "interrupted"
    assert 0.5 < sheet["duration_s"] < 30.0
    assert sheet["passed"] is False


@pytest.mark.parametrize("after", [0.0, 0.5])
def test_a_signal_during_the_start_leaves_nothing(after: float) -> None:
    with run("hold", "--robots", "2") as process:
        process.line("hold: 2 robots")
        time.sleep(after)
        started = children(process)
        process.send(signal.SIGTERM)
        assert process.wait(10) == 130
        assert all_gone(started)


def test_kill_9_leaves_nothing_behind() -> None:
    with run("hold", "--robots", "2") as process:
        process.line("all processes ready")
        started = children(process)
        assert len(started) == 5
        process.send(signal.SIGKILL)
        process.wait(5)
        assert all_gone(started)


@pytest.mark.slow
def test_a_killed_agent_is_reported_and_restarted() -> None:
    with run("hold", "--robots", "2", "--duration", "7", "--report", "r.json") as process:
        process.line("all processes ready")
        time.sleep(1.5)
        named(children(process), "muro_zenoh agent runs/" + folder().name + "/scenario.json r2").kill()
        process.line("r2 was killed by SIGKILL. Its last lines:")
        process.line("r2 restarts in 0.5 s")
        assert process.wait(20) == 0
    sheet = json.loads(Path("r.json").read_text())
    assert sheet["restarts"] == 1
    assert sheet["fix_rate_hz"]["r2"] < sheet["fix_rate_hz"]["r1"]


@pytest.mark.slow
def test_an_operator_beside_a_fleet() -> None:
    with run("hold", "--robots", "2", "--duration", f"{seconds(60):g}") as process:
        process.line("all processes ready")
        time.sleep(1.0)
        there = ["--connect", endpoint()]

        listed = muro("topic", "list", "--for", "1.5", *there).stdout
        assert re.search(r"^muro/pose/r1 +\d+\.\d Hz +\d+ B  PoseFix\.1$", listed, re.MULTILINE)
        assert re.search(r"^muro/camera/north ", listed, re.MULTILINE)

        echoed = muro("topic", "echo", "all_positions", "--count", "1", *there).stdout
        assert {robot["name"] for robot in json.loads(echoed.partition(" ")[2])["robots"]} == {"r1", "r2"}

        rates = muro("topic", "hz", "cmd_vel/*", "--for", "1.5", *there).stdout
        assert re.search(r"muro/cmd_vel/r2  \d+\.\d Hz", rates)

        order = muro("set", "circle", "--radius", "0.9", "--clockwise", *there)
        assert (order.returncode, order.stdout) == (0, "base station: accepted, revision 2\n")
        circle = json.loads(muro("topic", "echo", "circle", "--count", "1", *there).stdout.partition(" ")[2])
        assert (circle["radius"], circle["clockwise"]) == (0.9, True)
        order = muro("set", "circle", "--radius", "9", *there)
        assert order.returncode == 1
        assert "refused: circle.radius: got 9 m" in order.stdout

        order = muro("set", "behaviour", "circle", "speed=0.1", "--robot", "r2", *there)
        assert order.returncode == 0
        order = muro("set", "behaviour", "circle", "--robot", "r9", *there)
        assert (order.returncode, "r9" in order.stdout) == (1, True)

        order = muro("stop", "r1", *there)
        assert order.returncode == 0, order.stdout
        assert re.search(r"^r1 .* has stopped\n1 of 1 robot stopped$", order.stdout, re.MULTILINE)
        assert "r2" not in order.stdout
        order = muro("stop", *there)
        assert order.returncode == 0, order.stdout
        assert re.search(r"^r1 .* has stopped\nr2 .* has stopped\n2 of 2 robots stopped$", order.stdout, re.MULTILINE)
        order = muro("stop", "r7", *there)
        assert (order.returncode, "no robot of this name is known" in order.stdout) == (1, True)
        order = muro("resume", *there)
        assert order.returncode == 0, order.stdout


@pytest.mark.slow
def test_stop_reaches_the_robots_without_the_base_station_and_resume_does_not() -> None:
    with run("hold", "--robots", "2", "--duration", "60") as process:
        process.line("all processes ready")
        there = ["--connect", endpoint()]
        station = named(children(process), "muro_zenoh basestation")
        station.suspend()  # frozen, it is not started again
        order = muro("stop", *there)
        assert order.returncode == 0, order.stdout
        assert "base station: did not answer" in order.stdout
        assert re.search(r"^r1 .* has stopped\nr2 .* has stopped\n2 of 2 robots stopped$", order.stdout, re.MULTILINE)
        time.sleep(seconds(2.5))  # its lease has expired
        order = muro("resume", *there)
        assert order.returncode == 1
        assert "the base station is silent" in order.stderr


@pytest.mark.slow
def test_an_endpoint_without_a_router_is_named() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    order = muro("stop", "--connect", f"tcp/127.0.0.1:{port}")
    assert order.returncode == 1
    assert f"no router answered at tcp/127.0.0.1:{port}" in order.stderr
