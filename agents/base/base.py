"""The base: commands in, wheels and odometry out, and the dead-man between them.

It is a process of its own on a real robot, so that a killed, frozen or cut-off agent cannot keep the wheels turning.
"""

from __future__ import annotations

import asyncio
import logging
import math

from agents.base.wheels import WheelReading, Wheels
from muro_zenoh import channels
from muro_zenoh.messages import BaseState, Odometry, VelocityCommand
from muro_zenoh.runtime.clock import Clock
from muro_zenoh.transport import Bus, Received

log = logging.getLogger(__name__)

DEAD_MAN = channels.CMD_VEL.stale_after or 0.0
"""A command older than this counts for nothing [s]."""

_ODOMETRY_PERIOD = 0.02
_STATE_PERIOD = 0.5


class Base:
    """One robot's base.

    Args:
        bus: the bus.
        name: the robot's name.
        wheels: what turns.
        clock: for ages.
    """

    def __init__(self, bus: Bus, name: str, wheels: Wheels, clock: Clock) -> None:
        self._name = name
        self._wheels = wheels
        self._clock = clock
        self._commands = bus.latest(channels.CMD_VEL, name)
        self._odometry = bus.publisher(channels.ODOMETRY, name)
        self._state = bus.publisher(channels.BASE, name)
        self._writer = 0
        self._contested = -math.inf
        self._expires = -math.inf
        self._dead = True
        self._said: BaseState | None = None
        self._said_at = -math.inf

    async def run(self) -> None:
        """Obey fresh commands, zero the wheels when there is none, report; zero them when leaving."""
        loop = asyncio.get_running_loop()
        tick = loop.time()
        try:
            while True:
                tick = max(tick + _ODOMETRY_PERIOD, loop.time())
                await self._until(tick)
                self._beat()
        finally:
            self._wheels.command(0.0, 0.0)

    async def _until(self, tick: float) -> None:
        """Obey commands as they come, until ``tick`` of the loop's time."""
        try:
            async with asyncio.timeout_at(tick):
                while True:
                    self._obey(await self._commands.next())
        except TimeoutError:
            return

    def _obey(self, received: Received[VelocityCommand]) -> None:
        age = received.age(self._clock.now())
        if age > DEAD_MAN:
            return  # a backlog is no command
        now, command = self._clock.now(), received.message
        if command.epoch != self._writer:
            self._change_writer(command.epoch, now)
        self._expires = now - age + DEAD_MAN
        if now < self._contested:
            self._stop()
            return
        reading = self._wheels.read()
        if reading.hazard:
            self._stop()
            return
        if self._dead:
            self._dead = False
            log.info("%s: commands arrive", self._name)
        self._wheels.command(command.v, command.omega)

    def _change_writer(self, epoch: int, now: float) -> None:
        """Two that command at once (an agent started twice, a stranger) would drive by turns, and a stop that only one
        has heard would not hold: while the other's last command is fresh, neither is obeyed."""
        if now <= self._expires:
            if now >= self._contested:
                log.warning(
                    "%s: two processes command these wheels, which stand: is an agent running twice?", self._name
                )
            self._contested = self._expires
        self._writer = epoch

    def _beat(self) -> None:
        reading = self._wheels.read()
        now = self._clock.now()
        # Written so that a clock that makes no sense stops the wheels too.
        if not now <= self._expires and not self._dead:
            self._dead = True
            log.warning("%s: no fresh command for %g s, wheels at zero", self._name, DEAD_MAN)
        if self._dead or reading.hazard:
            self._stop()
        self._odometry.put(
            Odometry(stamp=now, x=reading.x, y=reading.y, theta=reading.theta, v=reading.v, omega=reading.omega)
        )
        self._say(reading, now)

    def _stop(self) -> None:
        self._wheels.command(0.0, 0.0)

    def _say(self, reading: WheelReading, now: float) -> None:
        state = BaseState(
            battery=reading.battery,
            charging=reading.charging,
            bumper=reading.bumper,
            cliff=reading.cliff,
            wheel_drop=reading.wheel_drop,
            dead_man=self._dead,
        )
        if state != self._said or now - self._said_at >= _STATE_PERIOD:
            self._said, self._said_at = state, now
            self._state.put(state)


async def run_base(bus: Bus, name: str, wheels: Wheels, clock: Clock) -> None:
    """Run one robot's base until cancelled.

    Args:
        bus: the bus.
        name: the robot's name.
        wheels: what turns.
        clock: for ages.
    """
    await Base(bus, name, wheels, clock).run()
