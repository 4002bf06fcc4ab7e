"""Children that die, hang and refuse to exit, and parents that are killed, with real processes."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from muro_zenoh.errors import SupervisionError
from muro_zenoh.supervision.child import ChildSpec
from muro_zenoh.supervision.supervisor import RestartPolicy, Supervisor
from tests.support.process import Process
from tests.support.waiting import seconds, within

CHILDREN = Path(__file__).parent / "children"


def dummy(*what: str, name: str = "dummy") -> ChildSpec:
    return ChildSpec(name, (sys.executable, "-P", str(CHILDREN / "dummy.py"), *what), os.environ)


def gone(pid: int | None) -> bool:
    """Whether a process has ended."""
    try:
        return pid is None or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def all_gone(pids: list[int], limit: float) -> bool:
    """Whether processes have all ended in time."""
    end = time.monotonic() + seconds(limit)
    while not all(map(gone, pids)) and time.monotonic() < end:
        time.sleep(0.02)
    return all(map(gone, pids))


async def eventually(condition: Callable[[], bool], limit: float, what: str) -> None:
    """Wait until a condition holds."""

    async def poll() -> None:
        while not condition():  # noqa: ASYNC110 - there is no event for what the system does
            await asyncio.sleep(0.02)

    await within(limit, poll(), what)


async def test_children_are_ready_then_gone(tmp_path: Path) -> None:
    async with Supervisor(tmp_path, print) as supervisor:
        children = await within(10, supervisor.start([dummy("stay", name="a"), dummy("stay", name="b")]), "two ready")
        pids = [child.pid for child in children]
        assert all(pid is not None and psutil.pid_exists(pid) for pid in pids)
    assert all(pid is not None and not psutil.pid_exists(pid) for pid in pids)
    assert [child.restarts for child in children] == [0, 0]


async def test_a_log_has_what_a_child_printed_and_logged(tmp_path: Path) -> None:
    async with Supervisor(tmp_path, print) as supervisor:
        await within(10, supervisor.start([dummy("stay", name="a")]), "ready")
    log = (tmp_path / "a.log").read_text()
    assert re.match(r"--- \d\d:\d\d:\d\d start 1: .*dummy.py stay\n", log)
    assert "READY dummy" in log
    assert "dummy stay starts" in log


async def test_the_first_child_started_is_ended_last(tmp_path: Path) -> None:
    async with Supervisor(tmp_path, print) as supervisor:
        await within(10, supervisor.start([dummy("stay", name="router")]), "the first ready")
        await within(10, supervisor.start([dummy("stay", name="agent")]), "the second ready")
    left = [
        float(found.group(1))
        for name in ("agent", "router")
        if (found := re.search(r"left at ([\d.]+)", (tmp_path / f"{name}.log").read_text()))
    ]
    assert len(left) == 2
    assert left[0] < left[1]


async def test_a_child_that_dies_is_restarted_after_a_delay_that_doubles(tmp_path: Path) -> None:
    messages: list[str] = []
    policy = RestartPolicy(first_delay=0.1, max_restarts=3)
    async with Supervisor(tmp_path, messages.append, policy) as supervisor:
        (child,) = await within(10, supervisor.start([dummy("crash", "0.2")]), "ready")
        error = await within(20, supervisor.failure(), "given up")
    assert "dummy died 4 times within 60 s, expected at most 3: given up" in str(error)
    assert child.restarts == 3
    delays = [float(found.group(1)) for line in messages if (found := re.fullmatch(r"dummy restarts in (.*) s", line))]
    assert delays == [0.1, 0.2, 0.4]
    assert len(re.findall("^--- ", (tmp_path / "dummy.log").read_text(), re.MULTILINE)) == 4
    died = [line for line in messages if line.startswith("dummy exited with code 1. Its last lines:")]
    assert len(died) == 4
    assert all("the wheels came off" in line for line in died)


async def test_deaths_are_forgotten_after_a_while(tmp_path: Path) -> None:
    messages: list[str] = []
    # Each run lasts longer than the window: there is never more than one death in it.
    async with Supervisor(
        tmp_path, messages.append, RestartPolicy(first_delay=0.02, max_restarts=1, window=0.1)
    ) as supervisor:
        (child,) = await within(10, supervisor.start([dummy("crash", "0.2")]), "ready")
        await eventually(lambda: child.restarts >= 3, 20, "a third restart")
    assert all("in 0.02 s" in line for line in messages if "restarts in" in line)


async def test_a_killed_child_is_restarted(tmp_path: Path) -> None:
    messages: list[str] = []
    async with Supervisor(tmp_path, messages.append, RestartPolicy(first_delay=0.05)) as supervisor:
        (child,) = await within(10, supervisor.start([dummy("stay")]), "ready")
        first = child.pid
        assert first is not None
        os.kill(first, signal.SIGKILL)
        await eventually(lambda: child.pid not in (first, None) and child.ready.is_set(), 10, "a second run")
        assert child.restarts == 1
    assert messages[0].startswith("dummy was killed by SIGKILL")


async def test_wrong_settings_are_not_retried(tmp_path: Path) -> None:
    async with Supervisor(tmp_path, print) as supervisor:
        (child,) = await within(10, supervisor.start([dummy("code", "2")]), "ready")
        error = await within(10, supervisor.failure(), "given up")
    assert "dummy refused its settings" in str(error)
    assert child.restarts == 0


async def test_a_start_fails_at_once_when_a_child_dies_before_it_is_ready(tmp_path: Path) -> None:
    messages: list[str] = []
    async with Supervisor(tmp_path, messages.append) as supervisor:
        with pytest.raises(SupervisionError, match=r"early exited with code 1 before it was ready; see .*early\.log"):
            await within(10, supervisor.start([dummy("stay"), dummy("early", name="early")]), "an error")
        assert supervisor.children == []
        # ... and the next attempt starts from scratch.
        await within(10, supervisor.start([dummy("stay")]), "ready")
    assert "no such room" in "".join(messages)


async def test_a_child_that_is_never_ready_is_killed(tmp_path: Path) -> None:
    async with Supervisor(tmp_path, print, RestartPolicy(start_timeout=0.5)) as supervisor:
        with pytest.raises(SupervisionError, match="SIGKILL before it was ready"):
            await within(10, supervisor.start([dummy("slow")]), "an error")


async def test_a_missing_program_is_named(tmp_path: Path) -> None:
    messages: list[str] = []
    async with Supervisor(tmp_path, messages.append) as supervisor:
        with pytest.raises(SupervisionError):
            await within(10, supervisor.start([ChildSpec("a", ("./no-such-program",), {})]), "an error")
    assert "could not start ./no-such-program: No such file or directory" in "".join(messages)


async def test_a_child_that_ignores_sigterm_is_killed(tmp_path: Path) -> None:
    messages: list[str] = []
    async with Supervisor(tmp_path, messages.append, RestartPolicy(stop_timeout=0.3)) as supervisor:
        (child,) = await within(10, supervisor.start([dummy("deaf")]), "ready")
        pid = child.pid
        begin = time.monotonic()
    assert time.monotonic() - begin < seconds(3.0)
    assert pid is not None
    assert gone(pid)
    assert messages == ["dummy did not exit within 0.3 s: killed"]


async def test_a_childs_own_children_are_killed_with_it(tmp_path: Path) -> None:
    async with Supervisor(tmp_path, print) as supervisor:
        (child,) = await within(10, supervisor.start([dummy("parent")]), "ready")
        assert child.pid is not None
        grandchild = int((tmp_path / "dummy.log").read_text().split("grandchild ")[1].split()[0])
        os.kill(child.pid, signal.SIGKILL)
        await eventually(lambda: gone(grandchild), 5, "the grandchild's end")


async def test_cancelling_the_block_ends_the_children(tmp_path: Path) -> None:
    pids: list[int | None] = []

    async def supervise() -> None:
        async with Supervisor(tmp_path, print) as supervisor:
            pids.extend(child.pid for child in await supervisor.start([dummy("stay")]))
            await supervisor.failure()

    task = asyncio.create_task(supervise())
    await eventually(lambda: bool(pids), 10, "ready")
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await within(5, task, "the end")
    assert pids[0] is not None
    assert gone(pids[0])


@pytest.fixture
def under_nohup() -> Iterator[None]:
    """SIGHUP is ignored here, and in every child that does not ask for it."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL, signal.SIGHUP])
def test_a_parent_that_ends_leaves_nothing_behind(tmp_path: Path, number: signal.Signals, under_nohup: None) -> None:
    whats = ["stay", "stay", "stay"]
    with Process([str(CHILDREN / "supervising.py"), str(tmp_path), *whats], name="supervising") as parent:
        pids = [int(word) for word in parent.line("PIDS").split()[1:]]
        parent.ready()
        parent.send(number)
        parent.wait(5)
        assert len(pids) == 3
        assert all_gone(pids, 5)


def test_a_child_that_ignores_sigterm_is_gone_within_five_seconds_too(tmp_path: Path) -> None:
    with Process([str(CHILDREN / "supervising.py"), str(tmp_path), "deaf", "stay"], name="supervising") as parent:
        pids = [int(word) for word in parent.line("PIDS").split()[1:]]
        parent.ready()
        begin = time.monotonic()
        parent.send(signal.SIGTERM)
        assert parent.wait(5) == 0
        assert time.monotonic() - begin < seconds(5)
        assert all_gone(pids, 0.1)
