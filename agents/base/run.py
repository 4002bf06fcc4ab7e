"""Bases on the bus: commands in, odometry and state out. One process may run any number of them in one loop.

On a real robot the base is a process of its own, so that a killed, frozen or cut-off agent cannot keep the wheels
turning.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping
from contextlib import ExitStack
from types import MappingProxyType

from agents.base.base import DEAD_MAN, Base
from agents.base.table import check_base, find
from agents.base.wheels import Wheels
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import Scenario
from muro_zenoh.errors import ConfigError
from muro_zenoh.estimation.wheel_model import WheelLimits
from muro_zenoh.runtime.clock import Clock
from muro_zenoh.runtime.process import ready
from muro_zenoh.runtime.waiting import WaitingLog
from muro_zenoh.transport import Bus, open_bus, with_local_link
from muro_zenoh.transport.measured_clock import StationClock, answer_time

log = logging.getLogger(__name__)

_BEAT = 0.02
"""The dead-man is checked this often [s]."""

_BEATS_TO_ODOMETRY = round(channels.ODOMETRY.period / _BEAT)


class _Bases:
    """The bases of one process, on one timer and one mailbox: with a timer and a task for each robot a simulator of
    thirty would have 1,500 wake-ups a second."""

    def __init__(
        self,
        bus: Bus,
        wheels: Mapping[str, Wheels],
        clock: Clock,
        dead_man: float,
        limits: Mapping[str, WheelLimits],
    ) -> None:
        self._clock = clock
        self._bases = {name: Base(name, driven, dead_man, limits.get(name)) for name, driven in wheels.items()}
        only = next(iter(wheels)) if len(wheels) == 1 else "*"
        self._commands = bus.latest(channels.CMD_VEL, only)
        self._odometry = {name: bus.publisher(channels.ODOMETRY, name) for name in wheels}
        self._states = {name: bus.publisher(channels.BASE, name) for name in wheels}
        self._times = [answer_time(bus, channels.BASE_TIME, name) for name in wheels]

    async def run(self) -> None:
        """Follow each command when it arrives, beat at 50 Hz; set all wheels to zero at the end."""
        loop = asyncio.get_running_loop()
        due, beats = loop.time(), 0
        with ExitStack() as leaving:
            for base in self._bases.values():
                leaving.callback(base.stop)  # all of them, even when the wheels of one fail
            for time in self._times:
                leaving.callback(time.close)
            while True:
                due = max(due + _BEAT, loop.time())
                await self._obey_until(due)
                self._beat(with_odometry=beats % _BEATS_TO_ODOMETRY == 0)
                beats += 1

    async def _obey_until(self, due: float) -> None:
        """Follow commands as they arrive until loop time ``due``, even when they arrive without pause."""
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout_at(due) as waiting:
                while True:
                    received = await self._commands.next()
                    base = self._bases.get(received.name)
                    if base is not None:
                        base.obey(received, self._clock.now())
                    if loop.time() >= due:
                        await asyncio.sleep(0)  # let the timeout fire in a flood of commands
        except TimeoutError:
            if not waiting.expired():  # raised by the wheels: a serial line that does not answer
                raise

    def _beat(self, with_odometry: bool) -> None:
        now = self._clock.now()
        for name, base in self._bases.items():
            base.beat(now)
            if with_odometry:
                self._odometry[name].put(base.odometry(now))
            state = base.state(now)
            if state is not None:
                self._states[name].put(state)


async def run_bases(
    bus: Bus,
    wheels: Mapping[str, Wheels],
    clock: Clock,
    dead_man: float = DEAD_MAN,
    limits: Mapping[str, WheelLimits] = MappingProxyType({}),
) -> None:
    """Run the bases of several robots until cancelled.

    Args:
        bus: the bus.
        wheels: the wheels, by the robot's name.
        clock: for ages.
        dead_man: maximum age of a command that the wheels follow [s].
        limits: of the wheels, by the robot's name, to notice that somebody else turns them.
    """
    await _Bases(bus, wheels, clock, dead_man, limits).run()


async def run_base(
    bus: Bus,
    name: str,
    wheels: Wheels,
    clock: Clock,
    dead_man: float = DEAD_MAN,
    limits: WheelLimits | None = None,
) -> None:
    """Run one robot's base until cancelled.

    Args:
        bus: the bus.
        name: the robot's name.
        wheels: the robot's wheels.
        clock: for ages.
        dead_man: maximum age of a command that the wheels follow [s].
        limits: of the wheels, to notice that somebody else turns them; None where they are not known.
    """
    await run_bases(bus, {name: wheels}, clock, dead_man, {name: limits} if limits is not None else {})


async def run_base_process(scenario: Scenario, name: str) -> None:
    """The base process: the wheels that the fleet file names for this robot, and their dead-man.

    Args:
        scenario: the settings.
        name: the robot's name.

    Raises:
        NotConnected: no router answered, and the robot has no link to its agent.
        TransportError: the endpoint of that link is taken.
        ConfigError: the settings have no such robot, or name unknown wheels.
    """
    if name not in scenario.robot:
        raise ConfigError(f"base {name}", got=repr(name), expected=f"one of {', '.join(scenario.robot)}")
    check_base(scenario, name, scenario.name)
    robot = scenario.robot[name]
    make_wheels = find(robot.base)
    async with open_bus(with_local_link(scenario.bus, robot.base_link, "base"), Role.BASE) as bus:
        wheels = make_wheels(robot, bus.clock)
        bus.announce(Role.BASE, name)
        ready("base", name)
        station = StationClock(bus, scenario.clocks)
        async with asyncio.TaskGroup() as tasks:
            base = run_base(bus, name, wheels, bus.clock, scenario.timeouts.command, robot.wheels)
            tasks.create_task(base, name="base")
            tasks.create_task(station.run(), name="clock")
            tasks.create_task(_log_complaints(station, bus.clock), name="log")


async def _log_complaints(station: StationClock, clock: Clock) -> None:
    """A base has no health message: its agent has."""
    complaining = WaitingLog(log, "clock", "the clocks agree again")
    while True:
        complaining.note(clock.now(), station.complaints())
        await asyncio.sleep(channels.HEALTH.period)
