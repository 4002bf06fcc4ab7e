"""An agent that notes what each step of its control loop takes, for :mod:`benchmarks.control_step`.

``timed_agent.py FILE NAME NOTES``: ``muro agent FILE NAME``, which writes its steps to the file NOTES when it ends. The
agent's own code runs, unchanged: the control task is resumed through a wrapper that looks at the clocks before and
after, and the methods of :data:`METHODS` are called through one. Compiled modules call each other's methods directly,
so the parts of a compiled build are not known.
"""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Coroutine, Generator
from pathlib import Path
from typing import Any, NamedTuple

from agents import agent
from agents.control_loop import ControlLoop
from agents.drive import Drive
from agents.tasks.control import Listener, Sender, Signals, control
from agents.tracking import Tracking
from muro_zenoh import is_compiled
from muro_zenoh.cli.main import main
from muro_zenoh.estimation.pose_filter import PoseFilter
from muro_zenoh.transport import Bus

METHODS: tuple[tuple[type, str, str], ...] = (
    (Listener, "surroundings", "snapshot"),
    (ControlLoop, "update", "update"),
    (Tracking, "take", "estimate"),
    (PoseFilter, "at", "estimate"),
    (PoseFilter, "look_ahead", "estimate"),
    (Drive, "learn", "separation"),
    (Drive, "command", "separation"),
    (Sender, "send", "send"),
)
"""The methods that are timed, and what their time is added to. ``update`` calls those of estimate and separation; no
other calls another."""


COMPILED = is_compiled()


class Step(NamedTuple):
    """One step that took a fix, from the loop's resuming the control task to the task's waiting for the next fix.

    Attributes:
        cpu: processor time of the thread [s].
        wall: time on the clock [s].
        latency: from the arrival of the fix in Zenoh's thread to the command's having been handed to Zenoh [s].
        drives: whether nothing held the robot.
        changed: whether the separation filter changed the command.
        compiled: whether the agent runs compiled.
        parts: processor time by part, which add up to ``cpu`` [s]; none of a compiled build.
    """

    cpu: float
    wall: float
    latency: float
    drives: bool
    changed: bool
    compiled: bool
    parts: dict[str, float]


_steps: list[Step] = []
_parts: Counter[str] = Counter()


class TimedControl(Coroutine[Any, Any, None]):
    """The control task's coroutine, with the time that each of its resumptions takes.

    Args:
        bus: as for :func:`~agents.tasks.control.control`, like the rest.
        name: the robot's name.
        loop: the control loop.
        listener: what the behaviour needs.
        sender: sends the messages.
        signals: has the latencies.
    """

    def __init__(
        self, bus: Bus, name: str, loop: ControlLoop, listener: Listener, sender: Sender, signals: Signals
    ) -> None:
        self._control = control(bus, name, loop, listener, sender, signals)
        self._loop = loop
        self._signals = signals

    def send(self, value: Any) -> Any:
        """Resume it; the loop does so when a fix has come."""
        return self._resume(self._control.send, value)

    def throw(self, *error: Any) -> Any:
        """Resume it with an exception; the loop does so when a fix is overdue, and at the end."""
        return self._resume(self._control.throw, *error)

    def close(self) -> None:
        """Give it up."""
        self._control.close()

    def __await__(self) -> Generator[Any, Any, None]:
        return self._control.__await__()

    def _resume(self, resume: Callable[..., Any], *arguments: Any) -> Any:
        latencies, drive = self._signals.latencies, self._loop.drive
        known, changes = len(latencies), drive.changes.total()
        _parts.clear()
        wall, cpu = time.perf_counter(), time.thread_time()
        awaited = resume(*arguments)
        cpu, wall = time.thread_time() - cpu, time.perf_counter() - wall
        if len(latencies) > known:
            changed = drive.changes.total() > changes
            _steps.append(Step(cpu, wall, latencies[-1], not self._loop.reasons, changed, COMPILED, parts_of(cpu)))
        return awaited


def parts_of(cpu: float) -> dict[str, float]:
    """The parts of the step that has just ended.

    Args:
        cpu: its processor time [s].
    """
    if COMPILED:
        return {}
    snapshot, estimate, separation, send = (_parts[part] for part in ("snapshot", "estimate", "separation", "send"))
    return {
        "fix, odometry": cpu - snapshot - _parts["update"] - send,
        "snapshot": snapshot,
        "estimate": estimate,
        "law": _parts["update"] - estimate - separation,
        "separation": separation,
        "send": send,
    }


def note(owner: type, method: str, part: str) -> None:
    """Note the processor time of a method.

    Args:
        owner: its class.
        method: its name.
        part: what its time is added to.
    """
    call = getattr(owner, method)

    def timed(*arguments: Any) -> Any:
        began = time.thread_time()
        try:
            return call(*arguments)
        finally:
            _parts[part] += time.thread_time() - began

    setattr(owner, method, timed)


if __name__ == "__main__":
    file, name, notes = sys.argv[1:]
    for each in METHODS if not COMPILED else ():
        note(*each)
    agent.control = TimedControl  # type: ignore[attr-defined]
    try:
        main(["agent", file, name])
    finally:
        Path(notes).write_text(json.dumps([step._asdict() for step in _steps]))
