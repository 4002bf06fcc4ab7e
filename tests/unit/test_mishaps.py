"""What befalls robots and cameras of a simulated room while it runs."""

from __future__ import annotations

import asyncio
from typing import Any, cast

import numpy as np
import pytest

from agents.base.simulated import Floor, make_plant
from agents.mishaps import Mishaps
from agents.simulated_camera import SimulatedCamera
from muro_zenoh.config import parse_scenario
from muro_zenoh.errors import ConfigError, OrderRefused
from muro_zenoh.messages import Break
from muro_zenoh.runtime.virtual_time import VirtualClock, run_virtually

LAB = parse_scenario({"robots": 2, "camera": {"north": {}, "south": {}}}, "lab.toml", name="lab")


class Lens:
    """A camera, as far as it can be covered."""

    covered = 0


class Room:
    def __init__(self) -> None:
        self.floor = Floor(make_plant(LAB, np.random.default_rng(1)), VirtualClock())
        self.lenses = {"north": Lens(), "south": Lens()}
        self.mishaps = Mishaps(LAB, self.floor, cast("dict[str, SimulatedCamera]", self.lenses))

    def order(self, fault: str, target: str, duration: float | None = None, **numbers: Any) -> None:
        reply = self.mishaps.befall(Break(fault=fault, target=target, duration=duration, numbers=numbers))
        assert reply.accepted

    @property
    def covered(self) -> list[bool]:
        return [bool(lens.covered) for lens in self.lenses.values()]

    def place(self, row: int) -> list[float]:
        self.floor.catch_up()
        pose: list[float] = self.floor.plant.pose[row].tolist()
        return pose


def test_a_robot_is_carried_evenly_and_set_down() -> None:
    async def main() -> None:
        room = Room()
        (x, y, _), other = room.place(1), room.place(0)
        room.order("carry", "r2", 2.0, x=0.6, y=-0.2)
        await asyncio.sleep(1.0)
        assert room.place(1)[:2] == pytest.approx([x + 0.3, y - 0.1], abs=0.01)
        await asyncio.sleep(5.0)
        assert room.place(1)[:2] == pytest.approx([x + 0.6, y - 0.2], abs=1e-6)
        assert room.place(0) == other
        room.floor.command(1, 0.2, 0.0)
        await asyncio.sleep(1.0)
        assert room.place(1)[:2] != pytest.approx([x + 0.6, y - 0.2], abs=0.05), "it is let go"

    run_virtually(main())


def test_lenses_are_covered_for_a_time_each_by_each_hand() -> None:
    async def main() -> None:
        room = Room()
        room.order("camera_dropout", "camera/north", 2.0)
        room.order("camera_dropout", "camera", 1.0)
        assert room.covered == [True, True]
        await asyncio.sleep(1.5)
        assert room.covered == [True, False]
        await asyncio.sleep(1.0)
        assert room.covered == [False, False]
        room.order("camera_dropout", "camera/south")
        await asyncio.sleep(100.0)
        assert room.covered == [False, True]

    run_virtually(main())


def test_what_cannot_happen_there_is_refused() -> None:
    async def main() -> None:
        room = Room()
        with pytest.raises(OrderRefused, match="expected a robot that is carried off, or a camera"):
            room.order("crash", "r1/agent")
        with pytest.raises(OrderRefused, match="expected a robot that is carried off, or a camera"):
            room.order("camera_dropout", "r1", 1.0)
        with pytest.raises(ConfigError, match="target"):
            room.order("carry", "r7", 1.0)
        with pytest.raises(ConfigError, match="how long it is carried"):
            room.order("carry", "r1", x=0.5)
        del room.lenses["south"]
        with pytest.raises(OrderRefused, match="camera south is a process of its own"):
            room.order("camera_dropout", "camera")
        assert room.covered == [False]

    run_virtually(main())
