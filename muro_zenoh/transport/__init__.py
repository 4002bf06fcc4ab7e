"""The bus: asyncio over Eclipse Zenoh, or over memory in tests.

::

    async with open_bus(settings, Role.AGENT) as bus:
        fixes = bus.every(channels.POSE, "r1")
        commands = bus.publisher(channels.CMD_VEL, "r1")
        async for fix in fixes:
            commands.put(VelocityCommand(v=0.1, omega=0.0))
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from muro_zenoh.channels import Role
from muro_zenoh.config import BusSettings
from muro_zenoh.runtime.clock import Clock
from muro_zenoh.runtime.usage import own_usage
from muro_zenoh.transport.bus import Bus, draw_epoch, make_bus
from muro_zenoh.transport.link import Closable
from muro_zenoh.transport.local_link import with_local_link
from muro_zenoh.transport.mailboxes import Every, Latest
from muro_zenoh.transport.memory_link import MemoryNetwork
from muro_zenoh.transport.publisher import Publisher
from muro_zenoh.transport.received import Counters, Received
from muro_zenoh.transport.roster import Roster
from muro_zenoh.transport.tap import Sample, Tap

__all__ = [
    "Bus",
    "Closable",
    "Counters",
    "Every",
    "Latest",
    "MemoryNetwork",
    "Publisher",
    "Received",
    "Roster",
    "Sample",
    "Tap",
    "draw_epoch",
    "make_bus",
    "open_bus",
    "with_local_link",
]


@asynccontextmanager
async def open_bus(
    settings: BusSettings, role: Role, *more_roles: Role, clock: Clock | None = None
) -> AsyncIterator[Bus]:
    """A bus over Zenoh, closed at the end of the block.

    Args:
        settings: the ``[bus]`` section of the settings.
        role: of this process: what it may write, answer and announce.
        more_roles: where it has several.
        clock: for stamps and arrival times; the system's by default.

    Raises:
        NotConnected: no router answered.
        TransportError: Zenoh refused the settings.
    """
    # Not at the top: what only needs the in-memory bus does not pay for Zenoh.
    from muro_zenoh.transport.zenoh_link import ZenohLink

    link = await ZenohLink.open(settings)
    async with make_bus(link, settings.realm, roles=(role, *more_roles), clock=clock, usage=own_usage) as bus:
        yield bus
