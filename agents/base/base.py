"""The base's rules: which commands reach the wheels, when the dead-man stops them, and what is reported.

Nothing here waits or sends: :mod:`agents.base.run` passes the commands and the time, and sends the reports.
"""

from __future__ import annotations

import logging
import math

from agents.base.obedience import Obedience
from agents.base.wheels import Wheels
from muro_zenoh import channels
from muro_zenoh.config import TIMEOUTS
from muro_zenoh.estimation.wheel_model import WheelLimits
from muro_zenoh.messages import BaseState, Odometry, VelocityCommand
from muro_zenoh.transport import Received

log = logging.getLogger(__name__)

DEAD_MAN = TIMEOUTS.command
"""Maximum age of a command that the wheels follow, unless the settings have another [s]."""


class Base:
    """One robot's base: it follows fresh commands and stops the wheels when there is none.

    Args:
        name: the robot's name, for the log.
        wheels: the wheels that it drives.
        dead_man: maximum age of a command that the wheels follow [s].
        limits: of the wheels, to notice that somebody else turns them; None where they are not known.

    Attributes:
        overtaken: how many commands were ignored because a later one of their writer had come before them.
    """

    def __init__(
        self, name: str, wheels: Wheels, dead_man: float = DEAD_MAN, limits: WheelLimits | None = None
    ) -> None:
        self._name = name
        self._obedience = Obedience(limits) if limits is not None else None
        self._dead_man = dead_man
        self._wheels = wheels
        self._reading = wheels.read()
        self.overtaken = 0
        self._writer = 0
        self._seq = 0
        self._unsigned = False
        self._contested = -math.inf
        self._expires = -math.inf
        self._now = -math.inf
        self._dead = True
        self._reported: tuple[float, ...] = ()
        self._reported_at = -math.inf

    def obey(self, received: Received[VelocityCommand], now: float) -> None:
        """Take a command.

        Args:
            received: the received command.
            now: the time, for its age [s].
        """
        self._note_time(now)
        age = received.age(now)
        if not age <= self._dead_man:  # written so that a NaN is refused too
            return  # stale: part of a backlog
        command = received.message
        if not command.epoch:
            self._refuse_unsigned()
            return
        if command.epoch != self._writer:
            self._change_writer(command.epoch, now)
        elif 0 < command.seq <= self._seq and now <= self._expires:
            # Later than a stop, it would set the wheels turning again. Once the later command has expired, so has any
            # before it; `seq` then counts anew, or one wrong number would lock its writer out.
            self._ignore_overtaken(command.seq)
            return
        self._seq = command.seq
        self._expires = now - age + self._dead_man
        if now <= self._contested or self._wheels.read().hazard:
            self.stop()
            return
        if self._dead:
            self._dead = False
            log.info("%s: receiving commands", self._name)
        self._turn(command.v, command.omega)

    def _note_time(self, now: float) -> None:
        """When the clock was set back, nobody knows how old the last command is: it has expired."""
        if now < self._now:
            self._expires = self._contested = -math.inf
        self._now = now

    def _turn(self, v: float, omega: float) -> None:
        self._wheels.command(v, omega)
        if self._obedience is not None:
            self._obedience.command(v, omega, self._now)

    def _refuse_unsigned(self) -> None:
        """Two processes that both omit their epoch could not be distinguished, and would drive in turns."""
        if not self._unsigned:
            self._unsigned = True
            log.warning(
                "%s: got a command without `epoch`, expected a random number drawn at its writer's start: ignored "
                "(logged once)",
                self._name,
            )

    def _ignore_overtaken(self, seq: int) -> None:
        if not self.overtaken:
            log.warning(
                "%s: got command %d after command %d of the same writer, expected them in order: ignored (logged once)",
                self._name,
                seq,
                self._seq,
            )
        self.overtaken += 1

    def _change_writer(self, epoch: int, now: float) -> None:
        """Two processes that command at once (an agent started twice, a foreign program) would drive in turns, and a
        stop received by only one of them would have no effect: neither is followed while commands of both are fresh."""
        if now <= self._expires:
            if now > self._contested:
                log.warning(
                    "%s: two processes command these wheels, so they are stopped: is an agent running twice?",
                    self._name,
                )
            self._contested = self._expires
        self._writer = epoch

    def beat(self, now: float) -> None:
        """Read the wheels, and stop them at a hazard or without a fresh command; call it at 50 Hz.

        Args:
            now: the time [s].
        """
        self._reading = self._wheels.read()
        self._note_time(now)
        if self._obedience is not None:
            self._obedience.read(self._reading.v, self._reading.omega, now)
        # Written so that an invalid time stops the wheels too.
        if not now <= self._expires and not self._dead:
            self._dead = True
            log.warning("%s: no fresh command for %g s, wheels at zero", self._name, self._dead_man)
        if self._dead or self._reading.hazard:
            self.stop()

    def stop(self) -> None:
        """Set the wheels to zero."""
        self._turn(0.0, 0.0)

    def odometry(self, now: float) -> Odometry:
        """What the wheels reported at the last beat.

        Args:
            now: the time of that beat [s].
        """
        x, y, theta, v, omega = self._reading[:5]
        return Odometry(stamp=now, x=x, y=y, theta=theta, v=v, omega=omega)

    def state(self, now: float) -> BaseState | None:
        """The base's state when it is due: on change, and twice a second; otherwise None.

        Args:
            now: the time of the last beat [s].
        """
        reading = self._reading
        contested = now <= self._contested
        unruly = self._obedience is not None and self._obedience.unruly
        shown = (*reading[5:], self._dead, contested, unruly)
        if shown == self._reported and now - self._reported_at < channels.BASE.period:
            return None
        self._reported, self._reported_at = shown, now
        return BaseState(
            battery=reading.battery,
            charging=reading.charging,
            bumper=reading.bumper,
            cliff=reading.cliff,
            wheel_drop=reading.wheel_drop,
            dead_man=self._dead,
            contested=contested,
            unruly=unruly,
        )
