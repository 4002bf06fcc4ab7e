"""What may befall robots and cameras of a simulated room while it runs: a robot is carried off, a lens is covered."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from agents.base.simulated import Floor
from agents.simulated_camera import SimulatedCamera
from muro_zenoh.config import Fault, Scenario
from muro_zenoh.config.fault_rows import fault_of
from muro_zenoh.config.faults import CameraDropoutFault, CarryFault
from muro_zenoh.errors import OrderRefused
from muro_zenoh.messages import Break, Reply


class Mishaps:
    """Lets faults happen in a simulated room.

    Args:
        scenario: the settings.
        floor: the robots.
        cameras: the cameras of this process, by name.
    """

    def __init__(self, scenario: Scenario, floor: Floor, cameras: Mapping[str, SimulatedCamera]) -> None:
        self._scenario = scenario
        self._floor = floor
        self._cameras = cameras

    def befall(self, order: Break) -> Reply:
        """Let a fault happen.

        Args:
            order: which.

        Raises:
            ConfigError: no such fault.
            OrderRefused: one that cannot happen here.
        """
        fault = fault_of(order, self._scenario)
        if isinstance(fault, CarryFault):
            self._carry(fault)
        elif isinstance(fault, CameraDropoutFault) and not fault.robot:
            self._cover(fault)
        else:
            raise OrderRefused(f"{fault.kind} {fault.target}: expected a robot that is carried off, or a camera")
        return Reply(accepted=True)

    def _carry(self, fault: CarryFault) -> None:
        lasts = fault.end - fault.at
        row = self._scenario.robots.index(fault.robot)
        hand = self._floor.carry(row, (fault.x, fault.y, fault.theta), lasts)
        asyncio.get_running_loop().call_later(lasts, self._floor.set_down, row, hand)

    def _cover(self, fault: Fault) -> None:
        _, _, one = fault.target.partition("/")
        missing = [name for name in ([one] if one else self._scenario.camera) if name not in self._cameras]
        if missing:
            raise OrderRefused(f"camera {missing[0]} is a process of its own: let that crash or freeze")
        for camera in [self._cameras[one]] if one else self._cameras.values():
            camera.covered += 1
            if fault.duration is not None:
                asyncio.get_running_loop().call_later(fault.duration, _uncover, camera)


def _uncover(camera: SimulatedCamera) -> None:
    camera.covered -= 1
