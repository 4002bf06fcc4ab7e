"""Cameras of a machine, two at once, over the bus: what one of them does never stops the other one."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from basestation.filming import Filming
from basestation.sources.device import Device
from muro_zenoh import channels
from muro_zenoh.config import ClockSettings
from muro_zenoh.runtime.virtual_time import VirtualClock, run_virtually
from muro_zenoh.transport import MemoryNetwork, make_bus
from tests.unit.test_filming import SIZE, Paced


class Capture:
    """In the place of cv2.VideoCapture.

    Attributes:
        image: makes what is read next, or raises.
        plugged: whether it can be opened.
        opened: how often each device was opened.
    """

    image: dict[int, Callable[[], object]]
    plugged: dict[int, bool]
    opened: dict[int, int]

    def __init__(self, device: int) -> None:
        self._device = device
        self.opened[device] += self.plugged[device]

    def isOpened(self) -> bool:
        return self.plugged[self._device]

    def set(self, what: int, value: float) -> bool:
        return True

    def read(self) -> tuple[bool, object]:
        image = self.image[self._device]()
        return image is not None, image

    def release(self) -> None:
        pass


RNG = np.random.default_rng(0)
STUCK = np.full((*SIZE[::-1], 3), 7, np.uint8)


def well() -> object:
    return RNG.integers(0, 255, (*SIZE[::-1], 3), dtype=np.uint8)


def fails() -> object:
    raise cv2.error("select() timeout")


@pytest.fixture
def capture(monkeypatch: pytest.MonkeyPatch) -> type[Capture]:
    Capture.image = {0: well, 1: well}
    Capture.plugged = {0: True, 1: True}
    Capture.opened = {0: 0, 1: 0}
    monkeypatch.setattr(cv2, "VideoCapture", Capture)
    return Capture


@pytest.mark.parametrize(
    ("gives", "reason"),
    [
        (lambda: None, "device 0: gives no picture. Was it unplugged?"),
        (fails, "select() timeout"),
        (lambda: STUCK, "camera north: no new picture"),
        (lambda: np.zeros((0, 0, 3), np.uint8), "device 0: got 0 x 0 x 3 of uint8"),
        (lambda: np.zeros((*SIZE[::-1], 2), np.uint8), "device 0: got 48 x 64 x 2 of uint8"),
        (lambda: np.zeros(SIZE[::-1], np.float64), "device 0: got 48 x 64 of float64"),
        (lambda: np.zeros((32, 48, 3), np.uint8), "got pictures of 48 x 32, expected 64 x 48"),
    ],
    ids=["no picture", "an error", "the same one", "an empty one", "half a picture", "numbers", "another size"],
)
def test_garbage_is_named_within_a_second_said_once_retried_and_never_stops_the_other(
    capture: type[Capture], gives: Callable[[], object], reason: str, caplog: pytest.LogCaptureFixture
) -> None:
    async def main() -> None:
        network, clock = MemoryNetwork(), VirtualClock()
        async with make_bus(network.link(), clock=clock) as bus, make_bus(network.link(), clock=clock) as station:
            names = ("north", "south")
            frames = {name: station.every(channels.CAMERA, name, depth=1024) for name in names}
            health = {name: station.latest(channels.HEALTH, name) for name in names}

            def filming(number: int) -> Filming:
                return Filming(
                    bus, names[number], SIZE, 85, lambda: Device(number, *SIZE, 20.0), Paced(), ClockSettings()
                )

            tasks = [asyncio.create_task(filming(number).run()) for number in (0, 1)]
            await asyncio.sleep(2.0)
            for name in names:
                assert len(frames[name].drain()) > 36
            capture.image[0] = gives
            await asyncio.sleep(1.1)
            said = health["north"].get()
            assert said is not None
            assert any(reason in text for text in said.message.reasons), said.message.reasons
            frames["north"].drain()
            await asyncio.sleep(4.0)
            assert frames["north"].drain() == []
            assert len(frames["south"].drain()) > 95
            other = health["south"].get()
            assert other is not None
            assert other.message.reasons == ()
            capture.image[0] = well
            await asyncio.sleep(1.5)
            assert len(frames["north"].drain()) > 5
            assert capture.opened[1] == 1
            for task in tasks:
                task.cancel()
            await asyncio.wait(tasks)

    with caplog.at_level("INFO"):
        run_virtually(main())
    assert len([record for record in caplog.records if "logged once" in record.message]) == 1
    assert "camera north works again" in caplog.text
