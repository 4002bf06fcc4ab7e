"""A real router process."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator
from dataclasses import dataclass

from muro_zenoh.config import BusSettings
from tests.support.process import Process

_ATTEMPTS = 5


@dataclass(frozen=True)
class Router:
    """A running router.

    Attributes:
        process: its process.
        endpoint: where clients connect.
    """

    process: Process
    endpoint: str

    def settings(self, realm: str = "muro") -> BusSettings:
        """Settings of a client of this router."""
        return BusSettings(realm=realm, connect=(self.endpoint,))


@contextlib.contextmanager
def router() -> Iterator[Router]:
    """A router on a free port of this machine, stopped at the end of the block."""
    for attempt in range(_ATTEMPTS):
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        process = Process(router_command(endpoint), name="router")
        try:
            process.ready()
        except AssertionError:
            process.stop()
            # Another process took the port between our check and the router's start: try another.
            if attempt + 1 == _ATTEMPTS:
                raise
            continue
        with process:
            yield Router(process, endpoint)
        return


def router_command(endpoint: str) -> list[str]:
    """Python's arguments for a router.

    Args:
        endpoint: where it listens.
    """
    return ["-m", "muro_zenoh", "router", "--listen", endpoint]


def free_port() -> int:
    """A TCP port that was free a moment ago. For port 0 Zenoh does not report the actual port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
