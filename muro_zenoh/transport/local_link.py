"""The link between the agent and the base of one robot, on their own machine: a stop reaches the wheels without router
and network.

Both connect to the router. The base also listens on an endpoint of the machine itself, and the agent also connects to
that. A client of Zenoh has one connection, so both are peers. Measured with Zenoh 1.10: nothing arrives twice; a base
that starts later, or again, is connected to within a second; with the router killed all commands and odometry arrive.
The router does not forward from peer to peer: without their link the two do not hear each other, and the dead-man acts.
"""

from __future__ import annotations

from typing import Literal

import msgspec

from muro_zenoh.config import BusSettings


def with_local_link(settings: BusSettings, endpoint: str | None, end: Literal["agent", "base"]) -> BusSettings:
    """The settings of an agent's or a base's bus. It does not wait for the router, and connects to it when it is there.

    Args:
        settings: as for all processes.
        endpoint: where the base listens; None for no link: the settings as they are.
        end: whose settings.
    """
    if endpoint is None:
        return settings
    if end == "base":
        return msgspec.structs.replace(settings, mode="peer", listen=(*settings.listen, endpoint))
    return msgspec.structs.replace(settings, mode="peer", connect=(*settings.connect, endpoint))
