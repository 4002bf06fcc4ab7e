"""Whose orders count for one robot, and whose velocity: its lease's holder's, or anybody's while nobody holds it."""

from __future__ import annotations

import math
from typing import Final, Generic, TypeVar

from muro_zenoh import channels
from muro_zenoh.channels import Channel
from muro_zenoh.messages import Lease, Message
from muro_zenoh.transport import Bus, Received

T = TypeVar("T", bound=Message)

_MOST_WRITERS: Final = 8


class Master:
    """The lease of one robot, as the base station says.

    Args:
        bus: the bus.
        name: the robot's name.
    """

    def __init__(self, bus: Bus, name: str) -> None:
        self._name = name
        self._now = bus.clock.now
        self._state = bus.latest(channels.LEASE)

    def look(self) -> None:
        """Read what the base station says. Call it more often than that is repeated, or the bus counts it as unread."""
        self._state.get()

    @property
    def lease(self) -> Lease | None:
        """The lease that is in force now, base station or not; None when nobody holds this robot."""
        received = self._state.get()
        if received is None:
            return None
        age = received.age(self._now())
        live = (lease for lease in received.message.leases if age < lease.left)
        return next((lease for lease in live if lease.covers((self._name,))), None)

    def refusal(self, order: Message) -> str:
        """Why an order for this robot is refused; empty when it is not.

        Args:
            order: the order.
        """
        lease = self.lease
        return "" if lease is None or lease.admits(order) else str(lease)


class Writers(Generic[T]):
    """What others publish for one robot on a channel, such as velocities, of which one writer's is followed.

    While somebody holds the robot, only his count. Otherwise the first one counts for as long as it is fresh: a second
    program waits until the first one is silent, in place of the two driving in turns. What the robot's own behaviour
    publishes counts only when nobody else's does. Programs that give no ``epoch`` are one writer.

    Args:
        bus: the bus.
        channel: the channel.
        name: the robot's name.
        master: its lease.
    """

    def __init__(self, bus: Bus, channel: Channel[T], name: str, master: Master) -> None:
        self._inbox = bus.every(channel, name)
        self._channel = channel
        self._own = bus.epoch
        self._master = master
        self._newest: dict[int, Received[T]] = {}
        self._followed: int | None = None
        self.complaint = ""
        """Why what another program publishes is not followed; empty when there is none."""

    def close(self) -> None:
        """Listen no more."""
        self._inbox.close()

    def followed(self, now: float) -> tuple[Received[T] | None, float]:
        """The newest message of the writer that counts, None when it is stale, and its age [s].

        Args:
            now: the time [s].
        """
        for received in self._inbox.drain():
            self._newest.pop(received.message.epoch, None)
            self._newest[received.message.epoch] = received
            if len(self._newest) > _MOST_WRITERS:
                self._forget_one()
        ages = {epoch: received.age(now) for epoch, received in self._newest.items()}
        # Written so that a NaN is stale.
        fresh = {epoch for epoch, age in ages.items() if age <= self._channel.stale_after}
        lease = self._master.lease
        admitted = {e for e in fresh if lease is None or e == self._own or lease.admits(self._newest[e].message)}
        if self._followed not in admitted or self._followed == self._own:
            self._followed = min(admitted, key=lambda epoch: (epoch == self._own, ages[epoch]), default=None)
        others = fresh - {self._followed, self._own}
        self.complaint = ""
        if others:
            why = str(lease) if lease is not None else "another program's came first"
            self.complaint = f"a {self._channel.word} is not followed: {why}"
        if self._followed is None:
            return None, min(ages.values(), default=math.inf)
        return self._newest[self._followed], ages[self._followed]

    def _forget_one(self) -> None:
        """The one that was silent for longest, and never the one that is followed: strangers do not displace it."""
        del self._newest[next(epoch for epoch in self._newest if epoch != self._followed)]
