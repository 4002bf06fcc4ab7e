"""The typed commands with real processes: what they start and refuse, and how they report failures."""

from __future__ import annotations

import asyncio
import json
import re
import signal
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import pytest_asyncio

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import BusSettings
from muro_zenoh.runtime.process import OK, WRONG_USE
from muro_zenoh.transport import Bus, open_bus
from tests.support.fleet import find
from tests.support.process import MURO, Process, muro
from tests.support.router import free_port
from tests.support.waiting import within


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@contextmanager
def typed(line: str) -> Iterator[Process]:
    """A command of ``muro`` that keeps running, once it is ready."""
    with Process([*MURO, *line.split()], name=f"muro {line}") as process:
        process.ready()
        yield process


@pytest.fixture
def lab() -> str:
    """A fleet file with two cameras in the current folder; where its processes meet."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    Path("lab.toml").write_text(
        f"""
robots = 5
[bus]
connect = ["{endpoint}"]
[camera.north]
rate = 10
[camera.south]
rate = 10
[behaviour]
name = "pursuit"
"""
    )
    return endpoint


@pytest_asyncio.fixture
async def bus(lab: str) -> AsyncIterator[Bus]:
    """An observer's, in a lab whose router runs."""
    with typed("router lab.toml"):
        async with open_bus(BusSettings(connect=(lab,)), Role.OPERATOR) as there:
            yield there


async def both_cameras(bus: Bus, robot: str) -> None:
    """Wait until both cameras have seen a robot."""
    seen: set[str] = set()
    async for received in bus.every(channels.POSE, robot):
        seen |= set(received.message.camera.split("+"))
        if seen == {"north", "south"}:
            return


async def drives(bus: Bus, robot: str) -> None:
    """Wait until a robot actually drives."""
    async for received in bus.every(channels.TRUTH, robot):
        if abs(received.message.v) > 0.05:
            return


async def test_the_typed_commands_start_drive_with_two_cameras_and_exit_on_sigterm(bus: Bus) -> None:
    with (
        typed("sim lab.toml --seed 3") as sim,
        typed("basestation lab.toml --state state.json") as station,
        typed("agent lab.toml r1") as agent,
    ):
        await within(20, both_cameras(bus, "r1"), "poses of both cameras")
        await within(20, drives(bus, "r1"), "r1 drives")
        for process in (agent, station, sim):
            process.send(signal.SIGTERM)
            assert process.wait() == OK, process.last_lines()


async def test_the_typed_base_command_starts_and_exits_on_sigterm(bus: Bus) -> None:
    states = bus.latest(channels.BASE, "r1")
    with typed("base lab.toml r1") as base:
        state = await within(10, states.next(), "its state")
        assert state.message.dead_man
        base.send(signal.SIGTERM)
        assert base.wait() == OK, base.last_lines()


def test_a_router_listens_on_the_given_endpoint(lab: str) -> None:
    with typed(f"router --listen {lab}") as router:
        assert muro("topic", "list", "--for", "0.2", "--connect", lab).returncode in (0, 1)
        router.send(signal.SIGINT)
        assert router.wait() == OK, router.last_lines()
    refused = muro("topic", "list", "--for", "0.2", "--connect", lab)
    assert f"no router answered at {lab}" in refused.stderr
    assert re.search(r"within 5 s \([^!]*[^ !]\)\. Start one", refused.stderr)


@pytest.mark.parametrize("command", ["agent", "base"])
def test_a_robot_that_the_file_does_not_have(command: str, lab: str) -> None:
    done = muro(command, "lab.toml", "r9")
    assert done.returncode == WRONG_USE
    assert "got 'r9', expected one of r1, r2, r3, r4, r5" in done.stderr


