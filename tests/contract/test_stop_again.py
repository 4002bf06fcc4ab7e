"""Stops over Zenoh: each of many presses reaches the robots at once, and one over a cut link when it is back."""

from __future__ import annotations

import asyncio
import contextlib
import random

import pytest

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import BusSettings
from muro_zenoh.messages import Reply
from muro_zenoh.orders.stop import send_stop, stop_robots
from muro_zenoh.supervision.relay import GOOD, Conditions, Passage, Relay
from muro_zenoh.transport import open_bus
from tests.support.router import router
from tests.support.waiting import within


async def test_every_press_arrives() -> None:
    """Each is sent by a writer that is gone in a moment, and readers ask every new writer of a kept channel for its
    last value: none of them waits for the answer of one that is not there any more."""
    rng = random.Random(3)
    with router() as there:
        async with (
            open_bus(there.settings(), Role.OPERATOR) as operator,
            open_bus(there.settings(), Role.BASESTATION) as station,
            open_bus(there.settings(), Role.AGENT) as robot,
        ):
            stops = robot.every(channels.STOP)
            kept = station.publisher(channels.STOP)  # as in a lab: somebody is asked for it
            await asyncio.sleep(0.3)
            for number in range(40):
                stops.drain()
                name = f"r{number}"
                send_stop(operator, (name,))
                pressed = asyncio.create_task(stop_robots(operator, (name,)))

                async def arrived(name: str = name) -> None:
                    while name not in (await stops.next()).message.names:
                        pass

                await within(1.0, arrived(), f"press {number}")
                await asyncio.sleep(rng.uniform(0.0, 0.06))
                pressed.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await pressed
            kept.close()


@pytest.mark.parametrize("passage", [Passage.STALLED, Passage.PARTITIONED])
async def test_a_stop_over_a_cut_link_arrives_when_the_link_is_back(passage: Passage) -> None:
    """The operator's own, which is down for longer than a stop is repeated on a good one."""
    with router() as there:
        async with (
            Relay() as relay,
            open_bus(there.settings(), Role.BASESTATION) as station,
            open_bus(there.settings(), Role.AGENT) as robot,
        ):
            host, port = there.endpoint.removeprefix("tcp/").split(":")
            relay.lead_to(host, int(port))
            station.answer(channels.STOP_ORDER, lambda order: Reply(accepted=True))
            stops = robot.every(channels.STOP)
            async with open_bus(BusSettings(connect=(relay.endpoint,)), Role.OPERATOR) as operator:
                await asyncio.sleep(0.3)
                down = Conditions(passage=passage)
                relay.set(down, down)
                pressed = asyncio.create_task(stop_robots(operator, ("r1",)))
                await asyncio.sleep(1.0)
                assert not stops.drain()
                relay.set(GOOD, GOOD)
                assert (await within(3, stops.next(), "the stop")).message.names == ("r1",)
                assert (await pressed).reply is not None
