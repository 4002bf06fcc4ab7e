"""The kept state: publishes circle, behaviours and stop twice a second, and adopts stops that robots have latched."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Awaitable

from basestation.fleet.leases import Leases
from basestation.fleet.state_store import StateStore
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.errors import ConfigError
from muro_zenoh.transport import Bus

log = logging.getLogger(__name__)

_PERIOD = channels.STOP.period

_SHORTEST_ADOPTION = 0.15
"""After its start the base station receives the robots' health for at least this time before it publishes the stop
state [s]: the file must not contradict a stop that an operator ordered while no base station was running ..."""

_LONGEST_ADOPTION = 1.5
"""... and for at most this time, until each agent that is alive has reported [s]."""

_CHECK_PERIOD = 0.02


class KeptStateTask:
    """Publishes the kept state.

    Args:
        bus: the bus.
        store: the kept state.
        leases: who may order which robots.

    Attributes:
        adopted: whether all live agents have reported, or the time for it is over; until then nothing is published.
    """

    def __init__(self, bus: Bus, store: StateStore, leases: Leases) -> None:
        self.adopted = False
        self._store = store
        self._leases = leases
        self._clock = bus.clock
        self._circle = bus.publisher(channels.CIRCLE)
        self._stop = bus.publisher(channels.STOP)
        self._lease = bus.publisher(channels.LEASE)
        self._behaviours = {name: bus.publisher(channels.BEHAVIOUR, name) for name in store.robots}
        self._healths = bus.every(channels.HEALTH, "*", depth=256)
        self._roster = bus.roster()
        self._reported: set[str] = set()

    async def run(self) -> None:
        """Adopt first, then publish until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._adopt(tasks), name="adopt stops")
            await asyncio.sleep(_SHORTEST_ADOPTION)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_LONGEST_ADOPTION - _SHORTEST_ADOPTION):
                    while not self._roster.of(Role.AGENT) <= self._reported:  # noqa: ASYNC110 - a roster and a mailbox at once
                        await asyncio.sleep(_CHECK_PERIOD)
            self.adopted = True
            while True:
                self.publish()
                await asyncio.sleep(_PERIOD)

    def publish(self) -> None:
        """Publish the current state, the stop first."""
        if not self.adopted:
            return
        self._stop.put(self._store.stop)
        self._circle.put(self._store.circle)
        self.publish_leases()
        for name, publisher in self._behaviours.items():
            publisher.put(self._store.behaviour(name))

    def publish_leases(self) -> None:
        """Publish who may order which robots."""
        self._lease.put(self._leases.state(self._clock.now()))

    async def _adopt(self, tasks: asyncio.TaskGroup) -> None:
        """Receive the robots' stop states: a latched stop that this process never received is kept from now on."""
        async for received in self._healths:
            health = received.message
            if health.role != Role.AGENT:
                continue
            saved = self._store.adopt(received.name, health)
            self._reported.add(received.name)
            if saved is not None:
                log.warning("adopted the stop state of %s: %s", received.name, self._store.stop)
                self.publish()
                # The next robot's stop must not wait for the disk.
                tasks.create_task(_logged(saved, received.name), name=f"save the stop of {received.name}")


async def _logged(saved: Awaitable[None], name: str) -> None:
    try:
        await saved
    except ConfigError as error:
        log.error("the stop state of %s is active, but not saved: %s", name, error)
