"""The page's process: reads the bus, and serves what it reads to browsers."""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
from typing import Final

from basestation.dashboard.access import Access, Address, Tokens
from basestation.dashboard.describing import describe, describe_faults, tag_height
from basestation.dashboard.desk import Desk
from basestation.dashboard.offer import listen
from basestation.dashboard.pictures import Pictures
from basestation.dashboard.server import Clients, make_app, serve
from basestation.dashboard.watching import FleetWatch
from muro_zenoh.channels import Role
from muro_zenoh.config import Scenario
from muro_zenoh.errors import TransportError
from muro_zenoh.runtime.process import ready, watchdog, worker_threads
from muro_zenoh.transport import Bus, open_bus

log = logging.getLogger(__name__)

PERIOD: Final = 0.05
"""Time between two states [s]."""

_IDLE_PERIOD: Final = 0.5
"""The same while nobody looks: what happens meanwhile is noted [s]."""

_LONGEST_BLOCK: Final = 10.0
"""A page that stands still for this long takes no stop, and the base station starts another [s]."""

_BIND_TIMEOUT: Final = 1.0
"""How long the page of the base station before may take to leave the port [s]."""


class Dashboard:
    """The page of one fleet.

    Args:
        bus: the bus, as an operator.
        scenario: the settings.
        access: who may.

    Attributes:
        clients: the browsers that are connected.
        desk: takes their orders.
        app: the web application.
    """

    def __init__(self, bus: Bus, scenario: Scenario, access: Access) -> None:
        self._watch = FleetWatch(bus, scenario)
        self.desk = Desk(bus, scenario, self._watch)
        hello = {**describe(scenario), "simulated": False, "faults": {}}
        self.clients = Clients(access, self._watch.frames, hello, self.desk)
        self.app = make_app(self.clients, access)
        self._faults = describe_faults(scenario)
        self._bus = bus
        self._scenario = scenario

    async def run(self, listening: socket.socket) -> None:
        """Serve until cancelled.

        Args:
            listening: the socket.
        """
        height = tag_height(self._scenario)
        with worker_threads(1, "picture") as threads:
            pictures = Pictures(self._bus, self._scenario, height, self._wanted, self._show, threads)
            try:
                async with asyncio.TaskGroup() as tasks:
                    tasks.create_task(self._tick(), name="tick")
                    tasks.create_task(pictures.run(), name="pictures")
                    tasks.create_task(serve(self.app, listening), name="web server")
            finally:
                await self.desk.close()

    def _wanted(self) -> set[str]:
        return {camera for client in self.clients for camera in client.cameras}

    def _show(self, camera: str, picture: bytes) -> None:
        for client in self.clients:
            if camera in client.cameras:
                client.picture(camera, picture)

    async def _tick(self) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            self._watch.tick()
            breakable = self._watch.can_be_broken
            self.clients.change_hello(simulated=breakable, faults=self._faults if breakable else {})
            self.clients.tick()
            due = max(due + (PERIOD if len(self.clients) else _IDLE_PERIOD), loop.time())
            await asyncio.sleep(due - loop.time())


async def run_dashboard(scenario: Scenario, address: Address, tokens: Tokens) -> None:
    """The page's process.

    Args:
        scenario: the settings.
        address: where to serve it.
        tokens: of its viewers and operators.

    Raises:
        NotConnected: no router answered.
        TransportError: the address cannot be listened on.
    """
    logging.getLogger("uvicorn").setLevel(logging.ERROR)  # it greets at length, and warns of each request that is none
    listening = await _listen(address)
    log.info("the page is at %s", address.url)
    async with watchdog(_LONGEST_BLOCK), open_bus(scenario.bus, Role.OPERATOR) as bus:
        ready("page")
        await Dashboard(bus, scenario, Access(address, tokens)).run(listening)


async def _listen(address: Address) -> socket.socket:
    loop = asyncio.get_running_loop()
    end = loop.time() + _BIND_TIMEOUT
    while True:
        try:
            return listen(address.host, address.port)
        except OSError as error:
            if error.errno == errno.EADDRINUSE and loop.time() < end:
                await asyncio.sleep(0.05)
                continue
            raise TransportError(
                f"--web: got {address.host}:{address.port}, which cannot be listened on ({error.strerror or error}), "
                "expected a free port of this machine"
            ) from None
