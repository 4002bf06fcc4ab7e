"""Prints ``GOT seq stamp age`` for each message of one robot's odometry: ``reader.py ENDPOINT REALM NAME [LEASE]``."""

import sys

from muro_zenoh import channels
from muro_zenoh.config import BusSettings
from muro_zenoh.runtime.process import ready, run_process
from muro_zenoh.transport import open_bus


async def read(endpoint: str, realm: str, name: str, lease: str = "2") -> None:
    settings = BusSettings(realm=realm, connect=(endpoint,), lease=float(lease))
    async with open_bus(settings, channels.Role.BASE) as bus:
        odometry = bus.every(channels.ODOMETRY, name, depth=1024)
        bus.announce(channels.Role.BASE, name)
        ready("reader", name)
        async for got in odometry:
            print(  # noqa: T201 - a line for the test
                "GOT", got.message.seq, got.message.stamp, got.age(bus.clock.now()), flush=True
            )


if __name__ == "__main__":
    sys.exit(run_process(lambda: read(*sys.argv[1:]), "reader"))
