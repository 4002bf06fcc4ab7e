"""The process that stands in for the room: all robots' bases on one plant, and the overhead cameras.

``python -P -m agents.simulator SCENARIO --seed N``
"""

from __future__ import annotations

import argparse
import asyncio
import logging
import math
import sys

import numpy as np

from agents.base.base import run_base
from agents.base.simulated import Floor, SimulatedWheels
from muro_zenoh import channels
from muro_zenoh.config import CameraSettings, Scenario, load_scenario
from muro_zenoh.messages import Frame, Health, Truth
from muro_zenoh.runtime.process import ready, run_process
from muro_zenoh.simulation.camera import OverheadCamera, encode_jpeg
from muro_zenoh.simulation.plant import Plant
from muro_zenoh.simulation.starts import random_starts
from muro_zenoh.transport import Bus, open_bus

log = logging.getLogger(__name__)

_TRUTH_PERIOD = 0.02
_HEALTH_PERIOD = 1.0


class Room:
    """The room: robots, floor and cameras.

    Args:
        bus: the bus.
        scenario: the settings.
        seed: draws starts, hidden drive errors and every noise.

    Raises:
        PlanningError: the robots do not fit into the arena.
    """

    def __init__(self, bus: Bus, scenario: Scenario, seed: int) -> None:
        rng = np.random.default_rng(seed)
        robots = list(scenario.robot.values())
        hidden = scenario.simulation
        radii = np.array([robot.radius for robot in robots])
        starts = random_starts(rng, len(robots), scenario.arena, radii)
        limits = [robot.wheels for robot in robots]
        self.plant = Plant(starts, rng, limits=limits, radius=radii, drive_error=hidden.drive_error, slip=hidden.slip)
        self._bus = bus
        self._scenario = scenario
        self._seed = seed
        self._floor = Floor(self.plant, bus.clock)
        self._truth = [bus.publisher(channels.TRUTH, name) for name in scenario.robot]
        self._health = bus.publisher(channels.HEALTH, "simulator")

    async def run(self) -> None:
        """Run bases, plant and cameras."""
        async with asyncio.TaskGroup() as tasks:
            for row, name in enumerate(self._scenario.robot):
                wheels = SimulatedWheels(self._floor, row)
                tasks.create_task(run_base(self._bus, name, wheels, self._bus.clock), name=f"base {name}")
            tasks.create_task(self._tell(), name="truth")
            for index, (name, camera) in enumerate(self._scenario.camera.items()):
                tasks.create_task(self._film(name, camera, self._seed + index), name=f"camera {name}")
            tasks.create_task(self._report(), name="health")

    async def _tell(self) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            due = max(due + _TRUTH_PERIOD, loop.time())
            await asyncio.sleep(due - loop.time())
            stamp = self._floor.catch_up()
            rows = zip(self._truth, self.plant.pose.tolist(), self.plant.twist.tolist(), strict=True)
            for publisher, (x, y, theta), (v, omega) in rows:
                publisher.put(Truth(stamp=stamp, x=x, y=y, theta=theta, v=v, omega=omega))

    async def _film(self, name: str, camera: CameraSettings, seed: int) -> None:
        hidden = self._scenario.simulation
        lens = OverheadCamera.from_views(
            camera.width,
            camera.height,
            camera.views(self._scenario.arena),
            family=camera.family,
            blur=hidden.image_blur,
            noise=hidden.image_noise,
            seed=seed,
        )
        robots = self._scenario.robot.values()
        mounts = [robot.mount for robot in robots]
        radii = [robot.radius for robot in robots]
        rng = np.random.default_rng(seed)
        frames = self._bus.publisher(channels.CAMERA, name)
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            due = max(due + 1.0 / camera.rate, loop.time())
            await asyncio.sleep(due - loop.time())
            captured, shot = self._floor.catch_up(), loop.time()
            picture = lens.render(self.plant.pose, mounts, radii, rng)
            jpeg = camera.jpeg_quality > 0
            frame = Frame(
                stamp=captured,
                width=camera.width,
                height=camera.height,
                format="jpeg" if jpeg else "grey",
                data=encode_jpeg(picture, camera.jpeg_quality) if jpeg else picture.tobytes(),
            )
            loop.call_at(shot + hidden.camera_latency, frames.put, frame)

    async def _report(self) -> None:
        plant = self.plant
        scales = {}
        for row, name in enumerate(self._scenario.robot):
            scales[f"scale_v_{name}"] = float(plant.s_v[row])
            scales[f"scale_omega_{name}"] = float(plant.s_omega[row])
        while True:
            separation = {"min_separation_m": plant.min_separation} if math.isfinite(plant.min_separation) else {}
            numbers = {
                "collisions": float(plant.contacts),
                "lost_s": round(self._floor.lost, 3),
                **separation,
                **scales,
                **self._bus.numbers(),
            }
            self._health.put(Health(role="simulator", state="running", numbers=numbers))
            await asyncio.sleep(_HEALTH_PERIOD)


async def run_simulator(scenario: Scenario, seed: int) -> None:
    """The simulator process.

    Args:
        scenario: the settings.
        seed: draws starts, hidden drive errors and every noise.

    Raises:
        NotConnected: no router answered.
        PlanningError: the robots do not fit into the arena.
    """
    async with open_bus(scenario.bus) as bus:
        room = Room(bus, scenario, seed)
        bus.announce("simulator", "simulator")
        ready("simulator")
        await room.run()


def main(arguments: list[str]) -> int:
    """``SCENARIO --seed N``: the exit code."""
    parser = argparse.ArgumentParser(prog="agents.simulator", description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args(arguments)
    return run_process(lambda: run_simulator(load_scenario(asked.scenario), asked.seed), "simulator")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
