"""The base station's health: report once a second, and exit when another base station was here first."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math

from basestation.tasks.bases import BasesTask
from basestation.tasks.kept_state import KeptStateTask
from basestation.tasks.positions import CAMERA_SILENT, PositionsTask
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.errors import TransportError
from muro_zenoh.messages import Health
from muro_zenoh.runtime.waiting import WaitingLog
from muro_zenoh.transport import Bus

log = logging.getLogger(__name__)

_PERIOD = channels.HEALTH.period
_RUNNING = "running"

_OTHER_GONE = 3.0
"""Another base station without a report for this time is gone [s]."""


class HealthTask:
    """Reports the base station's health, and reads that of any other one.

    Args:
        bus: the bus.
        kept: the kept state's task.
        positions: the fleet's table.
        bases: what the robots' bases say of their wheels.
        robots: the names of the robots.
        cameras: the names of the cameras in the settings.
    """

    def __init__(
        self,
        bus: Bus,
        kept: KeptStateTask,
        positions: PositionsTask,
        bases: BasesTask,
        robots: tuple[str, ...],
        cameras: tuple[str, ...],
    ) -> None:
        self._bus = bus
        self._kept = kept
        self._positions = positions
        self._bases = bases
        self._robots = robots
        self._cameras = cameras
        self._own = bus.publisher(channels.HEALTH, "basestation")
        self._reports = bus.every(channels.HEALTH, "basestation")
        self._roster = bus.roster()
        self._other_seen = -math.inf

    async def report(self) -> None:
        """Publish the health once a second, and at once when a robot is not what it says, or a camera fails."""
        positions = self._positions
        waiting = WaitingLog(log, "waiting", "nothing is missing now")
        while True:
            reasons = self._reasons()
            waiting.note(self._bus.clock.now(), reasons)
            numbers = {
                "frames": float(positions.frames),
                "bad_frames": float(positions.bad_frames),
                "stale_frames": float(positions.stale_frames),
                "disbelieved": float(positions.disbelieved),
                **self._bus.numbers(),
            }
            state = _RUNNING if self._kept.adopted else "starting"
            self._own.put(Health(role=Role.BASESTATION, state=state, reasons=reasons, numbers=numbers))
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_PERIOD):
                    await positions.doubted.wait()
            positions.doubted.clear()

    def _reasons(self) -> tuple[str, ...]:
        now, reasons = self._bus.clock.now(), []
        if now - self._other_seen < _OTHER_GONE:
            reasons.append("another base station is running: stop one of them")
        alive = self._roster.of(Role.AGENT)
        reasons += [f"no agent of {name}" for name in self._robots if name not in alive]
        reasons += self._missing_sightings(now)
        for complaints in self._positions.complaints.values():
            reasons += complaints
        reasons += self._positions.unbelieved()
        reasons += self._positions.doubts.values()
        reasons += self._bases.reasons()
        return tuple(reasons)

    def _missing_sightings(self, now: float) -> list[str]:
        """Cameras without frames, and the robots that no working camera has seen."""
        received_at = self._positions.received_at
        if not self._cameras and not received_at:
            return ["no camera in the settings: no robot drives without poses"]
        missing = []
        for camera in self._cameras:
            silent = now - received_at.get(camera, -math.inf)
            if silent > CAMERA_SILENT:
                age = "yet" if silent == math.inf else f"for {silent:.1f} s"
                missing.append(f"no frames from camera {camera} {age}")
        if self._positions.frames > self._positions.bad_frames:
            missing += [f"no camera has seen {name} yet" for name in self._robots if not self._positions.was_seen(name)]
        return missing

    async def be_the_only_one(self) -> None:
        """Two base stations would publish different states in turn: the one that was started later exits.

        Raises:
            TransportError: this one was started later.
        """
        async for received in self._reports:
            other = received.message
            if other.epoch == self._bus.epoch:
                continue
            if not self._kept.adopted and (other.state == _RUNNING or other.epoch < self._bus.epoch):
                raise TransportError(
                    f"realm {self._bus.realm}: got another base station on this router, expected to be the only one. "
                    "Stop the other one first, or set another [bus] realm for this lab"
                )
            self._other_seen = self._bus.clock.now()
