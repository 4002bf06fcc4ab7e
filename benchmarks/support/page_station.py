"""A real base station, of which only the cameras are played: they see a fleet that goes round.

python -m benchmarks.support.page_station ENDPOINT LAB
"""

from __future__ import annotations

import asyncio
import math
import sys
from collections.abc import AsyncIterator, Sequence

from basestation.localization.sightings import Sighting, Sightings
from basestation.station import Station
from muro_zenoh.channels import Role
from muro_zenoh.config import BusSettings, find_scenario
from muro_zenoh.geometry import Pose2
from muro_zenoh.transport import Bus, open_bus

_PERIOD = 0.05
_COVARIANCE = (1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 1e-5)
_RADIUS, _RATE = 4.0, 0.05
"""Of the circle [m], and how fast they go round [rad/s]."""


class PlayedCamera:
    """Sees all robots 20 times a second.

    Args:
        bus: for the time.
        robots: their names.
    """

    def __init__(self, bus: Bus, robots: Sequence[str]) -> None:
        self._bus = bus
        self._robots = robots

    async def __aiter__(self) -> AsyncIterator[Sightings]:
        loop = asyncio.get_running_loop()
        begin, tick = loop.time(), 0
        while True:
            tick += 1
            await asyncio.sleep(begin + tick * _PERIOD - loop.time())
            seen = tuple(
                Sighting(name, self._pose(2.0 * math.pi * k / len(self._robots) + _RATE * tick * _PERIOD), _COVARIANCE)
                for k, name in enumerate(self._robots)
            )
            yield Sightings(camera="played", captured=self._bus.clock.now(), robots=seen)

    @staticmethod
    def _pose(angle: float) -> Pose2:
        return Pose2(
            _RADIUS * math.cos(angle), _RADIUS * math.sin(angle), math.remainder(angle + 1.5708, 2.0 * math.pi)
        )


async def main(endpoint: str, lab: str) -> None:
    scenario = find_scenario(lab)
    async with open_bus(BusSettings(connect=(endpoint,)), Role.BASESTATION) as bus:
        station = Station(bus, scenario, None, [PlayedCamera(bus, scenario.robots)])
        bus.announce(Role.BASESTATION, "basestation")
        print("READY station", flush=True)
        await station.run()


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], sys.argv[2]))
