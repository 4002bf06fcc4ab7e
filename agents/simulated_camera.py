"""A simulated overhead camera with its own schedule, which renders in another thread.

A real camera does not wait for thirty bases. The poses are copied on the loop at the moment of capture; a thread
renders the picture, and OpenCV releases the interpreter's lock for most of that time.
"""

from __future__ import annotations

import asyncio
from concurrent.futures import Executor
from typing import Protocol

import numpy as np

from agents.base.simulated import Look
from muro_zenoh.config import CameraSettings, Scenario
from muro_zenoh.elementwise import Array
from muro_zenoh.messages import Frame
from muro_zenoh.simulation.camera import OverheadCamera, encode_jpeg
from muro_zenoh.transport import Publisher


class Scene(Protocol):
    """What a camera sees."""

    def look(self) -> Look | None:
        """All robots now; None when nothing can be seen."""
        ...


class SimulatedCamera:
    """One camera over a floor.

    Args:
        frames: the publisher of its frames.
        settings: its settings.
        scenario: the arena, the robots and the simulation's hidden settings.
        scene: what it sees.
        seed: seed of the floor's texture and of the noise.
        executor: renders the pictures: threads, except in virtual time.

    Attributes:
        captured: number of frames captured so far.
        skipped: number of frames skipped so far, because the previous one was still being rendered when they were due.
    """

    def __init__(
        self,
        frames: Publisher[Frame],
        settings: CameraSettings,
        scenario: Scenario,
        scene: Scene,
        seed: int,
        executor: Executor,
    ) -> None:
        self.captured = 0
        self.skipped = 0
        self._frames = frames
        self._settings = settings
        self._scene = scene
        self._executor = executor
        self._scenario = scenario
        self._mounts = [robot.mount for robot in scenario.robot.values()]
        self._radii = [robot.radius for robot in scenario.robot.values()]
        self._seed = seed
        self._rng = np.random.default_rng(seed)

    async def run(self) -> None:
        """Capture at the camera's rate until cancelled. A frame that cannot be captured when it is due is skipped; it
        does not delay the next ones."""
        loop = asyncio.get_running_loop()
        lens = await loop.run_in_executor(self._executor, self._make_lens)
        period, latency = 1.0 / self._settings.rate, self._scenario.simulation.camera_latency
        begin, count = loop.time(), 0
        rendering: asyncio.Task[None] | None = None
        async with asyncio.TaskGroup() as tasks:
            while True:
                missed = int((loop.time() - begin) / period) - count  # above 0 after this process was suspended
                self.skipped += max(0, missed)
                count += max(0, missed) + 1
                await asyncio.sleep(begin + count * period - loop.time())
                if rendering is not None and not rendering.done():
                    self.skipped += 1
                    continue
                seen = self._scene.look()
                if seen is not None:
                    self.captured += 1
                    due = loop.time() + latency - seen.behind
                    rendering = tasks.create_task(self._take(lens, seen.poses, seen.stamp, due), name="render")

    async def _take(self, lens: OverheadCamera, poses: Array, stamp: float, due: float) -> None:
        """Render a picture of the poses captured at ``stamp``, and schedule it to be sent at loop time ``due``."""
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