async def test_a_running_base_station_refuses_impossible_orders_with_the_reason(bus: Bus, lab: str) -> None:
    """`muro set` prints the reason, exits with 1, and nothing has changed."""
    circles, behaviours = bus.latest(channels.CIRCLE), bus.latest(channels.BEHAVIOUR, "*")
    with typed("basestation lab.toml --state state.json"):
        await within(10, circles.next(), "a circle")
        for words, reason in (
            ("circle --radius 0.2", "circle.radius: got 5 robots on a circle of 0.2 m"),
            ("circle --radius 9", "circle.radius: got 9 m"),
            ("behaviour pursuit v_min=0.5 v_max=0.1", "v_m"),
            ("behaviour dubins v_min=0.5", "behaviour.v_min: got 0.5"),
            ("behaviour circle sped=0.1", "behaviour.sped: got an unknown key"),
            ("behaviour circle speed=fast", "behaviour.speed: got 'fast' (text), expected a number"),
            ("behaviour fly", "got 'fly', expected one of circle, coverage"),
        ):
            done = muro("set", *words.split(), "--connect", lab)
            assert done.returncode == 1, f"{words}: {done.stdout}{done.stderr}"
            assert "refused" in done.stdout, words
            assert reason in done.stdout, words
        await asyncio.sleep(0.6)  # it is published twice a second
        circle = circles.get()
        assert circle is not None
        assert (circle.message.radius, circle.message.revision) == (0.8, 1)
        assert {received.message.behaviour for received in behaviours.values().values()} == {"pursuit"}


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("dubins --set behaviour.v_min=0.5", "behaviour.v_min: got 0.5"),
        ("dubins --set behaviour.vmin=0.1", "behaviour.vmin: got an unknown key"),
        ("pursuit --set circle.radius=0.2", "circle.radius: got 5 robots on a circle of 0.2 m"),
        ("pursuit --set behaviour.name=fly", "got 'fly', expected one of circle, coverage"),
        ("pursuit --set behaviour.name=nolab:swim", "No module named 'nolab'"),
    ],
)
def test_impossible_settings_are_refused_before_anything_starts(line: str, reason: str) -> None:
    done = muro("run", *line.split(), "--headless")
    assert done.returncode == WRONG_USE, done.stdout
    assert reason in done.stderr
    assert not Path("runs").exists()


SWIM = """
import asyncio

async def swim(robot):
    async for estimate in robot.estimates():
        robot.drive(0.1, 0.0)
        if robot.name == "r1":
            raise ValueError("out of water")

def call(robot):
    if robot.name == "r1":
        raise ValueError("out of water")
    return 0.1, 0.0
"""


@pytest.mark.parametrize(("behaviour", "line"), [("swim", 8), ("call", 12)])
def test_a_failed_behaviour_is_shown_everywhere_and_the_run_does_not_pass(behaviour: str, line: int) -> None:
    """In the live line, in the agent's log with its traceback, on the sheet, in the summary and in the exit code."""
    Path("pool.py").write_text(SWIM)
    Path("pool.toml").write_text(f'robots = 2\nduration = 6\n[camera.north]\n[behaviour]\nname = "pool:{behaviour}"\n')
    failure = f"behaviour pool:{behaviour}: ValueError: out of water (pool.py, line {line})"
    with Process([*MURO, "run", "pool.toml", "--headless", "--report", "r.json"], name="muro run") as run:
        run.line("all processes ready", 30)
        find(run, rf"^ +\d+\.\d s .*r1: .*{re.escape(failure)}", 15)
        run.line(f"  r1: {failure}", 15)
        run.line("NOT PASSED (the behaviour of r1 failed or ended early; nothing was checked)", 5)
        assert run.wait(10) == 1
    sheet = json.loads(Path("r.json").read_text())
    assert sheet["failures"] == {"r1": failure}
    assert (sheet["passed"], sheet["restarts"]) == (False, 0)
    (folder,) = Path("runs").iterdir()
    log = (folder / "r1.log").read_text()
    assert failure in log
    assert re.search(rf'File ".*pool\.py", line {line}, in {behaviour}\n.*raise ValueError\("out of water"\)', log)
    assert "Traceback" not in (folder / "r2.log").read_text()


@pytest.mark.slow
def test_a_stop_and_a_robot_without_a_tag_are_on_the_sheet() -> None:
    Path("lab.toml").write_text(
        "duration = 7\n[robot.r1]\ntag = 1\n[robot.r2]\ntag = 2\ntag_size = 0.02\n[camera.north]\n"
        "[behaviour]\nname = 'circle'\n"
    )
    with Process([*MURO, "run", "lab.toml", "--headless", "--report", "r.json"], name="muro run") as run:
        run.line("all processes ready", 30)
        (folder,) = Path("runs").iterdir()
        endpoint = json.loads((folder / "scenario.json").read_text())["bus"]["connect"][0]
        done = muro("stop", "r1", "--connect", endpoint)
        assert done.returncode == 0, done.stdout + done.stderr
        run.line("  stop order          r1 for ", 30)
        run.line("  never seen          r2 (by any camera)", 5)
        assert run.wait(10) == 0
    sheet = json.loads(Path("r.json").read_text())
    assert 0.0 < sheet["stopped_s"]["r1"] < 7.0
    assert sheet["stopped_s"]["r2"] == 0.0
    assert sheet["never_seen"] == ["r2"]
    assert sheet["passed"] is None
