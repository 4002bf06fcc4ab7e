"""Overhead cameras without pictures: their frames carry the poses of the robots that they see, and noise."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Sequence

import msgspec
import numpy as np

from agents.base.simulated import Floor
from basestation.localization.sightings import Sighting
from basestation.tasks.vision import CameraOnBus, Found
from muro_zenoh import channels
from muro_zenoh.config import CameraSettings
from muro_zenoh.errors import MessageError
from muro_zenoh.geometry import Pose2
from muro_zenoh.messages import Frame
from muro_zenoh.messages.base import require_usable
from muro_zenoh.runtime.virtual_time import InlineExecutor
from muro_zenoh.transport import Bus

_SIGMA = np.array((0.001, 0.001, 0.005))
"""Standard deviation of a pose [m, m, rad] ..."""

_COVARIANCE = (1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 2.5e-5)
"""... and what the base station takes it for."""


class _Picture(msgspec.Struct, frozen=True):
    """What a frame carries: when it was taken [s, loop], and rows of name, x [m], y [m], theta [rad]."""

    taken: float
    robots: list[tuple[str, float, float, float]]


_encode = msgspec.msgpack.Encoder().encode
_decode = msgspec.msgpack.Decoder(_Picture).decode


class View:
    """What comes between the cameras and the robots. It outlives the cameras' processes.

    Attributes:
        blind: how many faults make a camera give no pictures, by its name.
        hidden: how many hide a robot from all cameras, by its name.
        missed: how many pictures were not taken, by camera, and sightings not made, by robot.
    """

    def __init__(self) -> None:
        self.blind: Counter[str] = Counter()
        self.hidden: Counter[str] = Counter()
        self.missed: Counter[str] = Counter()


class SightingCamera:
    """One camera, which sees the whole floor.

    Args:
        bus: the bus.
        name: its name.
        settings: its rate.
        floor: what it sees.
        view: what it does not see.
        robots: the names of the robots, in the plant's order.
        latency: from capture to sending [s].
        rng: for the noise.
    """

    def __init__(
        self,
        bus: Bus,
        name: str,
        settings: CameraSettings,
        floor: Floor,
        view: View,
        robots: Sequence[str],
        latency: float,
        rng: np.random.Generator,
    ) -> None:
        self._frames = bus.publisher(channels.CAMERA, name)
        self._clock = bus.clock
        self._name = name
        self._period = 1.0 / settings.rate
        self._latency = latency
        self._floor = floor
        self._view = view
        self._robots = robots
        self._rng = rng

    async def run(self) -> None:
        """Take pictures at the camera's rate until cancelled; those that were due while it was frozen are skipped."""
        loop = asyncio.get_running_loop()
        begin, count = loop.time(), 0
        while True:
            count = max(count + 1, int((loop.time() - begin) / self._period))
            await asyncio.sleep(begin + count * self._period - loop.time())
            self._floor.catch_up()
            if self._view.blind[self._name]:
                self._view.missed[self._name] += 1
                continue
            now = loop.time()
            frame = Frame(stamp=self._clock.now(), width=1, height=1, format="grey", data=_encode(self._look(now)))
            loop.call_at(now + self._latency, self._frames.put, frame)

    def _look(self, now: float) -> _Picture:
        poses = self._floor.plant.pose
        seen = (poses + _SIGMA * self._rng.standard_normal(poses.shape)).tolist()
        rows = []
        for name, (x, y, theta) in zip(self._robots, seen, strict=True):
            if self._view.hidden[name]:
                self._view.missed[name] += 1
            else:
                rows.append((name, x, y, theta))
        return _Picture(now, rows)


class SightingsOnBus(CameraOnBus):
    """The frames of a :class:`SightingCamera`, at the base station.

    Args:
        bus: the bus.
        name: the camera's name.
        latency: minimum time from the capture of a frame to its arrival here [s].
        robots: the names of the robots that can be seen.
        located: called with when a frame was taken, in truth, as it is located [s, loop].
    """

    def __init__(
        self, bus: Bus, name: str, latency: float, robots: Sequence[str], located: Callable[[float], None]
    ) -> None:
        super().__init__(bus, name, self._read, latency, InlineExecutor())
        self._known = {robot: robot for robot in robots}
        self._located = located

    def _read(self, frame: Frame) -> Found:
        try:
            picture = _decode(frame.data)
            for name, *pose in picture.robots:
                require_usable(self._known[name], tuple(pose))
        except (msgspec.MsgspecError, KeyError, ValueError) as error:  # of another program
            raise MessageError(f"got a frame without poses, expected one of a fleet in memory: {error}") from None
        self._located(picture.taken)
        return Found(tuple(Sighting(name, Pose2(x, y, theta), _COVARIANCE) for name, x, y, theta in picture.robots), ())
