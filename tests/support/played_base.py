"""A page whose base station a test plays: it answers what the test says, when the test says, or not at all."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from typing import Any

import msgpack
from playwright.async_api import Browser, Route, WebSocketRoute

from tests.support.browser import STATIC, Visit, visit
from tests.support.waiting import seconds

Row = dict[str, Any]

NAMES = ("r1", "r2")

_HAND = {"speed": {"type": "number", "default": 0.2}, "turning": {"type": "number", "default": 1.0}}
_BEHAVIOURS: Row = {
    "circle": {"summary": "", "needs": ["circle", "velocity"], "parameters": {"speed": _HAND["speed"]}},
    "manual": {"summary": "", "needs": ["drive"], "parameters": _HAND},
}

DETAILS: Row = {
    "state": "driving",
    "reason": "",
    "note": "",
    "complaints": [],
    "pose_age": 0.05,
    "latency": 0.002,
    "cal": [1.0, 1.0],
    "wheels": "",
    "parameters": {},
    "behaviour": "manual",
    "path": None,
    "cell": None,
    "goal": None,
}


def hello(names: Sequence[str], **more: Any) -> Row:
    """What a page gets first, of robots that are all alike."""
    robot = {"radius": 0.177, "v_max": 0.5, "omega_max": 1.5, "margin": 0.05}
    return {
        "kind": "hello",
        "realm": "muro",
        "scenario": "played",
        "arena": (-2.1, -1.5, 2.1, 1.5),
        "walls": (),
        "robots": dict.fromkeys(names, robot),
        "cameras": {},
        "behaviours": _BEHAVIOURS,
        "may_steer": True,
        "simulated": False,
        "faults": {},
        **more,
    }


def receipt(*names: str, status: str = "stopped") -> Row:
    """The receipt of a stop that all of these robots answer alike."""
    row = {"status": status, "latched_after_s": 0.01, "at_rest_after_s": 0.2, "travelled_m": 0.0, "silent_s": None}
    confirmed = status == "stopped"
    return {"confirmed": confirmed, "robots": dict.fromkeys(names, row)}


class PlayedBase:
    """What a page takes for its base station.

    Attributes:
        orders: what the page ordered, the newest last.
        answers: what is answered to each kind of order; None for nothing. Those that are missing are taken.
        stop: the stop that is shown.
        places: where each robot is [m].
        admits: whether who connects is let in.
        sends: whether states are sent.
        connections: how often the page has connected.
        t: of the newest state [s].
    """

    def __init__(self) -> None:
        self.orders: list[Row] = []
        self.answers: dict[str, Callable[[Row], Row | None]] = {}
        self.stop: Row = {"all": False, "names": [], "revision": 1}
        self.places = {name: (0.5 * turn, 0.0) for turn, name in enumerate(NAMES)}
        self.admits = True
        self.sends = True
        self.connections = 0
        self.t = 0.0
        self._socket: WebSocketRoute | None = None
        self._changed = asyncio.Event()
        self._seq = 0

    def of(self, order: str) -> list[Row]:
        """The orders of one kind."""
        return [one for one in self.orders if one["order"] == order]

    async def until(self, condition: Callable[[], Any], what: str, limit: float = 10.0) -> None:
        """Wait until a condition on what was ordered holds."""
        try:
            async with asyncio.timeout(seconds(limit)):
                while not condition():
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            raise AssertionError(f"{what}: not within {seconds(limit):g} s; {self.orders[-5:]}") from None

    def send(self, message: Row) -> None:
        """Send the page a message."""
        if self._socket is not None:
            self._socket.send(msgpack.packb(message))

    async def cut(self) -> None:
        """Close the connection."""
        socket, self._socket = self._socket, None
        if socket is not None:
            await socket.close(code=1012)

    def connected(self, socket: WebSocketRoute) -> None:
        """A page connects."""
        self.connections += 1
        self._changed.set()
        if not self.admits:
            self._closing = asyncio.ensure_future(socket.close(code=4401))
            return
        self._socket = socket
        socket.on_message(self._take)
        self.send(hello(NAMES))
        self.state(details=dict.fromkeys(NAMES, DETAILS))

    def tell(self, name: str, **details: Any) -> None:
        """Send a state in which these details of a robot have changed."""
        self.state(details={name: {**DETAILS, **details}})

    def state(self, **parts: Any) -> None:
        """Send a state."""
        self.t, self._seq = time.time(), self._seq + 1
        robots = {name: [*place, 0.0, 0.0, 0.0, 0.05, 0.0, 0.0] for name, place in self.places.items()}
        self.send({"kind": "state", "t": self.t, "seq": self._seq, "robots": robots, "stop": self.stop, **parts})

    async def run(self) -> None:
        """Send states until cancelled."""
        while True:
            await asyncio.sleep(0.05)
            if self.sends:
                self.state()

    def _take(self, data: str | bytes) -> None:
        assert isinstance(data, bytes)
        order = msgpack.unpackb(data)
        self.orders.append(order)
        self._changed.set()
        answer = self.answers.get(order["order"], lambda _: {"outcome": "taken", "reason": ""})(order)
        if answer is not None and order["order"] != "drive":
            self.send({"kind": "reply", "id": order["id"], "order": order["order"], **answer})


There = tuple[Visit, PlayedBase]


async def serve(opened: Visit, base: PlayedBase) -> None:
    """Go to the page, as a base station serves it that the test plays."""

    async def file(route: Route) -> None:
        await route.fulfill(path=STATIC / (route.request.url.partition("muro.test/")[2] or "index.html"))

    await opened.page.route("http://muro.test/**", file)
    await opened.page.route_web_socket("**/ws", base.connected)
    await opened.page.goto("http://muro.test/")


@asynccontextmanager
async def played(browser: Browser, **options: Any) -> AsyncIterator[There]:
    """A page, and the base station that the test plays for it."""
    base = PlayedBase()
    async with visit(browser, "about:blank", **options) as opened:
        await serve(opened, base)
        sending = asyncio.create_task(base.run(), name="states")
        try:
            await opened.sees(NAMES)
            yield opened, base
        finally:
            sending.cancel()
            await asyncio.wait({sending})
