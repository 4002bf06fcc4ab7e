"""The agent of one robot: opens the bus and runs its tasks.

``python -P -m agents.agent SCENARIO NAME``
"""

from __future__ import annotations

import asyncio
import contextlib
import sys

from agents.robot import Robot
from agents.tasks.behave import Behave
from agents.tasks.drive import Drive
from agents.tasks.localize import Localize
from muro_zenoh import channels
from muro_zenoh.config import Scenario, load_scenario
from muro_zenoh.errors import ConfigError
from muro_zenoh.messages import Health
from muro_zenoh.runtime.process import ready, run_process
from muro_zenoh.transport import Bus, open_bus

_HEALTH_PERIOD = 1.0


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
        if name not in scenario.robot:
            raise ConfigError(f"agent {name}", got=repr(name), expected=f"one of {', '.join(scenario.robot)}")
        settings = scenario.robot[name]
        self._bus = bus
        self._localize = Localize(bus, name, settings, {n: c.latency for n, c in scenario.camera.items()})
        self._drive = Drive(bus, name, settings, self._localize)
        robot = Robot(bus, name, scenario, self._localize, self._drive)
        self._behave = Behave(robot, bus.latest(channels.BEHAVIOUR, name))
        self._health = bus.publisher(channels.HEALTH, name)

    async def run(self) -> None:
        """Run every task; one that crashes takes the others, and the agent, down."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._drive.run(), name="drive")
            tasks.create_task(self._localize.run(), name="localize")
            tasks.create_task(self._behave.run(), name="behave")
            tasks.create_task(self._report(), name="health")

    async def _report(self) -> None:
        """Health once a second, and at once when the robot starts or stops to drive."""
        drive, localize = self._drive, self._localize
        commands, since = 0, self._bus.clock.now()
        rate = 0.0
        while True:
            now = self._bus.clock.now()
            if now - since > 0.5 * _HEALTH_PERIOD:
                rate = (drive.commands - commands) / (now - since)
                commands, since = drive.commands, now
            ages, localize.pose_ages = localize.pose_ages, []
            latencies, drive.latencies = drive.latencies, []
            self._health.put(
                Health(
                    role="agent",
                    state=self._state(),
                    reasons=drive.reasons,
                    numbers={
                        "fixes": localize.fixes,
                        "commands": drive.commands,
                        "command_rate_hz": round(rate, 1),
                        **self._bus.numbers(),
                    },
                    samples={"pose_age_s": tuple(ages), "pose_to_command_s": tuple(latencies)},
                    stop_latched=drive.latch.stopped,
                    stop_all=drive.latch.everybody,
                    stop_revision=max(drive.latch.revision, 0),
                )
            )
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_HEALTH_PERIOD):
                    await drive.changed.wait()
            drive.changed.clear()

    def _state(self) -> str:
        if self._drive.latch.stopped:
            return "stopped"
        if self._drive.reasons:
            return "holding"
        return self._behave.name.rpartition(":")[2] or "driving"


async def run_agent(scenario: Scenario, name: str) -> None:
    """The agent process.

    Args:
        scenario: the settings.
        name: the robot's name.

    Raises:
        NotConnected: no router answered.
        ConfigError: the settings have no such robot.
    """
    async with open_bus(scenario.bus, channels.Role.AGENT) as bus:
        agent = Agent(bus, scenario, name)
        bus.announce(channels.Role.AGENT, name)
        ready("agent", name)
        await agent.run()


def main(arguments: list[str]) -> int:
    """``SCENARIO NAME``: the exit code."""
    path, name = arguments
    return run_process(lambda: run_agent(load_scenario(path), name), name)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
