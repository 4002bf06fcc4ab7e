"""The process that simulates the room: all robots' bases on one plant, and the overhead cameras."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Collection
from concurrent.futures import Executor

import numpy as np

from agents.base.run import run_bases
from agents.base.simulated import Floor, SimulatedWheels, make_plant
from agents.distant_floor import DistantFloor
from agents.mishaps import Mishaps
from agents.simulated_camera import Scene, SimulatedCamera
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import Scenario
from muro_zenoh.config.cameras import camera_model
from muro_zenoh.errors import ConfigError
from muro_zenoh.messages import Health, Truth
from muro_zenoh.runtime.process import ready, worker_threads
from muro_zenoh.runtime.waiting import WaitingLog
from muro_zenoh.transport import Bus, open_bus
from muro_zenoh.transport.measured_clock import StationClock

log = logging.getLogger(__name__)


class Room:
    """The room: robots, floor and cameras.

    Args:
        bus: the bus.
        scenario: the settings.
        seed: seed of starts, hidden drive errors and all noise.
        executor: renders the cameras' pictures; with one thread per camera none waits for another.
        cameras: the names of the cameras in this process; all of them by default.

    Raises:
        PlanningError: the robots do not fit into the arena.
        ConfigError: points that do not determine a camera, or a lens that no camera has.
    """

    def __init__(
        self, bus: Bus, scenario: Scenario, seed: int, executor: Executor, cameras: Collection[str] | None = None
    ) -> None:
        self.plant = make_plant(scenario, np.random.default_rng(seed))
        self.floor = Floor(self.plant, bus.clock, scenario.timeouts.command)
        self.cameras = {
            name: make_camera(bus, scenario, name, self.floor, seed, executor)
            for name in scenario.camera
            if cameras is None or name in cameras
        }
        self._bus = bus
        self._dead_man = scenario.timeouts.command
        self._limits = {name: robot.wheels for name, robot in scenario.robot.items()}
        self._wheels = {name: SimulatedWheels(self.floor, row, name) for row, name in enumerate(scenario.robot)}
        self._truth = [bus.publisher(channels.TRUTH, name) for name in scenario.robot]
        self._health = bus.publisher(channels.HEALTH, "simulator")
        self._clock = StationClock(bus, scenario.clocks)
        self._bases = bus.latest(channels.BASE, "*", own_only=True)
        self._mishaps = Mishaps(scenario, self.floor, self.cameras)
        bus.answer(channels.BEFALL, self._mishaps.befall)

    async def run(self) -> None:
        """Run bases, plant and cameras."""
        async with asyncio.TaskGroup() as tasks:
            bases = run_bases(self._bus, self._wheels, self._bus.clock, self._dead_man, self._limits)
            tasks.create_task(bases, name="bases")
            tasks.create_task(self._publish_truth(), name="truth")
            for name, camera in self.cameras.items():
                tasks.create_task(camera.run(), name=f"camera {name}")
            tasks.create_task(self._clock.run(), name="clock")
            tasks.create_task(self._report(), name="health")

    async def _publish_truth(self) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            due = max(due + channels.TRUTH.period, loop.time())
            await asyncio.sleep(due - loop.time())
            stamp = self.floor.catch_up()
            rows = zip(self._truth, self.plant.pose.tolist(), self.plant.twist.tolist(), strict=True)
            for publisher, (x, y, theta), (v, omega) in rows:
                publisher.put(Truth(stamp=stamp, x=x, y=y, theta=theta, v=v, omega=omega))

    async def _report(self) -> None:
        waiting = WaitingLog(log, "waiting", "every robot receives commands")
        while True:
            reasons = self._reasons()
            waiting.note(self._bus.clock.now(), reasons)
            state = "waiting" if reasons else "running"
            self._health.put(
                Health(
                    role="simulator",
                    state=state,
                    reasons=reasons,
                    complaints=self._clock.complaints(),
                    numbers=self._numbers(),
                )
            )
            await asyncio.sleep(channels.HEALTH.period)

    def _reasons(self) -> tuple[str, ...]:
        bases = self._bases.values()
        silent = [name for name in self._wheels if name not in bases or bases[name].message.dead_man]
        return (f"no commands for {' '.join(silent)}: waiting for their agents",) if silent else ()

    def _numbers(self) -> dict[str, float]:
        plant = self.plant
        numbers: dict[str, float] = {
            "collisions": float(plant.contacts),
            "wall_contacts": float(plant.wall_contacts),
            "lost_s": round(self.floor.lost, 3),
        }
        if math.isfinite(plant.min_separation):
            numbers["min_separation_m"] = plant.min_separation
        for row, name in enumerate(self._wheels):
            numbers[f"scale_v_{name}"] = float(plant.s_v[row])
            numbers[f"scale_omega_{name}"] = float(plant.s_omega[row])
        for name, camera in self.cameras.items():
            numbers[f"frames_captured_{name}"] = camera.captured
            numbers[f"frames_skipped_{name}"] = camera.skipped
            numbers[f"frames_lost_{name}"] = camera.lost
        return numbers | self._clock.numbers() | self._bus.numbers()


def make_camera(
    bus: Bus, scenario: Scenario, name: str, scene: Scene, seed: int, executor: Executor
) -> SimulatedCamera:
    """One of the scenario's cameras; its noise is the same whichever process it is in.

    Args:
        bus: the bus for its frames.
        scenario: the settings.
        name: the camera's name.
        scene: what it sees.
        seed: the simulator's.
        executor: renders its pictures.

    Raises:
        ConfigError: points that do not determine a camera, or a lens that no camera has.
    """
    index = list(scenario.camera).index(name)
    frames = bus.publisher(channels.CAMERA, name)
    settings = scenario.camera[name]
    model = camera_model(name, settings, scenario.arena)
    return SimulatedCamera(frames, settings, model, scenario, scene, seed + index, executor)


async def run_simulator(scenario: Scenario, seed: int, *, cameras: bool = True) -> None:
    """The simulator process.

    Args:
        scenario: the settings.
        seed: seed of starts, hidden drive errors and all noise.
        cameras: whether it simulates the cameras too; otherwise each of them is a process of its own.

    Raises:
        NotConnected: no router answered.
        PlanningError: the robots do not fit into the arena.
    """
    async with open_bus(scenario.bus, Role.SIMULATOR, Role.BASE, Role.CAMERA) as bus:
        with worker_threads(len(scenario.camera), "camera") as threads:
            room = Room(bus, scenario, seed, threads, None if cameras else ())
            bus.announce(Role.SIMULATOR, "simulator")
            ready("simulator")
            await room.run()


async def film(bus: Bus, scenario: Scenario, name: str, seed: int, executor: Executor) -> None:
    """Film what a simulator in another process says, and report the camera's health.

    Args:
        bus: the bus.
        scenario: the settings.
        name: the camera's name.
        seed: the simulator's.
        executor: renders its pictures.
    """
    floor = DistantFloor(bus, scenario.robots)
    camera = make_camera(bus, scenario, name, floor, seed, executor)
    health, clock = bus.publisher(channels.HEALTH, name), StationClock(bus, scenario.clocks)
    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(camera.run(), name=f"camera {name}")
        tasks.create_task(clock.run(), name="clock")
        while True:
            reasons = () if floor.look() is not None else ("nothing to be seen: no truth of every robot arrives",)
            state = "waiting" if reasons else "filming"
            numbers = {"frames": float(camera.captured), **clock.numbers(), **bus.numbers()}
            health.put(
                Health(role=Role.CAMERA, state=state, reasons=reasons, complaints=clock.complaints(), numbers=numbers)
            )
            await asyncio.sleep(channels.HEALTH.period)


async def run_camera(scenario: Scenario, name: str, seed: int) -> None:
    """The process of one simulated camera, beside a simulator without cameras.

    Args:
        scenario: the settings.
        name: the camera's name.
        seed: the simulator's.

    Raises:
        NotConnected: no router answered.
        ConfigError: the settings have no such camera.
    """
    if name not in scenario.camera:
        raise ConfigError(f"camera {name}", got=repr(name), expected=f"one of {', '.join(scenario.camera) or 'none'}")
    async with open_bus(scenario.bus, Role.CAMERA) as bus:
        with worker_threads(1, "camera") as threads:
            bus.announce(Role.CAMERA, name)
            ready("camera", name)
            await film(bus, scenario, name, seed, threads)
