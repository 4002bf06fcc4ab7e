"""The sole writer of ``cmd_vel``: calibration, limits, staleness and the stop latch between any law and the wheels."""

from __future__ import annotations

import asyncio
import math

from agents.tasks.localize import Localize
from muro_zenoh import channels
from muro_zenoh.config import RobotSettings
from muro_zenoh.geometry import STILL, Twist2
from muro_zenoh.messages import VelocityCommand
from muro_zenoh.safety.gate import reasons_to_stand
from muro_zenoh.safety.limits import calibrate_and_limit
from muro_zenoh.safety.stop import StopLatch
from muro_zenoh.transport import Bus

_REPEAT = 0.1
"""A command is repeated, or zeroed, when none went out for so long [s]; the base's dead-man bites at 0.3 s."""

_TWIST_LIMIT = 0.25
"""A twist that the behaviour asked for longer ago is not fresh [s]."""


class Drive:
    """What stands between what a behaviour wants and what the wheels are told.

    Args:
        bus: the bus.
        name: the robot's name.
        robot: its settings.
        localize: for the freshness of the pose and the calibrations.

    Attributes:
        latch: what is known of the stop order.
        stopped_names: the robots that the newest order stops.
        reasons: why the robot stands, most important first; empty while it may drive.
        commands: commands sent since the start.
        latencies: from the arrival of a pose fix to the command that used it, since last emptied [s].
        changed: set when the robot starts or stops to drive, or the latch changes; the health report clears it.
    """

    def __init__(self, bus: Bus, name: str, robot: RobotSettings, localize: Localize) -> None:
        self.latch = StopLatch()
        self.stopped_names: frozenset[str] = frozenset()
        self.reasons: tuple[str, ...] = ()
        self.commands = 0
        self.latencies: list[float] = []
        self.changed = asyncio.Event()
        self._name = name
        self._robot = robot
        self._localize = localize
        self._clock = bus.clock
        self._stop = bus.every(channels.STOP, depth=16)
        self._publisher = bus.publisher(channels.CMD_VEL, name)
        self._desired = STILL
        self._asked = -math.inf
        self._hold = "no behaviour yet"
        self._sent = -math.inf
        self._answered = math.nan

    def twist(self, desired: Twist2) -> None:
        """Drive with this twist of the body now; a behaviour calls it at each estimate.

        Args:
            desired: what the body shall do [m/s, rad/s].
        """
        self._desired, self._asked, self._hold = desired, self._clock.now(), ""
        self._command()

    def hold(self, reason: str) -> None:
        """Stand still.

        Args:
            reason: why; it goes out with the health.
        """
        self._desired, self._hold = STILL, reason
        self._command()

    async def run(self) -> None:
        """Listen for stop orders and repeat or zero; send zero when leaving, however that comes about."""
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._listen(), name="stop latch")
                tasks.create_task(self._repeat(), name="command repeat")
        finally:
            self._send(STILL, self._clock.now())

    async def _listen(self) -> None:
        async for order in self._stop:
            m = order.message
            before = self.latch
            self.latch = before.hear(self._name, everybody=m.all, names=m.names, revision=m.revision)
            if self.latch != before:
                self.changed.set()
            if m.revision >= self.latch.revision:
                self.stopped_names = frozenset(m.names)
            if not self.latch.may_drive:
                self._command()

    async def _repeat(self) -> None:
        while True:
            silent = self._clock.now() - self._sent
            if silent >= _REPEAT:
                self._command()
                silent = 0.0
            await asyncio.sleep(_REPEAT - silent)

    def _command(self) -> None:
        now = self._clock.now()
        localize = self._localize
        reasons = reasons_to_stand(
            latch=self.latch,
            fix_age=localize.fix_age(now),
            fix_limit=channels.POSE.stale_after or 0.0,
            twist_age=now - self._asked,
            twist_limit=_TWIST_LIMIT,
            hold=self._hold,
        )
        command = STILL
        if not reasons and localize.newest is not None:
            command = calibrate_and_limit(
                self._desired,
                cal_v=1.0 / localize.newest.s_v,
                cal_omega=1.0 / localize.newest.s_omega,
                v_max=self._robot.v_max,
                omega_max=self._robot.omega_max,
            )
        self._send(command, now)
        if (not reasons) != (not self.reasons):
            self.changed.set()
        self.reasons = reasons

    def _send(self, command: Twist2, now: float) -> None:
        self._publisher.put(VelocityCommand(stamp=now, v=command.v, omega=command.omega))
        self._sent = now
        self.commands += 1
        localize = self._localize
        localize.sent(now, command)
        if localize.arrival == localize.arrival and localize.arrival != self._answered:
            self._answered = localize.arrival
            self.latencies.append(self._clock.now() - localize.arrival)
