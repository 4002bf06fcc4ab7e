"""What the Zenoh link asks of Zenoh, as others see it: priorities, puts that never block, lease, cancelled opens."""

from __future__ import annotations

import asyncio
import json
import signal
import threading
from collections.abc import AsyncIterator, Iterator
from typing import Any

import pytest
import pytest_asyncio
import zenoh

from muro_zenoh import channels
from muro_zenoh.channels import ALL_ROLES, Channel, Role
from muro_zenoh.config import BusSettings
from muro_zenoh.errors import NoReply
from muro_zenoh.messages import (
    Calibration,
    Circle,
    Estimate,
    FleetSnapshot,
    Frame,
    Message,
    PoseFix,
    StopOrder,
    VelocityCommand,
)
from muro_zenoh.transport import Bus, open_bus, zenoh_link
from tests.contract.conftest import stranger
from tests.support.process import CHILDREN, Process
from tests.support.router import Router, router
from tests.support.waiting import within

COVARIANCE = (1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 1e-5)
SOME: list[tuple[Channel[Any], str, Message, zenoh.Priority]] = [
    (channels.CMD_VEL, "r1", VelocityCommand(v=0.1, omega=0.0), zenoh.Priority.REAL_TIME),
    (channels.STOP, "", StopOrder(all=True), zenoh.Priority.REAL_TIME),
    (
        channels.POSE,
        "r1",
        PoseFix(age=0.0, x=0.0, y=0.0, theta=0.0, covariance=COVARIANCE, camera="north"),
        zenoh.Priority.INTERACTIVE_HIGH,
    ),
    (channels.ALL_POSITIONS, "", FleetSnapshot(robots=()), zenoh.Priority.INTERACTIVE_HIGH),
    (
        channels.ESTIMATE,
        "r1",
        Estimate(x=0.0, y=0.0, theta=0.0, v=0.0, omega=0.0, covariance=COVARIANCE),
        zenoh.Priority.DATA,
    ),
    (channels.CIRCLE, "", Circle(x=0.0, y=0.0, radius=1.0), zenoh.Priority.DATA),
    (channels.CAL_V, "r1", Calibration(value=1.0, sigma=0.1), zenoh.Priority.DATA),
    (channels.CAMERA, "north", Frame(width=1, height=1, format="grey", data=b"0"), zenoh.Priority.BACKGROUND),
]


@pytest_asyncio.fixture
async def bus(shared_router: Router) -> AsyncIterator[Bus]:
    async with open_bus(shared_router.settings("settings"), *ALL_ROLES) as opened:
        yield opened


@pytest.fixture
def session(shared_router: Router) -> Iterator[zenoh.Session]:
    """A stranger's."""
    with stranger(shared_router.endpoint) as opened:
        yield opened


@pytest.mark.parametrize(
    ("channel", "name", "message", "priority"), [pytest.param(*each, id=each[0].word) for each in SOME]
)
async def test_a_message_has_its_channels_priority_and_is_dropped_rather_than_waited_for(
    bus: Bus, session: zenoh.Session, channel: Channel[Any], name: str, message: Message, priority: zenoh.Priority
) -> None:
    loop = asyncio.get_running_loop()
    first: asyncio.Future[zenoh.Sample] = loop.create_future()

    def take(sample: zenoh.Sample) -> None:
        loop.call_soon_threadsafe(lambda: first.done() or first.set_result(sample))

    key = channels.key_of(bus.realm, channel, name)
    subscriber = session.declare_subscriber(key, take)
    publisher = bus.publisher(channel, name)

    async def send() -> None:
        while True:
            publisher.put(message)
            await asyncio.sleep(0.02)

    sending = asyncio.create_task(send())
    try:
        sample = await within(5, first, "a message")
    finally:
        sending.cancel()
        subscriber.undeclare()
    assert sample.priority == priority
    assert sample.congestion_control == zenoh.CongestionControl.DROP
    assert not sample.express  # with it, messages of thirty robots were lost through a router


@pytest.mark.parametrize(("lease", "milliseconds"), [(2.0, 2000), (0.5, 500)])
def test_the_lease_is_that_of_the_settings(lease: float, milliseconds: int) -> None:
    config = zenoh_link.zenoh_config(BusSettings(lease=lease))
    assert json.loads(config.get_json("transport/link/tx/lease")) == milliseconds
    assert BusSettings().lease == 2.0


