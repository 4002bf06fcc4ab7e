"""The cameras' pictures for pages: twice a second, while somebody wants them, as the floor looks from above."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any, Final

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from basestation.localization.floor_map import FloorMap
from basestation.localization.frames import decode_frame
from muro_zenoh import channels
from muro_zenoh.config import Scenario
from muro_zenoh.config.cameras import camera_model
from muro_zenoh.errors import MessageError
from muro_zenoh.geometry import Bounds
from muro_zenoh.messages import Frame
from muro_zenoh.optics.jpeg import encode_jpeg
from muro_zenoh.transport import Bus, Latest

log = logging.getLogger(__name__)

PERIOD: Final = 0.5
"""Time between two pictures of a camera [s]."""

_MARGIN: Final = 0.3
"""How far round the arena they reach [m]."""

_QUALITY: Final = 70
_LARGEST: Final = 1280
"""Most pixels along one side of what is sent."""

Send = Callable[[str, bytes], None]
"""Takes a camera's name and a message for those who want its pictures."""


class Rectifier:
    """Turns the pictures of a camera into the floor as seen from above, its lens undone.

    Args:
        view: the camera.
        height: of the plane that is right [m].
        arena: the floor.

    Attributes:
        area: what of the floor is in them [m, world].
    """

    def __init__(self, view: FloorMap, height: float, arena: Bounds) -> None:
        self.area = seen_area(view, height, arena.shrunk(-_MARGIN))
        width, tall = self.area.x_max - self.area.x_min, self.area.y_max - self.area.y_min
        # As fine as the camera itself sees the middle, so that nothing is lost and nothing is invented.
        scale = min(_density(view, height, self.area), _LARGEST / max(width, tall))
        columns, rows = max(2, round(scale * width)), max(2, round(scale * tall))
        x = self.area.x_min + (np.arange(columns) + 0.5) * width / columns
        y = self.area.y_max - (np.arange(rows) + 0.5) * tall / rows
        pixels = view.to_pixels(np.stack(np.meshgrid(x, y), axis=-1), height)
        # -2: outside, where OpenCV leaves the border black.
        fine = np.nan_to_num(pixels, nan=-2.0, posinf=-2.0, neginf=-2.0).clip(-2.0, 32000.0).astype(np.float32)
        self._map = cv2.convertMaps(fine[..., 0], fine[..., 1], cv2.CV_16SC2)

    def picture(self, frame: Frame) -> bytes:
        """A frame, rectified, as JPEG.

        Args:
            frame: of the camera.

        Raises:
            MessageError: it is no picture.
        """
        grey = decode_frame(frame.format, frame.width, frame.height, frame.data)
        flat: Any = cv2.remap(grey, *self._map, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        return encode_jpeg(flat, _QUALITY)


def seen_area(view: FloorMap, height: float, limits: Bounds) -> Bounds:
    """The part of the floor that a camera sees.

    Args:
        view: the camera.
        height: of the plane [m].
        limits: no more than this.
    """
    x, y = np.linspace(limits.x_min, limits.x_max, 101), np.linspace(limits.y_min, limits.y_max, 101)
    floor = np.stack(np.meshgrid(x, y), axis=-1)
    with np.errstate(invalid="ignore"):
        seen = floor[view.margin(np.nan_to_num(view.to_pixels(floor, height), nan=-1e6)) >= 0.0]
    if len(seen) == 0:
        return limits
    (x_min, y_min), (x_max, y_max) = seen.min(axis=0).tolist(), seen.max(axis=0).tolist()
    return Bounds(x_min, x_max, y_min, y_max) if x_max > x_min and y_max > y_min else limits


def _density(view: FloorMap, height: float, area: Bounds) -> float:
    """How many pixels a camera has for a metre in the middle of an area [px/m]."""
    x, y = 0.5 * (area.x_min + area.x_max), 0.5 * (area.y_min + area.y_max)
    points: NDArray[np.float64] = np.array([[x, y], [x + 0.1, y], [x, y + 0.1]])
    pixels = view.to_pixels(points, height)
    density = 10.0 * float(np.linalg.norm(pixels[1:] - pixels[0], axis=1).max())
    return density if np.isfinite(density) and density > 1.0 else 100.0


class Pictures:
    """Sends the pictures of the cameras that somebody wants to see.

    Args:
        bus: the bus.
        scenario: the settings.
        height: of the plane that is right in them [m].
        wanted: the cameras that are wanted now.
        send: takes them.
        executor: decodes and rectifies them.
    """

    def __init__(
        self,
        bus: Bus,
        scenario: Scenario,
        height: float,
        wanted: Callable[[], set[str]],
        send: Send,
        executor: Executor,
    ) -> None:
        self._bus = bus
        self._scenario = scenario
        self._height = height
        self._wanted = wanted
        self._send = send
        self._executor = executor
        self._inboxes: dict[str, Latest[Frame]] = {}
        self._rectifiers: dict[str, Rectifier] = {}
        self._sent: dict[str, float] = {}

    async def run(self) -> None:
        """Send until cancelled. Nothing is received from a camera that nobody looks at."""
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            wanted = self._wanted()
            for name in self._inboxes.keys() - wanted:
                self._inboxes.pop(name).close()
            for name in wanted - self._inboxes.keys():
                self._inboxes[name] = self._bus.latest(channels.CAMERA, name)
            for name in sorted(wanted):
                await self._show(name)
            due = max(due + PERIOD, loop.time())
            await asyncio.sleep(due - loop.time())

    async def _show(self, name: str) -> None:
        received = self._inboxes[name].get()
        if received is None or received.arrival == self._sent.get(name):
            return
        self._sent[name] = received.arrival
        loop = asyncio.get_running_loop()
        try:
            picture, area = await loop.run_in_executor(self._executor, self._rectified, name, received.message)
        except MessageError as error:
            log.debug("camera %s: %s", name, error)
            return
        message = {
            "kind": "picture",
            "camera": name,
            "t": received.captured(),
            "jpeg": picture,
            "area": [area.x_min, area.y_min, area.x_max, area.y_max],
        }
        self._send(name, msgspec.msgpack.encode(message))

    def _rectified(self, name: str, frame: Frame) -> tuple[bytes, Bounds]:
        known = self._rectifiers.get(name)
        if known is None:
            model = camera_model(name, self._scenario.camera[name], self._scenario.arena)
            known = self._rectifiers[name] = Rectifier(FloorMap(model), self._height, self._scenario.arena)
        return known.picture(frame), known.area
