"""The embedded router: a Zenoh session in router mode, where the others connect."""

from __future__ import annotations

import asyncio
import os

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


def router_settings(settings: BusSettings) -> BusSettings:
    """The router's own settings, from those of the processes that connect to it.

    Args:
        settings: the ``[bus]`` section that everybody has. Without a ``listen`` the router listens where the others
            connect.
    """
    return msgspec.structs.replace(settings, mode="router", listen=settings.listen or settings.connect, connect=())
