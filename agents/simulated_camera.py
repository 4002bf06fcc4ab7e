"""A simulated overhead camera: it captures on a schedule of its own, and renders off the event loop.

A real camera does not wait for thirty bases. The poses are copied on the loop at the moment of capture; a thread makes
the picture of them, and OpenCV releases the interpreter's lock for most of it.
"""

from __future__ import annotations

import asyncio
from concurrent.futures import Executor

import numpy as np

from agents.base.simulated import Floor
from muro_zenoh.config import CameraSettings, Scenario
from muro_zenoh.elementwise import Array
from muro_zenoh.messages import Frame
from muro_zenoh.simulation.camera import OverheadCamera, encode_jpeg
from muro_zenoh.transport import Publisher


class SimulatedCamera:
    """One camera over a floor.

    Args:
        frames: where its frames go.
        settings: its settings.
        scenario: the arena, the robots and what the simulation hides.
        floor: what it sees.
        seed: of its floor's looks and its noise.
        executor: where its pictures are rendered: a thread, but for a camera in virtual time.

    Attributes:
        captured: frames captured so far.
        skipped: frames so far that were not captured, because the one before was not rendered when they were due.
    """

    def __init__(
        self,
        frames: Publisher[Frame],
        settings: CameraSettings,
        scenario: Scenario,
        floor: Floor,
        seed: int,
        executor: Executor,
    ) -> None:
        self.captured = 0
        self.skipped = 0
        self._frames = frames
        self._settings = settings
        self._floor = floor
        self._executor = executor
        self._scenario = scenario
        self._mounts = [robot.mount for robot in scenario.robot.values()]
        self._radii = [robot.radius for robot in scenario.robot.values()]
        self._seed = seed
        self._rng = np.random.default_rng(seed)

    async def run(self) -> None:
        """Capture at the camera's rate until cancelled. The schedule is kept: a frame that cannot be taken when it is
        due is skipped, and does not push the next ones back."""
        loop = asyncio.get_running_loop()
        lens = await loop.run_in_executor(self._executor, self._make_lens)
        period, latency = 1.0 / self._settings.rate, self._scenario.simulation.camera_latency
        begin, count = loop.time(), 0
        rendering: asyncio.Task[None] | None = None
        async with asyncio.TaskGroup() as tasks:
            while True:
                missed = int((loop.time() - begin) / period) - count  # more than none after this process was frozen
                self.skipped += max(0, missed)
                count += max(0, missed) + 1
                await asyncio.sleep(begin + count * period - loop.time())
                if rendering is not None and not rendering.done():
                    self.skipped += 1
                    continue
                self.captured += 1
                stamp = self._floor.catch_up()
                due = loop.time() + latency - self._floor.behind
                poses = self._floor.plant.pose.copy()
                rendering = tasks.create_task(self._take(lens, poses, stamp, due), name="render")

    async def _take(self, lens: OverheadCamera, poses: Array, stamp: float, due: float) -> None:
        """Render a picture of poses captured at ``stamp``, and have it sent at ``due`` of the loop's time."""
        loop = asyncio.get_running_loop()
        frame = await loop.run_in_executor(self._executor, self._render, lens, poses, stamp)
        loop.call_at(due, self._frames.put, frame)

    def _make_lens(self) -> OverheadCamera:
        settings, hidden = self._settings, self._scenario.simulation
        return OverheadCamera.from_views(
            settings.width,
            settings.height,
            settings.views(self._scenario.arena),
            family=settings.family,
            blur=hidden.image_blur,
            noise=hidden.image_noise,
            seed=self._seed,
        )

    def _render(self, lens: OverheadCamera, poses: Array, stamp: float) -> Frame:
        picture = lens.render(poses, self._mounts, self._radii, self._rng)
        quality = self._settings.jpeg_quality
        return Frame(
            stamp=stamp,
            width=self._settings.width,
            height=self._settings.height,
            format="jpeg" if quality > 0 else "grey",
            data=encode_jpeg(picture, quality) if quality > 0 else picture.tobytes(),
        )
