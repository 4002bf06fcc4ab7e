"""What comes of a stop, per robot: from its agent's health and its wheels' odometry, never from the truth."""

from __future__ import annotations

import math
from enum import Enum
from typing import Final, NamedTuple

from muro_zenoh.messages import Health, Odometry
from muro_zenoh.transport import Received

_REST_SPEED: Final = 0.005
_REST_TURNING: Final = 0.02
"""Wheels are at zero below these [m/s, rad/s]: what encoders of a robot at rest may report."""

_SILENT: Final = 0.5
"""Odometry that is older than this says nothing about the wheels now [s]; it comes 25 times a second."""


class StopStatus(Enum):
    """What is known of a robot that was ordered to stop."""

    STOPPED = "stopped"
    MOVING = "moving"
    NO_ODOMETRY = "no odometry"
    UNCONFIRMED = "unconfirmed"
    NOT_ALIVE = "not alive"
    UNKNOWN = "unknown"


class StopReceipt(NamedTuple):
    """What came of a stop at one robot; None is unknown.

    Attributes:
        status: whether it stands still for certain.
        latched: when its agent latched the stop, after the order [s].
        at_rest: when its wheels came to rest, after the order [s].
        travelled: how far it went since the order, by its wheels [m].
        silent: how long its agent, or its wheels when only they are missing, have been silent [s]; where nothing was
            heard of them at all, the time since the order.
    """

    status: StopStatus
    latched: float | None
    at_rest: float | None
    travelled: float | None
    silent: float | None


class RobotWatch:
    """Watches one robot come to rest.

    Args:
        ordered: when the stop was sent [s].
    """

    def __init__(self, ordered: float) -> None:
        self._ordered = ordered
        self._health: Received[Health] | None = None
        self._odometry: Received[Odometry] | None = None
        self._latched: float | None = None
        self._at_rest: float | None = None
        self._travelled = 0.0

    def take_health(self, health: Received[Health]) -> None:
        """Take what its agent reports.

        Args:
            health: the message.
        """
        self._health = health
        if not health.message.stop_latched:
            self._latched = None
        elif self._latched is None:
            self._latched = self._after(health.arrival)

    def take_odometry(self, odometry: Received[Odometry]) -> None:
        """Take what its wheels report, in order.

        Args:
            odometry: the message.
        """
        now, before = odometry.message, self._odometry.message if self._odometry is not None else None
        if before is None:
            self._travelled = abs(now.v) * self._after(odometry.arrival)
        elif now.epoch == before.epoch:  # another base begins at another place
            self._travelled += math.hypot(now.x - before.x, now.y - before.y)
        self._odometry = odometry
        # Written so that a NaN is no rest.
        if not (abs(now.v) <= _REST_SPEED and abs(now.omega) <= _REST_TURNING):
            self._at_rest = None
        elif self._at_rest is None:
            self._at_rest = self._after(odometry.arrival)

    def receipt(self, now: float, *, alive: bool, known: bool = True) -> StopReceipt:
        """What is known now.

        Args:
            now: the time [s].
            alive: whether its agent is.
            known: whether there is a robot of that name: its agent is or was alive, or the cameras have seen it.
        """
        silent: float | None = self._health.age(now) if self._health is not None else now - self._ordered
        wheels = self._odometry.age(now) if self._odometry is not None else None
        if not alive:
            status = StopStatus.NOT_ALIVE if known else StopStatus.UNKNOWN
        elif self._latched is None:
            status = StopStatus.UNCONFIRMED
        elif wheels is None or not wheels <= _SILENT:
            status, silent = StopStatus.NO_ODOMETRY, now - self._ordered if wheels is None else wheels
        elif self._at_rest is None:
            status = StopStatus.MOVING
        else:
            status, silent = StopStatus.STOPPED, None
        known = wheels is not None
        return StopReceipt(status, self._latched, self._at_rest, self._travelled if known else None, silent)

    def _after(self, arrival: float) -> float:
        return max(0.0, arrival - self._ordered)
