"""A fleet in memory and in real time, its page on a port of this machine, and clients that speak to it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from typing import Any

import msgpack
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosedError

from agents.agent import Agent
from agents.base.simulated import Floor
from agents.simulator import Room
from basestation.dashboard.access import Access, Address, Tokens
from basestation.dashboard.offer import listen
from basestation.dashboard.process import Dashboard
from basestation.localization.sightings import Sighting, Sightings
from basestation.station import Station
from muro_zenoh.channels import Role
from muro_zenoh.config import Scenario
from muro_zenoh.geometry import Pose2
from muro_zenoh.runtime.virtual_time import InlineExecutor
from muro_zenoh.transport import Bus, MemoryNetwork, make_bus
from tests.support.waiting import given_again, seconds

TOKENS = Tokens("look-only", "may-steer")

COVARIANCE = (1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 1e-5)


class FloorCamera:
    """Sees the floor itself, 20 times a second.

    Args:
        bus: for the time.
        floor: the floor.
        robots: their names, in the plant's order.

    Attributes:
        hidden: the robots that it does not see.
    """

    def __init__(self, bus: Bus, floor: Floor, robots: Sequence[str]) -> None:
        self.hidden: set[str] = set()
        self._bus = bus
        self._floor = floor
        self._robots = robots

    async def __aiter__(self) -> AsyncIterator[Sightings]:
        while True:
            await asyncio.sleep(0.05)
            self._floor.catch_up()
            seen = tuple(
                Sighting(name, Pose2(*pose), COVARIANCE)
                for name, pose in zip(self._robots, self._floor.plant.pose.tolist(), strict=True)
                if name not in self.hidden
            )
            yield Sightings(camera="north", captured=self._bus.clock.now(), robots=seen)


class PageFleet:
    """Robots, base station and page in this process. Made by :func:`page_fleet`.

    Attributes:
        scenario: the settings.
        room: the robots.
        camera: what sees them.
        station: the base station.
        dashboard: the page.
        address: where it is served.
        processes: the task of each process, by its name.
    """

    room: Room
    camera: FloorCamera
    station: Station
    dashboard: Dashboard
    address: Address

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.network = MemoryNetwork()
        self.processes: dict[str, asyncio.Task[None]] = {}

    def bus(self, *roles: Role) -> Bus:
        """Another process's."""
        return make_bus(self.network.link(), roles=roles)

    def wheels(self, name: str) -> tuple[float, float]:
        """The current command of a robot's wheels: v [m/s], omega [rad/s]."""
        v, omega = self.room.floor.commands[self.scenario.robots.index(name)].tolist()
        return v, omega

    async def end(self, name: str) -> None:
        """End a process."""
        task = self.processes.pop(name)
        task.cancel()
        await asyncio.wait({task})

    @asynccontextmanager
    async def client(self, token: str = TOKENS.operator, **options: Any) -> AsyncIterator[PageClient]:
        """A client; with a token in place of the operator's, or none when it is empty."""
        protocols = ["muro", *([f"token.{token}"] if token else [])]
        url = f"ws://{self.address.text}/ws"
        async with connect(url, subprotocols=protocols, max_size=None, compression=None, **options) as socket:
            client = PageClient(socket)
            reading = asyncio.create_task(client.read())
            try:
                yield client
            finally:
                reading.cancel()
                await asyncio.wait({reading})


