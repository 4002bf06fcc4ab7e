"""What happened in a fleet in memory: the truth, what each robot knew, what it said, and what the faults did."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from muro_zenoh.checking.effect import Effect
from muro_zenoh.checking.witness import Informed
from muro_zenoh.elementwise import Array


class HealthReport(NamedTuple):
    """A health message that differs from the one before of the same process, as a faultless listener received it.

    Attributes:
        time: when [s].
        process: whose it is: a robot's name, or ``basestation``.
        state: of the process.
        reasons: why it does not do its work.
        failure: of a robot's behaviour; empty while it runs.
        latched: whether a robot's stop latch holds it.
    """

    time: float
    process: str
    state: str = ""
    reasons: tuple[str, ...] = ()
    failure: str = ""
    latched: bool = False


class ProcessEnd(NamedTuple):
    """A process that ended by itself.

    Attributes:
        time: when [s since the start].
        name: of the process.
        error: why; empty when it ended without an error.
    """

    time: float
    name: str
    error: str


@dataclass(frozen=True, slots=True, eq=False, repr=False)  # asyncio.run() asks for the text of a task's result
class Trace:
    """A run of T steps with N robots. All times are in seconds since the start.

    Attributes:
        robots: their names.
        times: (T,), at 100 Hz.
        poses: (T, N, 3): x, y [m, world], theta [rad].
        twists: (T, N, 2): the true speeds v [m/s], omega [rad/s]; of a robot that is carried those of the hand.
        commands: (T, N, 2): what our base commands the wheels: v [m/s], omega [rad/s].
        informed: from when the newest information is that has reached each robot, by name.
        reports: the changes of the processes' health, in order.
        ends: the processes that ended by themselves, in order.
        effects: what each fault did.
    """

    robots: tuple[str, ...]
    times: Array
    poses: Array
    twists: Array
    commands: Array
    informed: dict[str, Informed]
    reports: tuple[HealthReport, ...]
    ends: tuple[ProcessEnd, ...]
    effects: tuple[Effect, ...]

    def digest(self) -> str:
        """A number of 256 bits that is the same only for the same run."""
        hashed = hashlib.sha256()
        for array in (self.times, self.poses, self.twists, self.commands):
            hashed.update(np.ascontiguousarray(array).tobytes())
        for name in self.robots:
            for column in self.informed[name]:
                hashed.update(column.tobytes())
        hashed.update(repr((self.reports, self.ends)).encode())
        hashed.update(repr([(e.begun, e.ended, e.amount) for e in self.effects]).encode())
        return hashed.hexdigest()
