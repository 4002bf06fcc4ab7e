"""Opens and closes writers and readers of a kept channel, then prints ``DONE``: ``kept.py ENDPOINT REALM CYCLES``."""

import asyncio
import sys
from contextlib import ExitStack, closing

from muro_zenoh import channels
from muro_zenoh.config import BusSettings
from muro_zenoh.messages import StopOrder
from muro_zenoh.runtime.process import ready, run_process
from muro_zenoh.transport import open_bus


async def open_and_close(endpoint: str, realm: str, cycles: str) -> None:
    async with open_bus(BusSettings(realm=realm, connect=(endpoint,)), *channels.ALL_ROLES) as bus:
        standing = bus.latest(channels.STOP)
        ready("kept")
        await standing.next()
        for _ in range(int(cycles)):
            with ExitStack() as stack:
                stack.enter_context(closing(bus.latest(channels.STOP)))
                stack.enter_context(closing(bus.publisher(channels.STOP))).put(StopOrder(all=False))
                await asyncio.sleep(0)
        print("DONE", flush=True)  # noqa: T201 - a line for the test


if __name__ == "__main__":
    sys.exit(run_process(lambda: open_and_close(*sys.argv[1:]), "kept"))
