"""Vision, one task per camera: awaits the newest frame, locates the robots in a thread, yields the sightings."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Executor
from functools import partial
from typing import NamedTuple

from basestation.localization.frames import decode_frame
from basestation.localization.localizer import Localizer
from basestation.localization.of_scenario import make_localizer
from basestation.localization.sightings import Sighting, Sightings, SightingSource
from muro_zenoh import channels
from muro_zenoh.config import Scenario
from muro_zenoh.errors import MessageError
from muro_zenoh.messages import Frame
from muro_zenoh.transport import Bus, Received
from muro_zenoh.transport.delay import UNMEASURED

log = logging.getLogger(__name__)


class CameraOnBus:
    """A camera whose frames come over the bus, as a :class:`~basestation.localization.sightings.SightingSource`.

    Args:
        bus: the bus.
        name: the camera's name.
        locate: finds the robots in one of its frames, or raises a MessageError; called in the executor.
        latency: minimum time from the capture of a frame to its arrival here [s].
        executor: decodes and searches the frames, one at a time.
    """

    def __init__(
        self, bus: Bus, name: str, locate: Callable[[Frame], Found], latency: float, executor: Executor
    ) -> None:
        self._bus = bus
        self._name = name
        self._locate_in = locate
        self._latency = latency
        self._executor = executor
        self._last_picture = b""
        self._failing = False
        self._epoch = -1
        self._first = -math.inf

    async def __aiter__(self) -> AsyncIterator[Sightings]:
        """Of the frames that arrive while one is being searched, only the newest is used."""
        frames = self._bus.latest(channels.CAMERA, self._name)
        try:
            async for frame in frames:
                yield await self._look(frame)
        finally:
            frames.close()

    async def _look(self, frame: Received[Frame]) -> Sightings:
        captured = frame.captured(self._latency)
        late = self._late(frame, captured)
        if late is not None:
            return late
        loop = asyncio.get_running_loop()
        try:
            found = await loop.run_in_executor(self._executor, self._locate, frame.message)
        except MessageError as error:
            if not self._failing:
                log.warning("camera %s: dropped a frame: %s (logged once until a good one comes)", self._name, error)
            self._failing = True
            bad = f"camera {self._name}: {error}"
            return Sightings(camera=self._name, captured=captured, frame="bad", complaints=(bad,))
        self._failing = False
        # This process may have been suspended while it searched the frame.
        late = self._late(frame, captured)
        if late is not None:
            return late
        return Sightings(
            camera=self._name,
            captured=captured,
            robots=found.robots,
            complaints=found.complaints,
            floor_off=found.floor_off,
        )

    def _late(self, frame: Received[Frame], captured: float) -> Sightings | None:
        """Nothing seen, and why, when a frame is too old by now: the robots have moved since. So may be one of a camera
        whose clock is not known yet: it may be on a link that has been slow from its start."""
        now = self._bus.clock.now()
        age = frame.age(now)
        if frame.message.epoch != self._epoch:
            self._epoch, self._first = frame.message.epoch, now
        measures = frame.message.epoch != 0  # else it is another lab's program, whose clock will never be known
        unknown = measures and frame.measured == math.inf and now - self._first < UNMEASURED
        if age <= channels.CAMERA.stale_after and not unknown:
            return None
        late = f"camera {self._name}: " + (
            "its clock is not known yet" if unknown else f"frames arrive {age:.1f} s late"
        )
        return Sightings(camera=self._name, captured=captured, frame="stale", complaints=(late,))

    def _locate(self, frame: Frame) -> Found:
        """In the executor."""
        if frame.data == self._last_picture:
            # No sensor gives the same bytes twice: the stamp is new, but the poses are not.
            raise MessageError("got the same picture as before, expected a new one: is the camera stuck?")
        self._last_picture = frame.data
        return self._locate_in(frame)


class Found(NamedTuple):
    """What a frame shows: the ``robots``, ``complaints`` about the tags in it, for the operator, and ``floor_off``: how
    far from their places the tags on the floor are."""

    robots: tuple[Sighting, ...]
    complaints: tuple[str, ...]
    floor_off: tuple[tuple[float, float], ...] = ()


def _locate_tags(localizer: Localizer, frame: Frame) -> Found:
    robots = localizer.locate(decode_frame(frame.format, frame.width, frame.height, frame.data))
    return Found(tuple(robots), localizer.complaints, localizer.floor_off)


def cameras_on_bus(bus: Bus, scenario: Scenario, executor: Executor) -> list[SightingSource]:
    """All cameras of a scenario, as sources of sightings.

    Args:
        bus: the bus.
        scenario: the settings.
        executor: decodes and searches the frames; with one thread per camera none waits for another.

    Raises:
        ConfigError: a camera's points do not determine a homography, or its family of tags is unknown.
    """
    return [
        CameraOnBus(bus, name, partial(_locate_tags, make_localizer(scenario, name)), camera.latency, executor)
        for name, camera in scenario.camera.items()
    ]
