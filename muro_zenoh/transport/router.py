"""The embedded router: a Zenoh session in router mode, to which the others connect."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable

import msgspec

from muro_zenoh.config import BusSettings


async def run_router(settings: BusSettings) -> None:
    """Route until cancelled.

    Args:
        settings: ``listen`` says where the others connect; ``connect`` may name other routers; the mode is set here.

    Raises:
        TransportError: an endpoint is taken, or Zenoh refuses the settings.
    """
    # A router keeps Zenoh's own threads: with the one of the others it would not forward large messages.
    os.environ["MURO_ROUTER"] = "1"
    from muro_zenoh.runtime.process import ready
    from muro_zenoh.transport.zenoh_link import ZenohLink

    link = await ZenohLink.open(msgspec.structs.replace(settings, mode="router"))
    ready("router", ",".join(settings.listen))
    try:
        await asyncio.Event().wait()
    finally:
        await link.close()


def router_settings(fleet: BusSettings | None, override: Callable[[BusSettings], BusSettings]) -> BusSettings:
    """The router's own settings.

    It listens where the command line says, or else, without a fleet, where the Zenoh configuration named there says, or
    else where the fleet's ``listen`` says, or else where its processes connect to.

    Args:
        fleet: the ``[bus]`` section that everybody has; None without a fleet.
        override: overrides settings by those of the command line.
    """
    bus = fleet or BusSettings()
    settings = override(msgspec.structs.replace(bus, mode="router", listen=(), connect=()))
    if settings.listen or (settings.config and fleet is None):
        return settings
    return msgspec.structs.replace(settings, listen=bus.listen or bus.connect)
