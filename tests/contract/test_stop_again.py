"""A stop that is pressed again and again over Zenoh: each press reaches the robots at once."""

from __future__ import annotations

import asyncio
import contextlib
import random

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.orders.stop import send_stop, stop_robots
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
