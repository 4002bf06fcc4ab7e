"""The simulated camera: its schedule, its stamps, and that rendering does not hold up the loop."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import asynccontextmanager
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ParamSpec, TypeVar

import msgspec
import numpy as np
import pytest

from agents.base.simulated import STEP, Floor
from agents.simulated_camera import SimulatedCamera
from muro_zenoh import channels
from muro_zenoh.config import Scenario, parse_scenario
from muro_zenoh.config.cameras import camera_model
from muro_zenoh.messages import Frame
from muro_zenoh.runtime.clock import Clock, SystemClock
from muro_zenoh.runtime.virtual_time import InlineExecutor, VirtualClock, run_virtually
from muro_zenoh.simulation.camera import OverheadCamera
from muro_zenoh.simulation.plant import Plant
from muro_zenoh.transport import Every, MemoryNetwork, Received, make_bus
from tests.support.waiting import within

T = TypeVar("T")
P = ParamSpec("P")

PERIOD, LATENCY = 0.05, 0.05
LAB = parse_scenario(
    {
        "robots": 2,
        "camera": {"north": {"width": 160, "height": 120, "rate": 1.0 / PERIOD, "jpeg_quality": 0}},
        "simulation": {"camera_latency": LATENCY},
    },
    "lab.toml",
    name="lab",
)
NORTH = camera_model("north", LAB.camera["north"], LAB.arena)


@dataclass
class Filming:
    """A camera that runs, and what is received from it."""

    camera: SimulatedCamera
    frames: Every[Frame]
    task: asyncio.Task[None]

    def received(self) -> list[Received[Frame]]:
        return self.frames.drain()


@asynccontextmanager
async def filming(executor: Executor, clock: Clock, lab: Scenario = LAB) -> AsyncIterator[Filming]:
    network = MemoryNetwork()
    plant = Plant(np.zeros((2, 3)), np.random.default_rng(0))
    async with make_bus(network.link(), clock=clock) as bus, make_bus(network.link(), clock=clock) as station:
        frames = station.every(channels.CAMERA, "north", depth=1024)
        camera = SimulatedCamera(
            bus.publisher(channels.CAMERA, "north"),
            LAB.camera["north"],
            NORTH,
            lab,
            Floor(plant, clock),
            1,
            executor,
        )
        task = asyncio.create_task(camera.run())
        yield Filming(camera, frames, task)
        task.cancel()
        await asyncio.wait({task})


class SlowExecutor(Executor):
    """Renders at once, and hands each frame over after some virtual time."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        result, done = fn(*args, **kwargs), Future[T]()
        delay = self._seconds if isinstance(result, Frame) else 0.0
        asyncio.get_running_loop().call_later(delay, done.set_result, result)
        return done


def test_frames_are_stamped_at_capture_and_sent_a_latency_later() -> None:
    async def main() -> None:
        async with filming(SlowExecutor(0.02), VirtualClock()) as north:
            await asyncio.sleep(2.0)
            got = north.received()
            assert len(got) == pytest.approx(2.0 / PERIOD, abs=2)
            for frame in got:
                # The plant's state is up to a step old, and the stamp is that of the state.
                assert LATENCY - 1e-6 <= frame.arrival - frame.message.stamp <= LATENCY + STEP + 1e-6
            gaps = np.diff([frame.message.stamp for frame in got])
            assert gaps.mean() == pytest.approx(PERIOD, abs=STEP / len(gaps) + 1e-6)
            assert north.camera.skipped == 0

    run_virtually(main())


def test_latency_varies_and_frames_are_lost_as_the_settings_say() -> None:
    """Between the latency and the jitter more, never out of order; about one in four is lost, and counted."""
    hidden = msgspec.structs.replace(LAB.simulation, camera_jitter=0.03, camera_loss=0.25)
    unsteady = msgspec.structs.replace(LAB, simulation=hidden)

    async def main() -> None:
        async with filming(InlineExecutor(), VirtualClock(), unsteady) as north:
            await asyncio.sleep(20.0)
            got = north.received()
            ages = np.array([frame.arrival - frame.message.stamp for frame in got])
            assert LATENCY - 1e-6 <= ages.min() < LATENCY + 0.006
            assert LATENCY + 0.024 < ages.max() <= LATENCY + 0.03 + STEP + 1e-6
            assert np.diff([frame.message.stamp for frame in got]).min() > 0.0
            assert 0.17 < north.camera.lost / north.camera.captured < 0.33
            assert len(got) == pytest.approx(north.camera.captured - north.camera.lost, abs=2)

    run_virtually(main())


def test_a_frame_that_renders_longer_than_the_latency_is_sent_when_it_is_ready() -> None:
    async def main() -> None:
        async with filming(SlowExecutor(0.08), VirtualClock()) as north:
            await asyncio.sleep(1.0)
            for frame in north.received():
                assert 0.08 - 1e-6 <= frame.arrival - frame.message.stamp <= 0.08 + STEP + 1e-6

    run_virtually(main())


def test_frames_that_are_due_while_one_is_rendered_are_skipped_and_the_schedule_is_kept() -> None:
    async def main() -> None:
        async with filming(SlowExecutor(2.2 * PERIOD), VirtualClock()) as north:
            await asyncio.sleep(3.0)
            stamps = np.array([frame.message.stamp for frame in north.received()])
            # Each third frame is taken, at a multiple of the period: it is not the rendering that sets the pace.
            assert np.diff(stamps) == pytest.approx(3 * PERIOD, abs=STEP + 1e-6)
            assert (stamps[-1] - stamps[0]) / PERIOD == pytest.approx(3 * (len(stamps) - 1), abs=STEP / PERIOD)
            assert north.camera.captured == pytest.approx(len(stamps), abs=1)
            assert north.camera.captured + north.camera.skipped == pytest.approx(3.0 / PERIOD, abs=2)

    run_virtually(main())


def test_no_two_pictures_are_alike_even_when_nothing_moves() -> None:
    async def main() -> None:
        async with filming(InlineExecutor(), VirtualClock()) as north:
            await asyncio.sleep(2.0)
            pictures = [frame.message.data for frame in north.received()]
            assert len(pictures) > 30
            assert all(a != b for a, b in pairwise(pictures))

    run_virtually(main())


def test_an_error_in_rendering_ends_the_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("no film left")

    monkeypatch.setattr(OverheadCamera, "render", broken)

    async def main() -> None:
        async with filming(InlineExecutor(), VirtualClock()) as north:
            with pytest.raises(ExceptionGroup) as caught:
                await north.task
            assert caught.group_contains(RuntimeError, match="no film left")

    run_virtually(main())


async def test_the_loop_goes_on_while_a_thread_renders(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, go_on = threading.Event(), threading.Event()
    rendered_in: set[int] = set()
    render = OverheadCamera.render

    def slow(*arguments: Any, **others: Any) -> Any:
        rendered_in.add(threading.get_ident())
        begun.set()
        assert go_on.wait(30.0)
        return render(*arguments, **others)

    monkeypatch.setattr(OverheadCamera, "render", slow)
    with ThreadPoolExecutor(1) as pool:
        async with filming(pool, SystemClock()) as north:
            try:
                assert await within(10, asyncio.to_thread(begun.wait, 30.0), "a rendering")
                await asyncio.sleep(5 * PERIOD)  # a loop that is held up does not come back from this
                assert north.camera.skipped >= 3
                assert north.received() == []
            finally:
                go_on.set()
            await within(10, north.frames.next(), "the frame that was held up")
    assert rendered_in
    assert threading.get_ident() not in rendered_in
