"""A simulated overhead camera with its own schedule, which renders in another thread.

A real camera does not wait for thirty bases. The poses are copied on the loop at the moment of capture; a thread
renders the picture, and OpenCV releases the interpreter's lock for most of that time.
"""

from __future__ import annotations

import asyncio
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np

from agents.base.simulated import Floor
from muro_zenoh.config import CameraSettings, Scenario
from muro_zenoh.elementwise import Array
from muro_zenoh.messages import Frame
from muro_zenoh.optics.camera_model import CameraModel
from muro_zenoh.optics.jpeg import encode_jpeg
from muro_zenoh.simulation.arms import Arms
from muro_zenoh.simulation.camera import OverheadCamera
from muro_zenoh.transport import Publisher


class _Scene(NamedTuple):
    """What a camera sees: when [s], the robots' poses and twists, and the corners of an arm [px]."""

    stamp: float
    poses: Array
    twists: Array
    cover: Array | None


class SimulatedCamera:
    """One camera over a floor.

    Args:
        frames: the publisher of its frames.
        settings: its settings.
        model: its lens, and where it is.
        scenario: the arena, the robots and the simulation's hidden settings.
        floor: the floor that it sees.
        seed: seed of the floor's texture and of the noise.
        executor: renders the pictures: threads, except in virtual time.

    Attributes:
        captured: number of frames captured so far.
        skipped: number of frames skipped so far, because the previous one was still being rendered when they were due.
        lost: number of frames that were captured and never sent, as the settings say.
    """

    def __init__(
        self,
        frames: Publisher[Frame],
        settings: CameraSettings,
        model: CameraModel,
        scenario: Scenario,
        floor: Floor,
        seed: int,
        executor: Executor,
    ) -> None:
        self.captured = 0
        self.skipped = 0
        self.lost = 0
        self._frames = frames
        self._settings = settings
        self._model = model
        self._floor = floor
        self._executor = executor
        self._scenario = scenario
        self._mounts = [robot.mount for robot in scenario.robot.values()]
        self._radii = [robot.radius for robot in scenario.robot.values()]
        self._seed = seed
        self._rng = np.random.default_rng(seed)
        self._luck = np.random.default_rng((seed, 1))
        hidden = scenario.simulation
        self._arms = Arms(np.random.default_rng((seed, 2)), hidden.arm_every, settings.width, settings.height)

    async def run(self) -> None:
        """Capture at the camera's rate until cancelled. A frame that cannot be captured when it is due is skipped; it
        does not delay the next ones."""
        loop = asyncio.get_running_loop()
        lens = await loop.run_in_executor(self._executor, self._make_lens)
        hidden, period = self._scenario.simulation, 1.0 / self._settings.rate
        begin, count, due = loop.time(), 0, 0.0
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
                self.captured += 1
                stamp = self._floor.catch_up()
                jitter, luck = self._luck.random(2).tolist()
                latency = hidden.camera_latency + hidden.camera_jitter * jitter
                due = max(due, loop.time() + latency - self._floor.behind)  # frames stay in order
                if luck < hidden.camera_loss:
                    self.lost += 1
                    continue
                plant = self._floor.plant
                scene = _Scene(stamp, plant.pose.copy(), plant.twist, self._arms.cover(loop.time() - begin))
                rendering = tasks.create_task(self._take(lens, scene, due), name="render")

    async def _take(self, lens: OverheadCamera, scene: _Scene, due: float) -> None:
        """Render a picture, and schedule it to be sent at loop time ``due``."""
        loop = asyncio.get_running_loop()
        frame = await loop.run_in_executor(self._executor, self._render, lens, scene)
        loop.call_at(due, self._frames.put, frame)

    def _make_lens(self) -> OverheadCamera:
        settings, hidden = self._settings, self._scenario.simulation
        return OverheadCamera(
            self._model,
            family=settings.family,
            blur=hidden.image_blur,
            noise=hidden.image_noise,
            shade=hidden.image_shade,
            exposure=hidden.exposure,
            seed=self._seed,
        )

    def _render(self, lens: OverheadCamera, scene: _Scene) -> Frame:
        picture = lens.render(scene.poses, self._mounts, self._radii, self._rng, twists=scene.twists, cover=scene.cover)
        quality = self._settings.jpeg_quality
        return Frame(
            stamp=scene.stamp,
            width=self._settings.width,
            height=self._settings.height,
            format="jpeg" if quality > 0 else "grey",
            data=encode_jpeg(picture, quality) if quality > 0 else picture.tobytes(),
        )
