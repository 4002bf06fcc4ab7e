"""How long a camera's process waits for its network when what receives its pictures stands still.

    python benchmarks/stalls.py [--seconds S] [--json FILE]

A camera publishes pictures of 1280 x 720 at 20 Hz through a router to a receiver; as JPEG of 130 kB, and as raw grey
frames of 921 kB. Meanwhile the receiver, and then the router, is frozen (SIGSTOP) for some seconds. The same process
has a second camera, with a router and a receiver of its own that are never frozen, and they take turns: what the
machine does besides hits both alike.

Each row has how long a put took, in milliseconds: the median while all runs and while it is frozen; then the 90th
percentile and the longest while it is frozen, each beside that of the other camera in the same seconds; and the longest
in which the thread waited for something. In the others it was ready to go on, and the machine ran another process.
(Linux counts both kinds of switches.) The exit code is 1 when a put waited for more than 5 ms, and for longer than any
took of the other camera: that is no fault of the machine.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median, quantiles
from typing import NamedTuple

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
    running: float
    while_frozen: float
    p90: float
    p90_of_other: float
    longest: float
    longest_of_other: float
    longest_wait: float

    @property
    def missed(self) -> bool:
        """Whether it was the network that the camera waited for."""
        return self.longest_wait > max(LIMIT, self.longest_of_other)

    @property
    def verdict(self) -> str:
        """The longest put beside the goal, in words."""
        if self.longest <= LIMIT:
            return f"the longest put took {self.longest:g} ms, of at most {LIMIT:g}"
        waited = f"the thread waited for at most {self.longest_wait:g} ms in one, of at most {LIMIT:g}"
        return f"the longest put took {self.longest:g} ms ({self.longest_of_other:g} of the other camera); {waited}"


class Put(NamedTuple):
    """How long a put took [ms], and whether its thread waited in it."""

    ms: float
    waited: bool


async def puts(bus: Bus, publishers: Sequence[Publisher[Frame]], picture: str, seconds: float) -> list[list[Put]]:
    """Publish at the cameras' rate; how long each put took.

    Args:
        bus: that has the clock.
        publishers: of the cameras' frames.
        picture: of :data:`SIZES`.
        seconds: for how long [s].
    """
    took: list[list[Put]] = [[] for _ in publishers]
    for _ in range(int(seconds * RATE)):
        for publisher, row in zip(publishers, took, strict=True):
            data = os.urandom(SIZES[picture])
            frame = Frame(stamp=bus.clock.now(), width=1280, height=720, format=picture, data=data)  # type: ignore[arg-type]
            waits, begin = resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw, time.perf_counter()
            publisher.put(frame)
            ms = 1e3 * (time.perf_counter() - begin)
            row.append(Put(ms, resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw > waits))
            await asyncio.sleep(0.5 / RATE)
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


@contextlib.asynccontextmanager
async def receiving(endpoint: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """A receiver's process.

    Args:
        endpoint: of the router.
    """
    command = (sys.executable, __file__, "--receive", endpoint)
    receiver = await asyncio.create_subprocess_exec(*command, stdout=subprocess.PIPE)
    try:
        assert receiver.stdout is not None
        await receiver.stdout.readline()
        yield receiver
    finally:
        receiver.kill()
        await receiver.wait()


async def measure(frozen: str, picture: str, seconds: float) -> Row:
    """Publish while something is frozen.

    Args:
        frozen: ``receiver`` or ``router``.
        picture: of :data:`SIZES`.
        seconds: for how long [s].
    """
    with router() as there, router() as beside:
        async with (
            open_bus(there.settings(), *ALL_ROLES) as bus,
            open_bus(beside.settings(), *ALL_ROLES) as other,
            receiving(there.endpoint) as receiver,
            receiving(beside.endpoint),
        ):
            cameras = [each.publisher(channels.CAMERA, "north") for each in (bus, other)]
            (before, _) = await puts(bus, cameras, picture, seconds)
            stop = receiver.send_signal if frozen == "receiver" else there.process.send
            stop(signal.SIGSTOP)
            (during, meanwhile) = await puts(bus, cameras, picture, seconds)
            stop(signal.SIGCONT)
    took, others = [put.ms for put in during], [put.ms for put in meanwhile]
    numbers = (
        *(median(put.ms for put in before), median(took)),
        *(quantiles(took, n=10)[-1], quantiles(others, n=10)[-1], max(took), max(others)),
        max((put.ms for put in during if put.waited), default=0.0),
    )
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
    for row in rows:
        print(f"{'missed' if row.missed else 'met'}: {row.frozen} frozen, {row.picture}: {row.verdict}")
    sys.exit(any(row.missed for row in rows))


if __name__ == "__main__":
    main()
