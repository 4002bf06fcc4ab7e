"""A camera's process: takes pictures from a source and publishes them, whatever the source does."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial

import numpy as np

from basestation.bandwidth import Bandwidth
from basestation.sources.source import FrameSource, Picture
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import ClockSettings, Scenario
from muro_zenoh.errors import CameraError
from muro_zenoh.messages import Frame, Health
from muro_zenoh.optics.jpeg import encode_jpeg
from muro_zenoh.runtime.process import ready, worker_threads
from muro_zenoh.transport import Bus, open_bus
from muro_zenoh.transport.measured_clock import StationClock

log = logging.getLogger(__name__)

_RETRY = 1.0
"""A source that failed is opened again after this time [s]."""
_SILENT = 0.8
"""A source without a new picture for this time is in trouble [s] ..."""
_LOOK = 0.2
"""... which is looked at with this period [s]."""


class Filming:
    """Publishes a source's pictures.

    Trouble is on health within a second, and in the log once per episode: a source that cannot be opened, that fails,
    is silent, repeats a picture, or gives pictures of another size. It is opened again until it works.

    Args:
        bus: the bus.
        name: of the camera.
        size: width and height of its pictures [px].
        quality: of the JPEG, 1 to 100; 0 for raw grey frames.
        open_source: opens the source; it and the source are called in the executor.
        executor: with one thread.
        clocks: above which differences from the base station's clock there is a complaint.
        bandwidth: limit of what is sent [kB/s]: above it pictures become worse, and then fewer.

    Attributes:
        published: number of pictures published.
    """

    def __init__(
        self,
        bus: Bus,
        name: str,
        size: tuple[int, int],
        quality: int,
        open_source: Callable[[], FrameSource],
        executor: Executor,
        clocks: ClockSettings,
        bandwidth: float = math.inf,
    ) -> None:
        self.published = 0
        self._bus = bus
        self._name = name
        self._size = size
        self._raw = quality == 0
        self._bandwidth = Bandwidth(quality, bandwidth)
        self._open = open_source
        self._executor = executor
        self._frames = bus.publisher(channels.CAMERA, name)
        self._health = bus.publisher(channels.HEALTH, name)
        self._clock = StationClock(bus, clocks)
        self._last: Picture | None = None
        self._trouble = ""
        self._good_at = bus.clock.now()

    async def run(self) -> None:
        """Film until a recording ends, or is damaged; a camera is tried again and again."""
        async with asyncio.TaskGroup() as tasks:
            others = [
                tasks.create_task(self._report(), name="health"),
                tasks.create_task(self._clock.run(), name="clock"),
            ]
            await self._film()
            for task in others:
                task.cancel()

    async def _film(self) -> None:
        loop = asyncio.get_running_loop()
        call = partial(loop.run_in_executor, self._executor)
        while True:
            try:
                source = await call(self._open)
                opened = self._bus.clock.now()  # what a device counts its time from
            except CameraError as error:
                self._note(str(error))
                await asyncio.sleep(_RETRY)
                continue
            try:
                begin = fresh = loop.time()
                while True:
                    try:
                        shot = await call(source.read)
                    except CameraError as error:
                        if source.length is None:
                            raise
                        self._note(str(error))  # of a recording the other pictures are good
                        continue
                    if shot is None:
                        return
                    if source.length is not None:  # a recording: in its own time
                        await asyncio.sleep(begin + shot.t - loop.time())
                        captured = self._bus.clock.now()
                    else:
                        captured = min(opened + shot.t, self._bus.clock.now())
                    frame = await call(self._frame, shot.image, captured)
                    if frame is None and source.length is None and loop.time() - fresh > _SILENT:
                        raise CameraError(f"camera {self._name}: no new picture, the same one again. Is it stuck?")
                    if frame is not None:
                        fresh = loop.time()
                        if self._bandwidth.takes(len(frame.data), self._bus.clock.now()):
                            self._frames.put(frame)
                            self.published += 1
                        self._good_at = self._bus.clock.now()
                        self._note("")
            except CameraError as error:
                self._note(str(error))
                if source.length is not None:
                    return  # a recording that is damaged does not get better
            finally:
                await call(source.close)
            await asyncio.sleep(_RETRY)

    def _frame(self, image: Picture, captured: float) -> Frame | None:
        """In the executor: the message; None for the same picture once more."""
        height, width = image.shape
        if (width, height) != self._size:
            expected = f"expected {self._size[0]} x {self._size[1]} as in the settings"
            raise CameraError(
                f"camera {self._name}: got pictures of {width} x {height}, {expected}. Does it have that resolution?"
            )
        if self._last is not None and np.array_equal(image, self._last):
            return None  # no sensor gives the same bytes twice
        self._last = image
        data = image.tobytes() if self._raw else encode_jpeg(image, self._bandwidth.quality)
        return Frame(stamp=captured, width=width, height=height, format="grey" if self._raw else "jpeg", data=data)

    def _note(self, trouble: str) -> None:
        """Log the beginning and the end of trouble."""
        if trouble and not self._trouble:
            log.warning("%s (logged once until it works again)", trouble)
        elif self._trouble and not trouble:
            log.info("camera %s works again", self._name)
        self._trouble = trouble

    async def _report(self) -> None:
        said: tuple[str, ...] = ("",)
        due = 0.0
        while True:
            now = self._bus.clock.now()
            silent = now - self._good_at
            if silent > _SILENT and not self._trouble:
                self._note(f"camera {self._name}: no new picture. Is it frozen, or was it unplugged?")
            reasons = (self._trouble,) if self._trouble else ()
            if reasons != said or now >= due:
                said, due = reasons, now + channels.HEALTH.period
                state = "waiting" if reasons else "filming"
                numbers = {
                    "frames": float(self.published),
                    "kB_s": round(self._bandwidth.used(now), 1),
                    **self._clock.numbers(),
                    **self._bus.numbers(),
                }
                complaints = self._clock.complaints()
                self._health.put(
                    Health(role=Role.CAMERA, state=state, reasons=reasons, complaints=complaints, numbers=numbers)
                )
            await asyncio.sleep(_LOOK)


async def run_camera(
    scenario: Scenario,
    name: str,
    open_source: Callable[[], FrameSource],
    quality: int,
    bandwidth: float = math.inf,
) -> None:
    """The camera's process.

    Args:
        scenario: the settings.
        name: of the camera.
        open_source: opens what takes the pictures.
        quality: of the JPEG, 1 to 100; 0 for raw grey frames.
        bandwidth: limit of what is sent [kB/s].

    Raises:
        NotConnected: no router answered.
    """
    settings = scenario.camera[name]
    size = settings.width, settings.height
    with worker_threads(1, "camera") as threads:
        async with open_bus(scenario.bus, Role.CAMERA) as bus:
            filming = Filming(bus, name, size, quality, open_source, threads, scenario.clocks, bandwidth)
            bus.announce(Role.CAMERA, name)
            ready("camera", name)
            await filming.run()
