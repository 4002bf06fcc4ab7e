"""The fleet's table: awaits sightings and estimates, sends each robot's pose and all positions."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from dataclasses import replace

from basestation.fleet.table import STALE_AFTER, FleetTable, Motion
from basestation.localization.fusion import Fusion
from basestation.localization.sightings import Sightings, SightingSource
from muro_zenoh import channels
from muro_zenoh.messages import FleetSnapshot, PoseFix
from muro_zenoh.transport import Bus

_DOUBTED = 2.0
"""What is seen and not believed is reported for this time [s]."""

CAMERA_SILENT = 0.6
"""A camera without a frame for this time is reported as missing [s]."""

_LONGEST_PERIOD = 0.2
"""All positions are published after each frame, and at least with this period [s]."""


class PositionsTask:
    """Publishes the robots' positions.

    Args:
        bus: the bus.
        robots: the names of the robots.
        fusion: makes fixes of what the cameras see.
        stale_after: a robot not seen for longer than this is ``stale`` [s].

    Attributes:
        frames: number of frames that arrived in time, good or bad.
        bad_frames: number of them that could not be used.
        stale_frames: number of frames that arrived too late.
        received_at: when each camera's newest frame arrived, good or not, by the camera's name [s].
        complaints: problems in the newest frame of each camera, by the camera's name.
        doubts: the robots that are not what they say, each with what is wrong, in words.
        doubted: set when another robot is doubted or not seen where it can be, a camera has become silent or was moved,
            for the health report.
    """

    def __init__(self, bus: Bus, robots: Iterable[str], fusion: Fusion, stale_after: float = STALE_AFTER) -> None:
        self.frames = 0
        self.bad_frames = 0
        self.stale_frames = 0
        self.received_at: dict[str, float] = {}
        self.complaints: dict[str, tuple[str, ...]] = {}
        self.doubts: dict[str, str] = {}
        self.doubted = asyncio.Event()
        self._clock = bus.clock
        self._table = FleetTable(stale_after)
        self._fusion = fusion
        self._poses = {name: bus.publisher(channels.POSE, name) for name in robots}
        self._snapshots = bus.publisher(channels.ALL_POSITIONS)
        self._estimates = bus.latest(channels.ESTIMATE, "*")
        self._published = 0.0
        self._faulty: set[tuple[str, str]] = set()

    async def watch(self, source: SightingSource) -> None:
        """Publish the sightings of one camera.

        Args:
            source: the camera.
        """
        async for sightings in source:
            self._take(sightings)

    async def repeat(self) -> None:
        """Publish all positions also while there are no frames, because their ages grow."""
        while True:
            silent = self._clock.now() - self._published
            if not 0.0 <= silent < _LONGEST_PERIOD:  # or the clock was set back
                self._publish_all()
                silent = 0.0
            await asyncio.sleep(_LONGEST_PERIOD - silent)

    def was_seen(self, name: str) -> bool:
        """Whether a camera has seen a robot since it was last cleared.

        Args:
            name: of the robot.
        """
        return self._table.knows(name)

    @property
    def disbelieved(self) -> int:
        """Number of sightings that were not believed."""
        return self._fusion.disbelieved

    def unbelieved(self) -> list[str]:
        """What was seen lately and not believed, and the cameras that were moved."""
        return [*self._fusion.moved.values(), *self._lately_disbelieved().values()]

    def clear(self, name: str) -> bool:
        """Forget a robot's last position.

        Args:
            name: of the robot.

        Returns:
            Whether it had been seen.
        """
        self._estimates.forget(name)
        self._fusion.forget(name)
        return self._table.clear(name)

    def _take(self, sightings: Sightings) -> None:
        self.received_at[sightings.camera] = self._clock.now()
        self.complaints[sightings.camera] = sightings.complaints
        if sightings.frame == "stale":
            self.stale_frames += 1
            return
        self.frames += 1
        if sightings.frame == "bad":
            self.bad_frames += 1
            return
        # A fix captured in the future would keep valid ones out until then.
        captured = min(sightings.captured, self._clock.now())
        for robot in self._fusion.take(replace(sightings, captured=captured), self._clock.now()):
            now = self._clock.now()
            x, y, theta = robot.pose
            self._poses[robot.name].put(
                PoseFix(
                    stamp=now,
                    age=max(0.0, now - captured),
                    x=x,
                    y=y,
                    theta=theta,
                    covariance=robot.covariance,
                    camera="+".join(robot.cameras),
                )
            )
            self._table.fix(robot.name, robot.pose, captured)
        self._publish_all()

    def _publish_all(self) -> None:
        now = self._published = self._clock.now()
        for name, estimate in self._estimates.values().items():
            m = estimate.message
            if estimate.age(now) <= channels.ESTIMATE.stale_after:
                self._table.estimate(name, Motion(m.pose, m.v, m.omega, min(estimate.captured(), now)))
        self._snapshots.put(FleetSnapshot(stamp=now, robots=self._table.snapshot(now)))
        before, self.doubts = self.doubts, self._table.doubts(now)
        silent = {("silent", camera) for camera, t in self.received_at.items() if now - t > CAMERA_SILENT}
        faulty = silent | {("moved", camera) for camera in self._fusion.moved} | self._lately_disbelieved().keys()
        if self.doubts.keys() - before.keys() or faulty - self._faulty:
            self.doubted.set()
        self._faulty = faulty

    def _lately_disbelieved(self) -> dict[tuple[str, str], str]:
        """What was seen lately and not believed, by camera and robot."""
        now = self._clock.now()
        doubts = self._fusion.doubts.items()
        return {(f"camera {camera}", name): text for (camera, name), (text, t) in doubts if now - t < _DOUBTED}
