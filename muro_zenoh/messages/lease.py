"""Who may order what robots do: the lease, how it is asked for, and what the base station says of it."""

from __future__ import annotations

import time
from collections.abc import Collection
from typing import Annotated

from msgspec import Meta, Struct

from muro_zenoh.messages.base import MOST_NAMES, Message, Names, require_usable

Text = Annotated[str, Meta(max_length=128)]
"""A program's or an operator's name."""

MOST_LEASES = MOST_NAMES
"""There are at most so many leases: no two of them cover one robot."""


class Lease(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One holder's right to order robots.

    Attributes:
        program: what the holder is, such as ``muro run``.
        operator: whose it is, such as ``alice@laptop``.
        epoch: the holder's process.
        names: the robots; empty for all.
        since: when it was granted [s since 1970, the base station's clock].
        left: how long it lasts, from the stamp of the message on, unless it is renewed [s].
    """

    program: Text
    operator: Text
    epoch: Annotated[int, Meta(gt=0)]
    names: Names = ()
    since: float
    left: Annotated[float, Meta(ge=0)] = 0.0

    def covers(self, names: Collection[str]) -> bool:
        """Whether it is about any of these robots.

        Args:
            names: their names; empty for all robots.
        """
        return not self.names or not names or not set(self.names).isdisjoint(names)

    def admits(self, order: Message) -> bool:
        """Whether an order, or a velocity, is its holder's: of the same process, or of the same operator.

        Args:
            order: the message; an ``operator`` in it is whose it is.
        """
        operator = getattr(order, "operator", "")
        return order.epoch == self.epoch or (bool(operator) and operator == self.operator)

    def __str__(self) -> str:
        names = " ".join(self.names) if self.names else "all robots"
        since = time.strftime("%H:%M", time.localtime(self.since))
        return f"held by {self.program} of {self.operator} since {since} ({names})"


class TakeLease(Message, frozen=True, kw_only=True):
    """An order to the base station: grant the sender's process the right to order ``names`` (empty: all robots), or
    renew it, or with ``release`` end it."""

    program: Text
    operator: Text
    names: Names = ()
    release: bool = False


class LeaseState(Message, frozen=True, kw_only=True):
    """All leases that are in force."""

    leases: Annotated[tuple[Lease, ...], Meta(max_length=MOST_LEASES)] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        for lease in self.leases:
            require_usable("leases.since", lease.since)
            require_usable("leases.left", lease.left)
