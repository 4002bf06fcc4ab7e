"""The fleets that :mod:`benchmarks.latency` compares: bare Zenoh, our bus, our agents; and what one of them uses."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import psutil

from benchmarks.support.room import Room
from muro_zenoh.messages import VelocityCommand, decode
from tests.support.process import Process
from tests.support.router import Router, router

_ECHO = Path(__file__).with_name("echo.py")
_PATIENCE = 20.0


@dataclass(frozen=True, slots=True)
class Topology:
    """One way to get from a pose to a command.

    Attributes:
        name: what to call it.
        arguments: of Python, for one robot's process: from scenario file, endpoint and the robot's name.
        drives: whether a command is one that drives.
    """

    name: str
    arguments: Callable[[str, str, str], list[str]]
    drives: Callable[[bytes], bool]


def _echo(kind: str) -> Callable[[str, str, str], list[str]]:
    return lambda file, endpoint, name: [str(_ECHO), kind, endpoint, name]


def _drives(command: bytes) -> bool:
    return decode(command, VelocityCommand).v > 0.01


BARE = Topology("bare, in the callback", _echo("callback"), lambda command: True)
"""What the others are compared with: callback in, put out, nothing between."""

AGENTS = Topology("agents in pursuit", lambda file, endpoint, name: ["-m", "muro_zenoh", "agent", file, name], _drives)

TOPOLOGIES = (
    BARE,
    Topology("bare, through a loop", _echo("loop"), lambda command: True),
    Topology("our bus", _echo("bus"), lambda command: True),
    AGENTS,
)


class Use(NamedTuple):
    """What processes use: processor time so far [s], resident memory [MB of 2^20 bytes], threads."""

    cpu: float
    rss: float
    threads: int


@dataclass(frozen=True, slots=True)
class Fleet:
    """Robots' processes that run, the router between and the room round them.

    Attributes:
        room: where they drive.
        spawned: when the first of them was spawned [s, perf_counter].
    """

    room: Room
    spawned: float
    _topology: Topology
    _processes: tuple[psutil.Process, ...]

    def first_commands(self) -> tuple[float, float]:
        """Wait until every robot has commanded, and until every robot has been told to drive.

        Returns:
            When the last of them did so first [s, perf_counter].

        Raises:
            TimeoutError: one has not.
        """
        deadline = time.perf_counter() + _PATIENCE
        looked = dict.fromkeys(self.room.commands, 0)
        driving: dict[str, float] = {}
        while len(driving) < len(looked):
            for name, commands in self.room.commands.items():
                while name not in driving and looked[name] < len(commands):
                    at, payload = commands[looked[name]]
                    looked[name] += 1
                    if self._topology.drives(payload):
                        driving[name] = at
            if time.perf_counter() > deadline:
                missing = ", ".join(sorted(looked.keys() - driving.keys()))
                raise TimeoutError(f"{self._topology.name}: no command that drives {missing} within {_PATIENCE:g} s")
            time.sleep(0.001)
        return max(commands[0][0] for commands in self.room.commands.values()), max(driving.values())

    def idle(self, begin: float, end: float) -> int:
        """How many commands did not drive.

        Args:
            begin: from when on they count [s, perf_counter].
            end: until when [s, perf_counter].
        """
        commands = [row for rows in self.room.commands.values() for row in rows if begin <= row[0] <= end]
        return sum(not self._topology.drives(payload) for _, payload in commands)

    def use(self) -> Use:
        """What the router and the robots' processes have used; the room, which is this process, is not counted."""
        times = [process.cpu_times() for process in self._processes]
        return Use(
            sum(t.user + t.system for t in times),
            sum(process.memory_info().rss for process in self._processes) / 2**20,
            sum(process.num_threads() for process in self._processes),
        )


@contextlib.contextmanager
def running(topology: Topology, names: Sequence[str], folder: Path, routed: Router | None = None) -> Iterator[Fleet]:
    """A fleet, from its start to its end: when the block is left, nothing of it is alive.

    Args:
        topology: which.
        names: of the robots.
        folder: for the scenario's file.
        routed: a router that is there already; else the fleet has one of its own.
    """
    with contextlib.ExitStack() as stack:
        own = routed or stack.enter_context(router())
        file = folder / "fleet.toml"
        file.write_text(f'robots = {len(names)}\n[camera.north]\n[bus]\nconnect = ["{own.endpoint}"]\n')
        room = stack.enter_context(Room(own.endpoint, names))
        spawned = time.perf_counter()
        robots = [
            stack.enter_context(Process(topology.arguments(str(file), own.endpoint, name), name=name)) for name in names
        ]
        for robot in robots:
            robot.ready()
        pids = (own.process.pid, *(robot.pid for robot in robots))
        yield Fleet(room, spawned, topology, tuple(map(psutil.Process, pids)))
