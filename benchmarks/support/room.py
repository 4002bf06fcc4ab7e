"""The room that :mod:`benchmarks.latency` puts round robots: what a base station and the wheels send in a run.

Poses and a snapshot at the camera's rate, odometry at its own, all through one router; and the kept state that agents
wait for. The robots drive round a ring without a pause, wherever the measuring is.
"""

from __future__ import annotations

import asyncio
import math
import threading
import time
from bisect import bisect_left
from collections.abc import Sequence
from itertools import pairwise
from types import TracebackType
from typing import Any

from muro_zenoh import channels
from muro_zenoh.channels import Channel, key_of
from muro_zenoh.config import BusSettings
from muro_zenoh.geometry import TWO_PI, Pose2, wrap_to_pi
from muro_zenoh.messages import (
    Behaviour,
    Circle,
    FleetSnapshot,
    Message,
    Odometry,
    PoseFix,
    RobotState,
    StopOrder,
    encode,
    encoding_of,
)
from muro_zenoh.runtime.clock import SystemClock
from muro_zenoh.transport.link import LinkPublisher
from muro_zenoh.transport.zenoh_link import ZenohLink

RADIUS = 1.0
SPEED = 0.2
AGE = 0.06
"""From a picture's capture to its pose [s]."""

_COVARIANCE = (4e-6, 0.0, 0.0, 0.0, 4e-6, 0.0, 0.0, 0.0, 8e-5)


class Room:
    """Sends what robots hear in a run, from a thread of its own, and notes the commands. A context manager.

    Args:
        endpoint: of the router.
        names: of the robots.

    Attributes:
        ticks: when poses were sent [s, perf_counter].
        commands: of each robot, when one came [s, perf_counter], and its bytes.
    """

    def __init__(self, endpoint: str, names: Sequence[str]) -> None:
        settings = BusSettings(connect=(endpoint,))
        self.ticks: list[float] = []
        self.commands: dict[str, list[tuple[float, bytes]]] = {name: [] for name in names}
        self._realm = settings.realm
        self._clock = SystemClock()
        self._seq = 0
        self._link = asyncio.run(ZenohLink.open(settings))
        self._poses = {name: self._publisher(channels.POSE, name) for name in names}
        self._odometry = {name: self._publisher(channels.ODOMETRY, name) for name in names}
        self._snapshots = self._publisher(channels.ALL_POSITIONS)
        behaviour = Behaviour(behaviour="pursuit", parameters={"cruise": SPEED})
        self._kept: list[tuple[LinkPublisher, Message]] = [
            (self._publisher(channels.STOP, keep=True), StopOrder(all=False, revision=1)),
            (self._publisher(channels.CIRCLE, keep=True), Circle(x=0.0, y=0.0, radius=RADIUS, clockwise=False)),
            *((self._publisher(channels.BEHAVIOUR, name, keep=True), behaviour) for name in names),
        ]
        command = channels.CMD_VEL
        self._link.subscribe(
            key_of(self._realm, command, "*"), self._file, encoding=encoding_of(command.kind), keep=False
        )
        self._leave = threading.Event()
        self._thread = threading.Thread(target=self._run, name="room")

    def __enter__(self) -> Room:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._leave.set()
        self._thread.join()
        asyncio.run(self._link.close())

    def answers(self, begin: float, end: float) -> list[list[float | None]]:
        """How long each robot took to command, tick by tick: from the tick to its first command before the next one.

        Args:
            begin: from when on ticks count [s, perf_counter].
            end: until when [s, perf_counter].

        Returns:
            One row for each tick, in it a time [s] for each robot; None where no command came before the next tick.
        """
        ticks = [t for t in self.ticks if begin <= t <= end]
        arrivals = [[t for t, _ in commands] for commands in self.commands.values()]
        rows: list[list[float | None]] = []
        for tick, following in pairwise(ticks):
            row: list[float | None] = []
            for times in arrivals:
                k = bisect_left(times, tick)
                row.append(times[k] - tick if k < len(times) and times[k] < following else None)
            rows.append(row)
        return rows

    def _publisher(self, channel: Channel[Any], name: str = "", *, keep: bool = False) -> LinkPublisher:
        key = key_of(self._realm, channel, name)
        return self._link.publisher(key, encoding=encoding_of(channel.kind), priority=channel.priority, keep=keep)

    def _signed(self, message: Message) -> bytes:
        """A message as it goes out: stamped, and numbered as of one process."""
        self._seq += 1
        fields = {name: getattr(message, name) for name in message.__struct_fields__}
        return encode(type(message)(**fields | {"stamp": self._clock.now(), "seq": self._seq, "epoch": 1}))

    def _file(self, key: str, payload: bytes, encoding: str | None) -> None:
        commands = self.commands.get(key.rpartition("/")[2])
        if commands is not None:
            commands.append((time.perf_counter(), payload))

    def _run(self) -> None:
        """Poses, odometry and kept state, each at its own rate, none made up for after a pause."""
        senders = (
            (channels.POSE.period, self._send_poses),
            (channels.ODOMETRY.period, self._send_odometry),
            (channels.STOP.period, self._send_kept),
        )
        due = [time.perf_counter()] * len(senders)
        while not self._leave.wait(max(0.0, min(due) - time.perf_counter())):
            now = time.perf_counter()
            for k, (period, send) in enumerate(senders):
                if due[k] <= now:
                    due[k] = max(due[k] + period, now)
                    send()

    def _send_poses(self) -> None:
        """As the base station does at each picture: the fixes, then the snapshot."""
        seen = [(name, self._pose(k, self._clock.now() - AGE)) for k, name in enumerate(self._poses)]
        fixes = [
            self._signed(PoseFix(age=AGE, x=pose.x, y=pose.y, theta=pose.theta, covariance=_COVARIANCE, camera="north"))
            for _, pose in seen
        ]
        robots = tuple(RobotState(name, *pose, SPEED, SPEED / RADIUS, AGE, "tracking") for name, pose in seen)
        snapshot = self._signed(FleetSnapshot(robots=robots))
        self.ticks.append(time.perf_counter())
        for publisher, fix in zip(self._poses.values(), fixes, strict=True):
            publisher.put(fix)
        self._snapshots.put(snapshot)

    def _send_odometry(self) -> None:
        for k, publisher in enumerate(self._odometry.values()):
            x, y, theta = self._pose(k, self._clock.now())
            publisher.put(self._signed(Odometry(x=x, y=y, theta=theta, v=SPEED, omega=SPEED / RADIUS)))

    def _send_kept(self) -> None:
        for publisher, message in self._kept:
            publisher.put(self._signed(message))

    def _pose(self, robot: int, t: float) -> Pose2:
        """Where a robot is on its way round the ring."""
        angle = TWO_PI * robot / len(self._poses) + SPEED / RADIUS * t
        return Pose2(RADIUS * math.cos(angle), RADIUS * math.sin(angle), wrap_to_pi(angle + 0.5 * math.pi))
