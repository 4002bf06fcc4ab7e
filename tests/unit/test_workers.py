"""Processes that work through tasks: what crashes or hangs costs its task, not the others."""

from __future__ import annotations

import os
import signal
import time

from muro_zenoh.checking.workers import Workers
from tests.support.waiting import seconds


def work(task: str) -> str:
    """Does as it is told."""
    if task == "raise":
        raise ValueError("a reason")
    if task == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    if task == "hang":
        time.sleep(600.0)
    if task == "interrupt":
        os.kill(os.getpid(), signal.SIGINT)
    return task.upper()


def test_what_goes_wrong_is_reported_with_its_task_and_the_rest_is_done() -> None:
    tasks = ["a", "raise", "die", "hang", "interrupt", "b"]
    outcomes = {}
    with Workers(work, jobs=2, limit=seconds(4.0)) as workers:
        while tasks or workers.busy:
            while tasks and workers.has_room:
                workers.start(tasks.pop(0))
            for task, result, failure in workers.finished():
                outcomes[task] = result or failure
    assert outcomes == {
        "a": "A",
        "b": "B",
        "interrupt": "INTERRUPT",  # Ctrl-C in a terminal reaches every process: it ends the check, not a trial
        "raise": "ValueError: a reason",
        "die": "its process died with exit code -9",
        "hang": f"hangs: not over after {seconds(4.0):g} s",
    }


def test_processes_are_ended_with_the_context() -> None:
    with Workers(work, jobs=2, limit=60.0) as workers:
        workers.start("hang")
        (process,) = (worker._process for worker in workers._busy)
    assert not process.is_alive()
