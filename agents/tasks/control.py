"""The control task: awaits fixes, and passes them and all other inputs to the control loop."""

from __future__ import annotations

import asyncio
import math
from typing import Any, Final, TypeVar

from agents.control_loop import ControlLoop, Surroundings
from agents.master import Master, Writers
from agents.outgoing import Outgoing
from muro_zenoh import channels
from muro_zenoh.behaviours.interface import Need, Snapshot
from muro_zenoh.channels import Channel
from muro_zenoh.config import TIMEOUTS, Timeouts
from muro_zenoh.geometry import Twist2
from muro_zenoh.messages import Circle as CircleMessage
from muro_zenoh.messages import DriveWish, FleetSnapshot, Message, PoseFix, SpeedReference
from muro_zenoh.transport import Bus, Every, Latest, Publisher, Received

T = TypeVar("T", bound=Message)

TICK: Final = 1.5 * channels.POSE.period
"""When no fix has arrived for this time, the estimate is predicted without one [s]."""


class Sender:
    """Sends the control loop's messages, each under the robot's name.

    Args:
        bus: the bus.
        name: the robot's name.
    """

    def __init__(self, bus: Bus, name: str) -> None:
        self._bus = bus
        self._name = name
        self._publishers: dict[str, Publisher[Any]] = {}

    def send(self, out: Outgoing) -> None:
        """Send messages. Most robots never use most channels, so a publisher is declared with its first message.

        Args:
            out: messages from the control loop.
        """
        for channel, message in out:
            publisher = self._publishers.get(channel.word)
            if publisher is None:
                publisher = self._publishers[channel.word] = self._bus.publisher(channel, self._name)
            publisher.put(message)


class Listener:
    """Receives what the running behaviour needs, what the control loop always needs, and nothing else.

    Args:
        bus: the bus.
        name: the robot's name.
        master: whose velocities count.
        timeouts: how old the positions of all robots may be.
        always: what is received whatever the behaviour needs.

    Attributes:
        earlier: the snapshots that came before the newest one since the last :meth:`surroundings`, none of them stale.
    """

    def __init__(
        self,
        bus: Bus,
        name: str,
        master: Master,
        timeouts: Timeouts = TIMEOUTS,
        always: frozenset[Need] = frozenset(),
    ) -> None:
        self._always = always
        self._snapshot_timeout = timeouts.snapshot
        self._bus = bus
        self._name = name
        self._master = master
        self._circle: Latest[CircleMessage] | None = None
        self._speed: Writers[SpeedReference] | None = None
        self._hand: Writers[DriveWish] | None = None
        self.earlier: tuple[Snapshot, ...] = ()
        self._snapshots: Every[FleetSnapshot] | None = None
        self._snapshot: Received[FleetSnapshot] | None = None

    def need(self, needs: frozenset[Need]) -> None:
        """Subscribe to what a behaviour needs, and unsubscribe from what it does not.

        Args:
            needs: needs of the behaviour that starts.
        """
        needs |= self._always
        for writers in (self._speed, self._hand):  # what was meant for the previous behaviour is not for this one
            if writers is not None:
                writers.close()
        self._circle = self._needed(Need.CIRCLE in needs, self._circle, channels.CIRCLE)
        if Need.SNAPSHOT in needs:
            self._snapshots = self._snapshots or self._bus.every(channels.ALL_POSITIONS)
        elif self._snapshots is not None:
            self._snapshots.close()
            self._snapshots = self._snapshot = None
        bus, name, master = self._bus, self._name, self._master
        self._speed = Writers(bus, channels.VELOCITY, name, master) if Need.SPEED in needs else None
        self._hand = Writers(bus, channels.DRIVE, name, master) if Need.HAND in needs else None

    def _needed(self, needed: bool, box: Latest[T] | None, channel: Channel[T]) -> Latest[T] | None:
        if needed:
            return box if box is not None else self._bus.latest(channel)
        if box is not None:
            box.close()
        return None

    @property
    def complaints(self) -> tuple[str, ...]:
        """What was received and is not followed, for the operator."""
        return tuple(w.complaint for w in (self._speed, self._hand) if w is not None and w.complaint)

    def surroundings(self, now: float) -> Surroundings:
        """What has been received until now.

        Args:
            now: the time [s].
        """
        self._master.look()
        circle = self._circle.get() if self._circle is not None else None
        speed, speed_age = self._speed.followed(now) if self._speed is not None else (None, math.inf)
        wish, wish_age = self._hand.followed(now) if self._hand is not None else (None, math.inf)
        self._take_snapshots(now)
        newest = self._snapshot
        snapshot_age = newest.age(now) if newest is not None else math.inf
        return Surroundings(
            circle.message.circle if circle is not None else None,
            speed.message.speed if speed is not None else None,
            speed_age,
            _snapshot(newest, snapshot_age) if newest is not None and snapshot_age <= self._snapshot_timeout else None,
            snapshot_age,
            Twist2(wish.message.v, wish.message.omega) if wish is not None else None,
            wish_age,
        )

    def _take_snapshots(self, now: float) -> None:
        """Those that came since the last time."""
        came = self._snapshots.drain() if self._snapshots is not None else []
        if came:
            known = [*came, self._snapshot] if self._snapshot is not None else came
            self._snapshot = min(known, key=lambda received: received.age(now))
        ages = ((received, received.age(now)) for received in came if received is not self._snapshot)
        self.earlier = tuple(_snapshot(received, age) for received, age in ages if age <= self._snapshot_timeout)


def _snapshot(received: Received[FleetSnapshot], age: float) -> Snapshot:
    message = received.message
    return Snapshot(message.robots, message.stamp, message.epoch, age)


class Signals:
    """Events between the tasks of an agent; created on the loop.

    Attributes:
        changed: there is something new to report.
        located: the robot has received its first pose.
        latencies: for each fix since the last report, the time from its arrival to the command that used it [s].
    """

    def __init__(self) -> None:
        self.changed = asyncio.Event()
        self.located = asyncio.Event()
        self.latencies: list[float] = []


async def control(bus: Bus, name: str, loop: ControlLoop, listener: Listener, sender: Sender, signals: Signals) -> None:
    """Await fixes; at each one, and when one is overdue, update the control loop. Command zero at the end.

    Args:
        bus: the bus.
        name: the robot's name.
        loop: the control loop.
        listener: receives what the behaviour needs.
        sender: sends the messages.
        signals: wakes the other tasks.
    """
    clock = bus.clock
    poses = bus.every(channels.POSE, name)
    wheels = bus.every(channels.ODOMETRY, name)
    try:
        while True:
            fixes: list[Received[PoseFix]] = []
            try:
                async with asyncio.timeout(TICK):
                    fixes = [await poses.next(), *poses.drain()]
            except TimeoutError:
                pass
            now = clock.now()
            around = listener.surroundings(now)
            sender.send(
                loop.update(
                    now,
                    [(fix.captured() - fix.message.age, fix.message) for fix in fixes],
                    [(o.captured(), o.message.v, o.message.omega) for o in wheels.drain()],
                    around,
                    listener.earlier,
                )
            )
            if fixes:
                signals.latencies.append(clock.now() - fixes[-1].arrival)
            if loop.changed:
                signals.changed.set()
            if loop.seen is not None:
                signals.located.set()
    finally:
        sender.send(loop.end(clock.now()))
