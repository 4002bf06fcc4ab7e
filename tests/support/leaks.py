"""What a test must not leave behind: tasks, threads, processes. A ``conftest.py`` takes the fixtures by import."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Iterator
from multiprocessing import resource_tracker

import psutil
import pytest
import pytest_asyncio

from tests.support.waiting import seconds

_POOL = "asyncio_"
"""Threads of the loop's own pool end with the loop, which outlives a test's fixtures."""


@pytest_asyncio.fixture(autouse=True)
async def no_task_left() -> AsyncIterator[None]:
    """Fails a test that leaves a task running on its loop."""
    before = asyncio.all_tasks()
    yield
    left = asyncio.all_tasks() - before - {asyncio.current_task()}
    if left:
        # A cancelled task may still have to run its last step.
        _, left = await asyncio.wait(left, timeout=seconds(0.2))
    for task in left:
        task.cancel()
    assert not left, f"the test left tasks behind: {sorted(map(repr, left))}"


@pytest.fixture(autouse=True)
def no_thread_or_process_left() -> Iterator[None]:
    """Fails a test that leaves a thread or a child process behind."""
    resource_tracker.ensure_running()  # multiprocessing starts it with its first worker, and leaves it for good
    threads, children = set(threading.enumerate()), _children()
    yield
    left = [t for t in threading.enumerate() if t not in threads and not t.name.startswith(_POOL)]
    for thread in left:
        thread.join(seconds(1.0))
    names = sorted(t.name for t in left if t.is_alive())
    assert not names, f"the test left threads behind: {names}"
    # A killed process may still be exiting, or be a zombie.
    _, orphans = psutil.wait_procs(_children() - children, timeout=seconds(1.0))
    for orphan in orphans:
        orphan.kill()
    assert not orphans, f"the test left processes behind: {sorted(map(repr, orphans))}"


def _children() -> set[psutil.Process]:
    return {child for child in psutil.Process().children(recursive=True) if _runs(child)}


def _runs(process: psutil.Process) -> bool:
    try:
        return bool(process.status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False
