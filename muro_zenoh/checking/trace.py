"""What happened in a fleet in memory: the truth, what each robot knew, what it said, and what the faults did."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from muro_zenoh.checking.effect import Effect
from muro_zenoh.checking.witness import Informed
from muro_zenoh.elementwise import Array


class Report(NamedTuple):
    """A process's health when its state or its reasons changed.

    Attributes:
        time: when [s since the start].
        role: of the process.
        name: of the process: a robot's, or ``basestation``.
        state: its state.
        reasons: why it does not do its work.
    """

    time: float
    role: str
    name: str
    state: str
    reasons: tuple[str, ...]


class Contact(NamedTuple):
    """Two bodies that touch.

    Attributes:
        first: a robot.
        second: another one.
        begin: when they came together [s since the start].
        end: when they parted, or the run ended [s since the start].
    """

    first: str
    second: str
    begin: float
    end: float


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
        radii: of their bodies (N,) [m].
        times: (T,), at 100 Hz.
        poses: (T, N, 3): x, y [m, world], theta [rad].
        twists: (T, N, 2): the true speeds v [m/s], omega [rad/s]; of a robot that is carried those of the hand.
        commands: (T, N, 2): what our base commands the wheels: v [m/s], omega [rad/s].
        informed: from when the newest information is that has reached each robot, by name.
        contacts: by true geometry, in order.
        reports: the changes of the processes' health, in order.
        ends: the processes that ended by themselves, in order.
        effects: what each fault did.
    """

    robots: tuple[str, ...]
    radii: Array
    times: Array
    poses: Array
    twists: Array
    commands: Array
    informed: dict[str, Informed]
    contacts: tuple[Contact, ...]
    reports: tuple[Report, ...]
    ends: tuple[ProcessEnd, ...]
    effects: tuple[Effect, ...]

    @property
    def min_separation(self) -> float:
        """The smallest gap between two bodies [m]; negative when they overlapped, infinite for one robot."""
        return float(_gaps(self.poses, self.radii, _pairs(len(self.robots))).min(initial=np.inf))

    def digest(self) -> str:
        """A number of 256 bits that is the same only for the same run."""
        hashed = hashlib.sha256()
        for array in (self.times, self.poses, self.twists, self.commands):
            hashed.update(np.ascontiguousarray(array).tobytes())
        for name in self.robots:
            for column in self.informed[name]:
                hashed.update(column.tobytes())
        hashed.update(repr((self.contacts, self.reports, self.ends)).encode())
        hashed.update(repr([(e.begun, e.ended, e.amount) for e in self.effects]).encode())
        return hashed.hexdigest()


def _pairs(robots: int) -> list[tuple[int, int]]:
    return list(itertools.combinations(range(robots), 2))


def _gaps(poses: Array, radii: Array, pairs: list[tuple[int, int]]) -> Array:
    """Between the bodies of each pair (T, P) [m]."""
    first, second = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
    apart = poses[:, first, :2] - poses[:, second, :2]
    gaps: Array = np.hypot(apart[:, :, 0], apart[:, :, 1]) - (radii[first] + radii[second])
    return gaps


def find_contacts(robots: Sequence[str], radii: Array, times: Array, poses: Array) -> tuple[Contact, ...]:
    """The contacts of a run, by true geometry.

    Args:
        robots: the names.
        radii: of the bodies (N,) [m].
        times: (T,) [s].
        poses: (T, N, 3).
    """
    pairs = _pairs(len(robots))
    touching = _gaps(poses, radii, pairs) < 0.0
    found = []
    for number in np.flatnonzero(touching.any(axis=0)).tolist():
        first, second = pairs[number]
        edges = np.diff(np.concatenate(([0], touching[:, number].astype(np.int8), [0])))
        for begin, end in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
            last = min(int(end), len(times) - 1)
            found.append(Contact(robots[first], robots[second], float(times[begin]), float(times[last])))
    return tuple(sorted(found, key=lambda contact: (contact.begin, contact.first, contact.second)))
