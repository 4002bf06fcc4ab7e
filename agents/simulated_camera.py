"""A simulated overhead camera with its own schedule, which renders in another thread.

A real camera does not wait for thirty bases. The poses are copied on the loop at the moment of capture; a thread
renders the picture, and OpenCV releases the interpreter's lock for most of that time.
"""

from __future__ import annotations

import asyncio
from concurrent.futures import Executor
from typing import NamedTuple, Protocol

import numpy as np

from agents.base.simulated import Look
from muro_zenoh.config import CameraSettings, Scenario
from muro_zenoh.elementwise import Array
from muro_zenoh.messages import Frame
from muro_zenoh.optics.camera_model import CameraModel
from muro_zenoh.optics.jpeg import encode_jpeg
from muro_zenoh.simulation.arms import Arms
from muro_zenoh.simulation.camera import OverheadCamera
from muro_zenoh.transport import Publisher


class _Shot(NamedTuple):
    """What a picture shows: the robots at one moment, and the corners of an arm [px]."""

    seen: Look
    cover: Array | None


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
        model: its lens, and where it is.
        scenario: the arena, the robots and the simulation's hidden settings.
        scene: what it sees.
        seed: seed of the floor's texture and of the noise.
        executor: renders the pictures: threads, except in virtual time.

    Attributes:
        captured: number of frames captured so far.
        skipped: number of frames skipped so far, because the previous one was still being rendered when they were due.
        lost: number of frames that were captured and never sent, as the settings say.
        covered: how many hands cover its lens: it then gives no pictures.
    """

    def __init__(
        self,
        frames: Publisher[Frame],
        settings: CameraSettings,
        model: CameraModel,
        scenario: Scenario,
        scene: Scene,
        seed: int,
        executor: Executor,
    ) -> None:
        self.captured = 0
        self.skipped = 0
        self.lost = 0
        self.covered = 0
        self._frames = frames
        self._settings = settings
        self._model = model
        self._scene = scene
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
                seen = self._scene.look()
                if seen is None or self.covered:
                    continue
                self.captured += 1
                jitter, luck = self._luck.random(2).tolist()
                latency = hidden.camera_latency + hidden.camera_jitter * jitter
                due = max(due, loop.time() + latency - seen.behind)  # frames stay in order
                if luck < hidden.camera_loss:
                    self.lost += 1
                    continue
                shot = _Shot(seen, self._arms.cover(loop.time() - begin))
                rendering = tasks.create_task(self._take(lens, shot, due), name="render")

    async def _take(self, lens: OverheadCamera, shot: _Shot, due: float) -> None:
        """Render a picture, and schedule it to be sent at loop time ``due``."""
        loop = asyncio.get_running_loop()
        frame = await loop.run_in_executor(self._executor, self._render, lens, shot)
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

    def _render(self, lens: OverheadCamera, shot: _Shot) -> Frame:
        picture = lens.render(
            shot.seen.poses, self._mounts, self._radii, self._rng, twists=shot.seen.twists, cover=shot.cover
        )
        quality = self._settings.jpeg_quality
        return Frame(
            stamp=shot.seen.stamp,
            width=self._settings.width,
            height=self._settings.height,
            format="jpeg" if quality > 0 else "grey",
            data=encode_jpeg(picture, quality) if quality > 0 else picture.tobytes(),
        )
