"""The leases of the lab: one master per robot, and none where nobody asks for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import msgspec

from muro_zenoh.errors import OrderRefused
from muro_zenoh.messages import Lease, LeaseState, Message, TakeLease

PERIOD: Final = 3.0
"""A lease that was not renewed for this time has ended [s]; its holder renews it each second."""

_MOST: Final = 64
"""Leases at once: a program that asks for ever new robots must not fill the memory."""


class Leases:
    """Who may order which robots. Two leases never cover the same robot.

    Args:
        kept: the leases that were in force when the last base station ended. Each has as long as any other to be
            renewed, so that a restart neither gives a robot away nor keeps it for a holder that is gone.
        now: the time [s].
        keep: called with the leases when another is granted or one has ended.
    """

    def __init__(self, kept: Sequence[Lease], now: float, keep: Callable[[tuple[Lease, ...]], None]) -> None:
        self._expires = {lease.epoch: now + PERIOD for lease in kept}
        self._leases = {lease.epoch: lease for lease in kept}
        self._keep = keep

    def take(self, order: TakeLease, robots: Sequence[str], now: float) -> None:
        """Grant, renew or end a lease.

        Args:
            order: the order.
            robots: the names of the robots that there are.
            now: the time [s].

        Raises:
            OrderRefused: another process holds one of these robots, or there is no such robot.
        """
        if not order.epoch:
            raise OrderRefused("lease: got no `epoch`, expected a random number drawn at its holder's start")
        self._end_old(now)
        mine = self._leases.get(order.epoch)
        if order.release:
            self._end([order.epoch] if mine is not None else [])
            return
        if unknown := [name for name in order.names if name not in robots]:
            raise OrderRefused(f"robot {', '.join(unknown)}: expected names out of {', '.join(robots)}")
        for other in self._leases.values():
            if other is not mine and other.covers(order.names):
                raise OrderRefused(str(other))
        if mine is None and len(self._leases) >= _MOST:
            raise OrderRefused(f"lease: got {_MOST + 1} holders, expected at most {_MOST}")
        self._expires[order.epoch] = now + PERIOD
        lease = Lease(
            program=order.program,
            operator=order.operator,
            epoch=order.epoch,
            names=tuple(dict.fromkeys(order.names)),
            since=mine.since if mine is not None else now,
        )
        if lease != mine:
            self._leases[order.epoch] = lease
            self._keep(tuple(self._leases.values()))

    def check(self, order: Message, names: Sequence[str], now: float) -> None:
        """Refuse an order about robots that somebody else holds.

        Args:
            order: the order.
            names: the robots that it is about; empty for all.
            now: the time [s].

        Raises:
            OrderRefused: it is.
        """
        self._end_old(now)
        for lease in self._leases.values():
            if lease.covers(names) and not lease.admits(order):
                raise OrderRefused(str(lease))

    def state(self, now: float) -> LeaseState:
        """The leases that hold, to be published.

        Args:
            now: the time [s].
        """
        self._end_old(now)
        left = {epoch: max(0.0, expires - now) for epoch, expires in self._expires.items()}
        leases = tuple(msgspec.structs.replace(lease, left=left[epoch]) for epoch, lease in self._leases.items())
        return LeaseState(stamp=now, leases=leases)

    def _end_old(self, now: float) -> None:
        # Written so that an invalid time ends them.
        self._end([epoch for epoch, expires in self._expires.items() if not now <= expires])

    def _end(self, epochs: Sequence[int]) -> None:
        for epoch in epochs:
            del self._leases[epoch], self._expires[epoch]
        if epochs:
            self._keep(tuple(self._leases.values()))
