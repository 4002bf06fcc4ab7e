"""The base of one robot as a process of its own."""

from __future__ import annotations

import numpy as np

from agents.base.base import run_base
from agents.base.simulated import Floor, SimulatedWheels
from muro_zenoh.channels import Role
from muro_zenoh.config import Scenario
from muro_zenoh.errors import ConfigError
from muro_zenoh.runtime.process import ready
from muro_zenoh.simulation.plant import Plant
from muro_zenoh.transport import open_bus


async def run_base_process(scenario: Scenario, name: str) -> None:
    """The base process: the wheels that the fleet file names for this robot, and their dead-man.

    The only wheels of this version are simulated: a nominal robot on a floor of its own, which no camera sees. They
    serve to try a link and the dead-man; a whole room of them is what ``muro sim`` runs.

    Args:
        scenario: the settings.
        name: the robot's name.

    Raises:
        NotConnected: no router answered.
        ConfigError: the settings have no such robot.
    """
    if name not in scenario.robot:
        raise ConfigError(f"base {name}", got=repr(name), expected=f"one of {', '.join(scenario.robot)}")
    robot = scenario.robot[name]
    plant = Plant(np.zeros((1, 3)), np.random.default_rng(0), limits=robot.wheels, drive_error=0.0, slip=0.0)
    async with open_bus(scenario.bus, Role.BASE) as bus:
        bus.announce(Role.BASE, name)
        ready("base", name)
        await run_base(bus, name, SimulatedWheels(Floor(plant, bus.clock), 0), bus.clock)
