"""A drive as the running cameras see it, over the bus."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Executor

from basestation.calibration.tag_tracks import Seen, make_search
from basestation.localization.frames import decode_frame
from basestation.localization.markers import Marker
from muro_zenoh import channels
from muro_zenoh.config import Scenario
from muro_zenoh.errors import MessageError
from muro_zenoh.messages import Frame
from muro_zenoh.transport import Bus


async def watch_drive(
    bus: Bus, scenario: Scenario, wanted: int, seconds: float, executor: Executor, on_picture: Callable[[], None]
) -> list[Seen]:
    """All tags in the cameras' pictures from now on, with capture times on this machine's clock.

    Args:
        bus: the bus.
        scenario: the fleet's settings.
        wanted: number of the tag that drives.
        seconds: how long to watch [s].
        executor: decodes and searches the pictures; with one thread per camera none waits for another.
        on_picture: called after each picture, on the loop.
    """
    rows: list[Seen] = []

    async def watch(camera: str) -> None:
        loop = asyncio.get_running_loop()
        search = make_search(scenario, camera, wanted)

        def look(frame: Frame) -> list[Marker]:
            return search.look(decode_frame(frame.format, frame.width, frame.height, frame.data))

        frames = bus.latest(channels.CAMERA, camera)
        try:
            async for frame in frames:
                captured = frame.captured(scenario.camera[camera].latency)
                try:
                    found = await loop.run_in_executor(executor, look, frame.message)
                except MessageError:  # a damaged picture is one picture less
                    continue
                rows.extend(Seen(captured, camera, marker.id, marker.corners) for marker in found)
                on_picture()
        finally:
            frames.close()

    try:
        async with asyncio.timeout(seconds), asyncio.TaskGroup() as tasks:
            for camera in scenario.camera:
                tasks.create_task(watch(camera), name=f"watch_{camera}")
    except TimeoutError:
        pass
    return rows
