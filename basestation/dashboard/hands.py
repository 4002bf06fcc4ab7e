"""Hands on sticks: passes on how pages drive robots, and zero as soon as nothing comes any more."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

from muro_zenoh import channels
from muro_zenoh.errors import OrderRefused
from muro_zenoh.messages import DriveWish
from muro_zenoh.transport import Bus, Publisher

LASTS: Final = 0.2
"""A wish that is not renewed within this time is over [s]."""

_PERIOD: Final = 0.05
"""A wish is repeated so often, because a robot may lose one [s]."""

_COMPLAINT_PERIOD: Final = 1.0


@dataclass(slots=True)
class _Hand:
    """One client's hand on one robot: what it wants, by when it must have said so again, and what repeats it."""

    client: int
    v: float
    omega: float
    until: float
    timer: asyncio.TimerHandle | None = None


class Hands:
    """Drives robots for clients, one client a robot.

    Args:
        bus: the bus, as an operator.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._loop = asyncio.get_running_loop()
        self._publishers: dict[str, Publisher[DriveWish]] = {}
        self._hands: dict[str, _Hand] = {}
        self._complained: dict[int, float] = {}

    def drive(self, client: int, name: str, v: float, omega: float) -> None:
        """Drive a robot for a moment.

        Args:
            client: who drives.
            name: which robot.
            v: forwards [m/s].
            omega: counter-clockwise [rad/s].

        Raises:
            OrderRefused: another client drives it.
            ValueError: not finite numbers.
        """
        DriveWish(v=v, omega=omega)
        hand = self._hands.get(name)
        if hand is not None and hand.client != client:
            raise OrderRefused(f"{name} is driven from another page")
        if (v, omega) == (0.0, 0.0):
            self._let_go(name)
            return
        if hand is None:
            hand = self._hands[name] = _Hand(client, v, omega, 0.0)
        elif hand.timer is not None:
            hand.timer.cancel()
        hand.v, hand.omega, hand.until = v, omega, self._loop.time() + LASTS
        self._repeat(name, hand)

    def leave(self, client: int) -> None:
        """Let go of all that a client drives.

        Args:
            client: who is gone.
        """
        self._complained.pop(client, None)
        for name in [name for name, hand in self._hands.items() if hand.client == client]:
            self._let_go(name)

    def release(self, names: Collection[str]) -> None:
        """Let go of robots, whoever drives them.

        Args:
            names: which; none for all.
        """
        for name in [name for name in self._hands if not names or name in names]:
            self._let_go(name)

    def may_complain(self, client: int) -> bool:
        """Whether a client may be told now that it does not drive: once a second.

        Args:
            client: who.
        """
        now = self._loop.time()
        if now - self._complained.get(client, -math.inf) < _COMPLAINT_PERIOD:
            return False
        self._complained[client] = now
        return True

    def _repeat(self, name: str, hand: _Hand) -> None:
        left = hand.until - self._loop.time()
        if left <= 0.0:
            self._let_go(name)
            return
        self._put(name, hand.v, hand.omega)
        hand.timer = self._loop.call_later(min(_PERIOD, left), self._repeat, name, hand)

    def _let_go(self, name: str) -> None:
        hand = self._hands.pop(name, None)
        if hand is not None:
            if hand.timer is not None:
                hand.timer.cancel()
            self._put(name, 0.0, 0.0)

    def _put(self, name: str, v: float, omega: float) -> None:
        publisher = self._publishers.get(name)
        if publisher is None:
            publisher = self._publishers[name] = self._bus.publisher(channels.DRIVE, name)
        publisher.put(DriveWish(v=v, omega=omega))
