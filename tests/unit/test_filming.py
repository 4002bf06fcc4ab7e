"""A camera's process and its source: unplugged, frozen, stuck, of another size, and well again."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from basestation.filming import Filming
from basestation.localization.frames import decode_frame
from basestation.sources.opening import opener
from basestation.sources.recordings import ImageDirectory
from basestation.sources.source import FrameSource, Shot
from muro_zenoh import channels
from muro_zenoh.config import ClockSettings, parse_scenario
from muro_zenoh.errors import CameraError, ConfigError
from muro_zenoh.messages import Frame, Health
from muro_zenoh.runtime.clock import SystemClock
from muro_zenoh.runtime.virtual_time import InlineExecutor, VirtualClock, run_virtually
from muro_zenoh.transport import Bus, Every, Latest, MemoryNetwork, make_bus
from muro_zenoh.transport.measured_clock import answer_time
from tests.support.waiting import within

CLOCKS = ClockSettings()
SIZE = (64, 48)


class Fake:
    """A camera that does as the test says; each read takes a period of virtual time on the test's loop.

    Attributes:
        plugged: whether it can be opened and read.
        repeats: whether it gives the same picture again.
        size: of its pictures.
        opened: how often it was opened.
    """

    length: int | None = None
    rate = 20.0

    def __init__(self) -> None:
        self.name = "fake"
        self.plugged, self.repeats, self.size, self.opened = True, False, SIZE, 0
        self._rng = np.random.default_rng(0)
        self._image = np.zeros(SIZE[::-1], np.uint8)
        self._now = asyncio.get_running_loop().time
        self._begin = self._now()

    def open(self) -> FrameSource:
        if not self.plugged:
            raise CameraError("fake: got no camera, expected one")
        self.opened += 1
        self._begin = self._now()
        return self

    def read(self) -> Shot | None:
        if not self.plugged:
            raise CameraError("fake: gives no picture. Was it unplugged?")
        if not self.repeats:
            self._image = self._rng.integers(0, 255, self.size[::-1], dtype=np.uint8)
        return Shot(self._image, self._now() - self._begin)

    def close(self) -> None:
        pass


class Paced(InlineExecutor):
    """Calls at once, and hands a picture over after a period."""

    def submit(self, fn, /, *args, **kwargs):  # type: ignore[no-untyped-def]
        future = super().submit(fn, *args, **kwargs)
        if future.exception() is None and isinstance(future.result(), Shot):
            delayed = type(future)()
            asyncio.get_running_loop().call_later(0.05, delayed.set_result, future.result())
            return delayed
        return future


@dataclass
class Seen:
    """What is received of the camera."""

    frames: Every[Frame]
    health: Latest[Health]
    task: asyncio.Task[None]
    station: Bus

    def reasons(self) -> tuple[str, ...]:
        received = self.health.get()
        return received.message.reasons if received is not None else ("nothing received",)


@asynccontextmanager
async def filming(open_source: Callable[[], FrameSource], executor: object = None) -> AsyncIterator[Seen]:
    network = MemoryNetwork()
    clock = VirtualClock() if executor is None else SystemClock()
    async with make_bus(network.link(), clock=clock) as bus, make_bus(network.link(), clock=clock) as station:
        frames, health = station.every(channels.CAMERA, "north", depth=1024), station.latest(channels.HEALTH, "north")
        camera = Filming(bus, "north", SIZE, 85, open_source, executor or Paced(), CLOCKS)  # type: ignore[arg-type]
        task = asyncio.create_task(camera.run())
        yield Seen(frames, health, task, station)
        task.cancel()
        await asyncio.wait({task})


def test_its_pictures_are_published_with_the_time_of_their_capture() -> None:
    async def main() -> None:
        async with filming(Fake().open) as seen:
            await asyncio.sleep(2.0)
            got = seen.frames.drain()
            assert 36 <= len(got) <= 41
            for frame in got:
                message = frame.message
                picture = decode_frame(message.format, message.width, message.height, message.data)
                assert picture.shape == SIZE[::-1]
                assert frame.arrival - frame.message.stamp < 0.06
            assert seen.reasons() == ()

    run_virtually(main())


def test_the_time_of_a_picture_is_when_it_was_taken_not_when_it_had_been_looked_at() -> None:
    """As with --show: what is found and drawn takes a while, after the picture was taken."""

    async def main() -> None:
        async with filming(Fake().open) as seen:
            await asyncio.sleep(2.0)
            frames = seen.frames.drain()
            assert len(frames) > 30
            # Paced hands a picture over 50 ms after it was taken.
            ages = [frame.arrival - frame.message.stamp for frame in frames]
            assert ages == pytest.approx([0.05] * len(ages), abs=2e-3)

    run_virtually(main())


@pytest.mark.parametrize(("limit", "quality"), [(1000.0, 85), (80.0, None), (2.0, 40)])
def test_what_is_sent_stays_below_its_limit(limit: float, quality: int | None) -> None:
    """Pictures of noise, 3.7 kB at 85, 20 times a second: worse ones when that is too much, and then fewer."""

    async def main() -> None:
        network, clock = MemoryNetwork(), VirtualClock()
        async with make_bus(network.link(), clock=clock) as bus:
            frames, health = bus.every(channels.CAMERA, "north", depth=1024), bus.latest(channels.HEALTH, "north")
            camera = Filming(bus, "north", SIZE, 85, Fake().open, Paced(), CLOCKS, limit)
            task = asyncio.create_task(camera.run())
            await asyncio.sleep(10.2)
            task.cancel()
            await asyncio.wait({task})
            sent = 1e-3 * sum(len(frame.message.data) for frame in frames.drain())
            assert 0.3 * min(limit, 40.0) * 10.0 < sent < limit * 10.5
            received = health.get()
            assert received is not None
            assert 0.0 < received.message.numbers["kB_s"] <= limit
            assert received.message.reasons == ()
            assert quality in (None, camera._bandwidth.quality)

    run_virtually(main())


def test_its_clock_is_compared_with_the_base_stations() -> None:
    """A link that is slow from the first picture on would else count as quick."""

    async def main() -> None:
        async with filming(Fake().open) as seen:
            answer_time(seen.station)
            await asyncio.sleep(2.5)
            health, frame = seen.health.get(), seen.frames.drain()[-1]
            assert health is not None
            assert "clock_offset_s" in health.message.numbers
            assert seen.station.clocks.offset(frame.message.epoch, frame.arrival) < 0.01

    run_virtually(main())


@pytest.mark.parametrize(
    ("break_it", "reason"),
    [
        (lambda fake: setattr(fake, "plugged", False), "fake: g"),
        (lambda fake: setattr(fake, "repeats", True), "no new picture"),
        (lambda fake: setattr(fake, "size", (32, 48)), "got pictures of 32 x 48, expected 64 x 48"),
    ],
    ids=["unplugged", "stuck", "another size"],
)
def test_trouble_is_noticed_within_a_second_said_once_and_over_when_it_works_again(
    break_it: Callable[[Fake], None], reason: str, caplog: pytest.LogCaptureFixture
) -> None:
    async def main() -> None:
        fake = Fake()
        async with filming(fake.open) as seen:
            await asyncio.sleep(2.0)
            seen.frames.drain()
            break_it(fake)
            await asyncio.sleep(1.1)  # a last good picture may have been on its way
            assert any(reason in text for text in seen.reasons()), seen.reasons()
            assert len(seen.frames.drain()) <= 1
            await asyncio.sleep(5.0)
            assert seen.frames.drain() == []
            assert len([record for record in caplog.records if "logged once" in record.message]) == 1
            fake.plugged, fake.repeats, fake.size = True, False, SIZE
            await asyncio.sleep(1.5)
            assert seen.reasons() == ()
            assert len(seen.frames.drain()) > 5
            assert fake.opened >= 2

    with caplog.at_level("INFO"):
        run_virtually(main())
    assert "camera north works again" in caplog.text


def test_a_camera_that_is_not_there_at_the_start_is_waited_for() -> None:
    async def main() -> None:
        fake = Fake()
        fake.plugged = False
        async with filming(fake.open) as seen:
            await asyncio.sleep(3.0)
            assert seen.reasons() == ("fake: got no camera, expected one",)
            fake.plugged = True
            await asyncio.sleep(1.5)
            assert fake.opened == 1
            assert len(seen.frames.drain()) > 5

    run_virtually(main())


async def test_a_read_that_never_returns_is_noticed_and_does_not_hold_up_the_loop() -> None:
    go_on = threading.Event()

    class Frozen(Fake):
        def read(self) -> Shot | None:
            assert go_on.wait(60.0)
            raise CameraError("fake: gives no picture. Was it unplugged?")

    with ThreadPoolExecutor(1) as threads:
        async with filming(Frozen().open, threads) as seen:
            try:

                async def noticed() -> None:
                    async for received in seen.health:
                        if any("no new picture" in reason for reason in received.message.reasons):
                            return

                await within(10, noticed(), "the frozen camera on health")
            finally:
                go_on.set()


def test_a_recording_is_played_in_its_own_time_and_ends(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for k in range(8):
        cv2.imwrite(str(tmp_path / f"{k}.png"), rng.integers(0, 255, SIZE[::-1], dtype=np.uint8))

    async def main() -> None:
        network, clock = MemoryNetwork(), VirtualClock()
        async with make_bus(network.link(), clock=clock) as bus:
            frames = bus.every(channels.CAMERA, "north", depth=64)
            camera = Filming(
                bus, "north", SIZE, 0, lambda: ImageDirectory(tmp_path, 10.0), InlineExecutor(), ClockSettings()
            )
            await camera.run()
            stamps = [frame.message.stamp for frame in frames.drain()]
            assert np.diff(stamps) == pytest.approx(0.1, abs=1e-5)
            assert len(stamps) == camera.published == 8

    run_virtually(main())


def test_a_damaged_picture_does_not_end_a_recording(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    rng = np.random.default_rng(0)
    for k in range(5):
        cv2.imwrite(str(tmp_path / f"{k}.png"), rng.integers(0, 255, SIZE[::-1], dtype=np.uint8))
    (tmp_path / "2.png").write_bytes(b"\x89PNG")

    async def main() -> None:
        async with make_bus(MemoryNetwork().link(), clock=VirtualClock()) as bus:
            camera = Filming(bus, "north", SIZE, 0, lambda: ImageDirectory(tmp_path, 10.0), InlineExecutor(), CLOCKS)
            await camera.run()
            assert camera.published == 4

    run_virtually(main())
    assert "2.png: got a file that is no image" in caplog.text


def test_what_is_to_be_opened() -> None:
    lab = parse_scenario({"robots": 1, "camera": {"north": {}}}, "lab.toml", name="lab")
    with pytest.raises(ConfigError, match="NAME: got 'south', expected one of north"):
        opener(lab, "south", None, None)
    with pytest.raises(ConfigError, match=r"--recording: got nowhere\.mp4, expected a video or a directory"):
        opener(lab, "north", None, Path("nowhere.mp4"))
    with pytest.raises(CameraError, match="device /dev/video99: got no camera"):
        opener(lab, "north", "/dev/video99", None)()