def test_a_picture_is_dropped_rather_than_waited_for_when_a_receiver_stalls() -> None:
    """Zenoh's own wait is 50 ms, and its own room one piece of 64 kB (decision 4 has what it costs)."""
    config = zenoh_link.zenoh_config(BusSettings())
    drop = json.loads(config.get_json("transport/link/tx/queue/congestion_control/drop"))
    assert drop["max_wait_before_drop_fragments"] == 1000
    assert json.loads(config.get_json("transport/link/tx/queue/size/background")) * 65536 >= 1280 * 720


async def test_a_mailbox_that_was_closed_asks_later_writers_nothing(shared_router: Router, bus: Bus) -> None:
    """Else each stop of a page's would make every later one slower, until Zenoh's thread waits for itself."""
    asked: list[str] = []

    def note(query: zenoh.Query) -> None:
        asked.append(str(query.selector))
        query.drop()

    for _ in range(20):
        bus.latest(channels.CIRCLE).close()
    box, roster = bus.latest(channels.CIRCLE), bus.roster()
    caches = stranger(shared_router.endpoint)
    caches.declare_queryable(f"{bus.realm}/circle/@adv/**", zenoh.handlers.Callback(note, indirect=False))
    async with open_bus(shared_router.settings(bus.realm), *ALL_ROLES) as writer:
        await writer.roster().complete()  # by then the router has the queryable
        writer.publisher(channels.CIRCLE).put(Circle(x=0.0, y=0.0, radius=0.8))
        await within(5, box.next(), "the value")
        await roster.complete()  # by then the router has all questions
        list(caches.liveliness().get(f"{bus.realm}/none"))  # by then we have them
    caches.close()
    assert len([selector for selector in asked if "/@adv/pub/" in selector]) == 1  # the others: as they were opened


async def test_a_frozen_process_is_missed_once_its_lease_is_over(shared_router: Router, bus: Bus) -> None:
    """Zenoh's own lease is 10 s."""
    roster = bus.roster()
    script = str(CHILDREN / "reader.py")
    with Process([script, shared_router.endpoint, bus.realm, "r1", "0.5"], name="reader") as reader:
        reader.ready()
        await within(5, roster.until(lambda r: r.of("base") == {"r1"}), "the reader")
        reader.send(signal.SIGSTOP)
        async with asyncio.timeout(8.0):  # not scaled: it must be less than Zenoh's own
            await roster.until(lambda r: not r.of("base"))
        reader.send(signal.SIGCONT)


async def test_without_an_answer_of_the_router_nobody_says_who_is_alive() -> None:
    """An empty answer would be taken for an empty floor."""
    with router() as running:
        async with open_bus(running.settings(), *ALL_ROLES) as bus, open_bus(running.settings(), *ALL_ROLES) as agent:
            agent.announce(Role.AGENT, "r1")
            roster = bus.roster()
            await within(5, roster.until(lambda r: bool(r.alive)), "the agent")
            running.process.send(signal.SIGSTOP)
            with pytest.raises(NoReply, match="the router did not say"):
                await roster.complete(timeout=0.2)
            running.process.kill()
            await within(5, roster.until(lambda r: not r.alive), "the end of the link to the router")
            with pytest.raises(NoReply):
                await roster.complete()


async def test_what_a_cancelled_open_opens_later_is_closed(
    shared_router: Router, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[zenoh.Session] = []
    begun, released = threading.Event(), threading.Event()
    really_open = zenoh.open

    def slow(config: zenoh.Config) -> zenoh.Session:
        begun.set()
        assert released.wait(30.0)
        opened.append(really_open(config))
        return opened[-1]

    monkeypatch.setattr(zenoh, "open", slow)

    async def open_and_stay() -> None:
        async with open_bus(shared_router.settings("cancelled"), *ALL_ROLES):
            await asyncio.Event().wait()

    opening = asyncio.create_task(open_and_stay())
    assert await asyncio.to_thread(begun.wait, 10.0)
    opening.cancel()
    await asyncio.sleep(0)
    released.set()
    await within(10, asyncio.wait({opening}), "the end")
    assert opening.cancelled()
    assert [session.is_closed() for session in opened] == [True]
