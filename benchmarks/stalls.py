"""How long a camera's process waits for its network when what receives its pictures stands still.

    python benchmarks/stalls.py [--seconds S] [--json FILE]

A camera publishes pictures of 1280 x 720 at 20 Hz through a router to a receiver; as JPEG of 130 kB, and as raw grey
frames of 921 kB. Meanwhile the receiver, and then the router, is frozen (SIGSTOP) for some seconds. Each row has how
long a put took, in milliseconds: the median before anything receives, while all runs, and while it is frozen, of that
also the 90th percentile; and the longest while frozen, beside the longest before anything receives, which is the
machine's own. A wait for the network makes most puts longer, other processes one now and then: the exit code is 1 when
the 90th percentile is above 5 ms.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median, quantiles

sys.path.insert(0, str(Path(__file__).parents[1]))

from muro_zenoh import channels
from muro_zenoh.channels import ALL_ROLES
from muro_zenoh.config import BusSettings
from muro_zenoh.messages import Frame
from muro_zenoh.transport import Bus, Publisher, open_bus
from tests.support.router import router

LIMIT = 5.0
RATE = 20.0
SIZES = {"jpeg": 130_000, "grey": 1280 * 720}


@dataclass(frozen=True)
class Row:
    """Milliseconds of a put."""

    frozen: str
    picture: str
    alone: float
    running: float
    while_frozen: float
    while_frozen_p90: float
    longest_frozen: float
    longest_alone: float


async def puts(bus: Bus, publisher: Publisher[Frame], picture: str, seconds: float) -> list[float]:
    """Publish at the camera's rate; how long each put took [ms].

    Args:
        bus: the bus.
        publisher: of the frames.
        picture: of :data:`SIZES`.
        seconds: for how long [s].
    """
    took = []
    for _ in range(int(seconds * RATE)):
        frame = Frame(stamp=bus.clock.now(), width=1280, height=720, format=picture, data=os.urandom(SIZES[picture]))  # type: ignore[arg-type]
        begin = time.perf_counter()
        publisher.put(frame)
        took.append(1e3 * (time.perf_counter() - begin))
        await asyncio.sleep(1.0 / RATE)
    return took


async def receive(endpoint: str) -> None:
    """The receiver's process.

    Args:
        endpoint: of the router.
    """
    async with open_bus(BusSettings(connect=(endpoint,)), *ALL_ROLES) as bus:
        print("ready", flush=True)
        async for _ in bus.latest(channels.CAMERA, "north"):
            pass


async def measure(frozen: str, picture: str, seconds: float) -> Row:
    """Publish while something is frozen.

    Args:
        frozen: ``receiver`` or ``router``.
        picture: of :data:`SIZES`.
        seconds: for how long [s].
    """
    with router() as there:
        async with open_bus(there.settings(), *ALL_ROLES) as bus:
            publisher = bus.publisher(channels.CAMERA, "north")
            alone = await puts(bus, publisher, picture, seconds)
            command = (sys.executable, __file__, "--receive", there.endpoint)
            receiver = await asyncio.create_subprocess_exec(*command, stdout=subprocess.PIPE)
            try:
                assert receiver.stdout is not None
                await receiver.stdout.readline()
                before = await puts(bus, publisher, picture, seconds)
                stop = receiver.send_signal if frozen == "receiver" else there.process.send
                stop(signal.SIGSTOP)
                during = await puts(bus, publisher, picture, seconds)
                stop(signal.SIGCONT)
            finally:
                receiver.kill()
                await receiver.wait()
    numbers = (median(alone), median(before), median(during), quantiles(during, n=10)[-1], max(during), max(alone))
    return Row(frozen, picture, *(round(number, 2) for number in numbers))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=5.0, help="for how long it is frozen (5)")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    parser.add_argument("--receive", metavar="ENDPOINT", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.receive:
        asyncio.run(receive(given.receive))
        return
    rows = []
    for frozen in ("receiver", "router"):
        for picture in SIZES:
            rows.append(asyncio.run(measure(frozen, picture, given.seconds)))
            print("  ".join(f"{key} {value}" for key, value in asdict(rows[-1]).items()), flush=True)
    if given.json:
        given.json.write_text(json.dumps([asdict(row) for row in rows], indent=2) + "\n")
    sys.exit(any(row.while_frozen_p90 > LIMIT for row in rows))


if __name__ == "__main__":
    main()
