"""The agent of one robot: opens the bus, and runs the tasks around one control loop."""

from __future__ import annotations

import asyncio
import logging

from agents.control_loop import ControlLoop
from agents.master import Master
from agents.tasks.behaviour import BehaviourRunner
from agents.tasks.control import Listener, Sender, Signals, control
from agents.tasks.health import report_health
from agents.tasks.orders import answer_goals, obey_stops
from muro_zenoh import channels
from muro_zenoh.behaviours.interface import Need
from muro_zenoh.channels import Role
from muro_zenoh.config import RobotSettings, Scenario
from muro_zenoh.errors import ConfigError
from muro_zenoh.runtime.process import ready
from muro_zenoh.transport import Bus, open_bus, with_local_link
from muro_zenoh.transport.measured_clock import MeasuredClock, StationClock

log = logging.getLogger(__name__)


class Agent:
    """The tasks of one robot, wired together.

    Args:
        bus: the bus.
        scenario: the settings.
        name: the robot's name.

    Raises:
        ConfigError: the settings have no such robot.
    """

    def __init__(self, bus: Bus, scenario: Scenario, name: str) -> None:
        settings = _robot(scenario, name)
        self._bus = bus
        self._name = name
        separation = scenario.separation_of(name)
        if separation is None:
            log.warning("%s: separation.enabled is false, so this robot drives into others and walls", name)
        self._loop = ControlLoop(name, settings, scenario.timeouts, separation)
        self._master = Master(bus, name)
        self._clock = StationClock(bus, scenario.clocks)
        self._base_clock = MeasuredClock(bus, channels.BASE_TIME, name)
        self._sender = Sender(bus, name)
        self._listener = Listener(
            bus,
            name,
            self._master,
            scenario.timeouts,
            frozenset({Need.SNAPSHOT}) if separation is not None else frozenset(),
        )
        self._runner = BehaviourRunner(bus, scenario.vehicle(name), settings, self._loop, self._listener, self._sender)

    async def run(self) -> None:
        """Run all tasks; when one crashes, all are cancelled and the agent exits."""
        bus, name, loop, sender = self._bus, self._name, self._loop, self._sender
        signals, clock = Signals(), self._clock
        answer_goals(bus, name, loop, self._runner, self._master, signals)
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(control(bus, name, loop, self._listener, sender, signals), name="control")
            tasks.create_task(obey_stops(bus, loop, sender, signals), name="stop")
            tasks.create_task(self._runner.run(), name="behaviour")
            tasks.create_task(
                report_health(bus, name, loop, self._runner, clock, self._listener, signals), name="health"
            )
            tasks.create_task(clock.run(), name="clock")
            tasks.create_task(self._base_clock.run(), name="base clock")


def _robot(scenario: Scenario, name: str) -> RobotSettings:
    if name not in scenario.robot:
        raise ConfigError(f"agent {name}", got=repr(name), expected=f"one of {', '.join(scenario.robot)}")
    return scenario.robot[name]


async def run_agent(scenario: Scenario, name: str) -> None:
    """The agent process.

    Args:
        scenario: the settings.
        name: the robot's name.

    Raises:
        NotConnected: no router answered, and the robot has no link to its base.
        ConfigError: the settings have no such robot.
    """
    robot = _robot(scenario, name)
    async with open_bus(with_local_link(scenario.bus, robot.base_link, "agent"), Role.AGENT) as bus:
        agent = Agent(bus, scenario, name)
        bus.announce(Role.AGENT, name)
        ready("agent", name)
        await agent.run()
