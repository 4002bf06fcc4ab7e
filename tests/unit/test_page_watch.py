"""What the page knows of the fleet, in virtual time: goals, leases and pictures are those of now."""

from __future__ import annotations

import asyncio
from typing import Any

import msgpack
import pytest

from basestation.dashboard import child
from basestation.dashboard.access import Right
from basestation.dashboard.client import Client
from basestation.dashboard.frames import Frames
from basestation.dashboard.pictures import Pictures
from basestation.dashboard.watching import FleetWatch
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import parse_scenario
from muro_zenoh.messages import Behaviour, Frame, Goal, Lease, LeaseState
from muro_zenoh.runtime.process import WRONG_USE
from muro_zenoh.runtime.virtual_time import InlineExecutor
from muro_zenoh.transport import Received
from tests.support.stop_lab import LAB, Lab, virtual


def state(watch: FleetWatch) -> dict[str, Any]:
    """The state as a new client gets it."""
    watch.look()
    watch.tick()
    found: dict[str, Any] = msgpack.unpackb(watch.frames.since(-1))
    return found


@virtual
async def test_a_goal_is_shown_until_the_robot_does_not_have_it_any_more(there: Lab) -> None:
    agents, base = await there.agents("r1"), await there.join(Role.BASESTATION)
    behaviours = base.publisher(channels.BEHAVIOUR, "r1")
    watch = FleetWatch(there.operator, LAB)

    async def runs(behaviour: str, **parameters: float) -> list[float | None] | None:
        behaviours.put(Behaviour(behaviour=behaviour, parameters=parameters, revision=1))
        await asyncio.sleep(0.3)
        goal: list[float | None] | None = state(watch)["details"]["r1"]["goal"]
        return goal

    for change in ({"behaviour": "pursuit"}, {"behaviour": "dubins", "speed": 0.1}):
        assert await runs("dubins") is None
        watch.set_goal("r1", Goal(x=1.0, y=0.5))
        assert await runs("dubins") == [1.0, 0.5, None]
        assert await runs(**change) is None  # type: ignore[arg-type]
    assert await runs("dubins") is None
    watch.set_goal("r1", Goal(x=1.0, y=0.5))
    agents["r1"].report(stamp=there.clock.now())
    assert await runs("dubins") == [1.0, 0.5, None]
    await there.agents("r1")  # started anew
    assert await runs("dubins") is None


@virtual
async def test_a_lease_that_has_lapsed_is_held_by_nobody(there: Lab) -> None:
    """Also when there is no base station that says so."""
    base = await there.join(Role.BASESTATION)
    watch = FleetWatch(there.operator, LAB)
    lease = Lease(program="his own", operator="bob@laptop", epoch=7, names=("r1",), since=1.7e9, left=3.0)
    base.publisher(channels.LEASE).put(LeaseState(leases=(lease,)))
    await asyncio.sleep(0.5)
    assert [one["names"] for one in state(watch)["lease"]] == [["r1"]]
    await asyncio.sleep(3.0)
    found = state(watch)
    assert found["lease"] == []
    held = [text[:19] for *_, text in found["events"] if "held" in text]
    assert held == ["robots are held by ", "no longer held by h"]


@virtual
async def test_a_picture_has_the_time_of_the_server(there: Lab) -> None:
    scenario = parse_scenario({"robots": 1, "camera": {"north": {"width": 64, "height": 48}}}, "lab.toml", name="lab")
    sent: list[dict[str, Any]] = []
    pictures = Pictures(
        there.operator,
        scenario,
        0.15,
        lambda: {"north"},
        lambda camera, packed: sent.append(msgpack.unpackb(packed)),
        InlineExecutor(),
    )
    frame = Frame(stamp=50.0, width=64, height=48, format="grey", data=bytes(64 * 48))

    class Inbox:
        def get(self) -> Received[Frame]:
            return Received("north", frame, 100.01, 0.0, 50.01, 50.0)

    pictures._inboxes["north"] = Inbox()  # type: ignore[assignment]
    await pictures._show("north")
    assert [picture["t"] for picture in sent] == [100.0]


@virtual
async def test_a_page_that_cannot_be_started_is_started_later(there: Lab) -> None:
    outcomes = [BlockingIOError(11, "no process is free"), 1, WRONG_USE]
    began: list[float] = []

    async def starts(*_: object) -> int:
        outcome = outcomes[len(began)]
        began.append(there.clock.now())
        if isinstance(outcome, OSError):
            raise outcome
        return outcome

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(child, "_run", starts)
        await child.keep_page(("true",))
    assert [round(at - began[0], 3) for at in began] == [0.0, 1.0, 3.0]


@virtual
async def test_what_goes_wrong_with_an_order_is_not_taken_for_a_client_that_is_gone(there: Lab) -> None:
    class Socket:
        async def receive(self) -> dict[str, Any]:
            return {"type": "websocket.receive", "bytes": b"x"}

        async def send_bytes(self, data: bytes) -> None:
            raise RuntimeError("it is gone")

    class Taker:
        left = 0

        def take(self, client: Client, data: bytes) -> None:
            raise RuntimeError("a mistake of ours")

        def leave(self, client: Client) -> None:
            self.left += 1

    taker = Taker()
    client = Client(Socket(), Right.STEER, Frames(), b"hello")  # type: ignore[arg-type]
    with pytest.raises(RuntimeError, match="a mistake of ours"):
        await client.serve(taker)
    assert taker.left == 1