class PageClient:
    """A browser, as far as the WebSocket is concerned.

    Attributes:
        socket: the WebSocket.
        hello: the newest greeting.
        state: the newest state, its slow parts put together.
        states: number of states received.
        size: of all messages [bytes].
        replies: the replies by id.
        pictures: the pictures.
        ids: the id of the newest order.
        closed: how the server closed the connection: code and reason.
    """

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.hello: dict[str, Any] = {}
        self.state: dict[str, Any] = {"details": {}, "events": []}
        self.states = 0
        self.size = 0
        self.replies: dict[int | None, dict[str, Any]] = {}
        self.pictures: list[dict[str, Any]] = []
        self.closed: tuple[int, str] | None = None
        self._changed = asyncio.Event()
        self.ids = 0

    async def read(self) -> None:
        """Take messages until the connection is closed."""
        with contextlib.suppress(ConnectionClosedError):
            async for data in self.socket:
                assert isinstance(data, bytes)
                self.size += len(data)
                self._take(msgpack.unpackb(data))
                self._changed.set()
        self.closed = self.socket.close_code or 0, self.socket.close_reason or ""
        self._changed.set()

    def _take(self, message: dict[str, Any]) -> None:
        kind = message["kind"]
        if kind == "hello":
            self.hello = message
        elif kind == "reply":
            self.replies[message["id"]] = message
        elif kind == "picture":
            self.pictures.append(message)
        else:
            self.states += 1
            details = {**self.state["details"], **message.pop("details", {})}
            events = [*self.state["events"], *message.pop("events", [])]
            self.state = {**self.state, **message, "details": details, "events": events}

    async def until(self, condition: Callable[[], Any], limit: float, what: str) -> None:
        """Wait until a condition on what was received holds."""
        try:
            async with asyncio.timeout(seconds(limit)):
                while not condition():
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            raise AssertionError(f"{what}: not within {seconds(limit):g} s; {self.state}") from None

    async def send(self, order: str, **values: Any) -> int:
        """Give an order; returns its id."""
        self.ids += 1
        await self.socket.send(msgpack.packb({"order": order, "id": self.ids, **values}))
        return self.ids

    async def order(self, order: str, **values: Any) -> dict[str, Any]:
        """Give an order, and wait for the reply; again where its receiver had just stood still."""

        async def give() -> dict[str, Any]:
            number = await self.send(order, **values)
            await self.until(lambda: number in self.replies or self.closed, 10.0, f"a reply to {order}")
            return self.replies[number]

        return await given_again(give, lambda reply: str(reply["reason"]))

    async def drive(self, name: str, v: float, omega: float) -> int:
        """Drive a robot by the newest state; returns the order's id."""
        return await self.send("drive", name=name, v=v, omega=omega, t=self.state["t"])

    async def resume(self, *names: str) -> dict[str, Any]:
        """Lift the stop that is shown, and wait for the reply."""
        return await self.order("resume", names=names, revision=self.state["stop"]["revision"])

    def details(self, name: str) -> dict[str, Any]:
        """What is slow of one robot."""
        found: dict[str, Any] = self.state["details"].get(name, {})
        return found


@asynccontextmanager
async def page_fleet(scenario: Scenario, agents: Sequence[str] | None = None) -> AsyncIterator[PageFleet]:
    """A fleet and its page; all of it is ended after the block.

    Args:
        scenario: the settings.
        agents: the robots that have agents; all of them by default.
    """
    fleet = PageFleet(scenario)
    buses = {
        "simulator": fleet.bus(Role.SIMULATOR, Role.BASE, Role.CAMERA),
        "basestation": fleet.bus(Role.BASESTATION),
        "page": fleet.bus(Role.OPERATOR),
        **{name: fleet.bus(Role.AGENT) for name in (scenario.robots if agents is None else agents)},
    }
    fleet.room = Room(buses["simulator"], scenario, 1, InlineExecutor(), cameras=())
    fleet.camera = FloorCamera(buses["basestation"], fleet.room.floor, scenario.robots)
    fleet.station = Station(buses["basestation"], scenario, None, [fleet.camera])
    listening = listen("127.0.0.1", 0)
    fleet.address = Address(*listening.getsockname())
    fleet.dashboard = Dashboard(buses["page"], scenario, Access(fleet.address, TOKENS))
    for name, bus in buses.items():
        role = {"simulator": Role.SIMULATOR, "basestation": Role.BASESTATION}.get(name, Role.AGENT)
        if name != "page":
            bus.announce(role, name)
    mains = {
        "simulator": fleet.room.run,
        "basestation": fleet.station.run,
        "page": lambda: fleet.dashboard.run(listening),
        **{name: Agent(buses[name], scenario, name).run for name in buses.keys() & set(scenario.robots)},
    }

    async def run(name: str) -> None:
        async with buses[name]:
            await mains[name]()

    for name in buses:
        fleet.processes[name] = asyncio.create_task(run(name), name=name)
    try:
        yield fleet
        for name, task in fleet.processes.items():
            assert not task.done(), f"{name} ended: {task}"
    finally:
        for task in fleet.processes.values():
            task.cancel()
        await asyncio.wait(fleet.processes.values())
