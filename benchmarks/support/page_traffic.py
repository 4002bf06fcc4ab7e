"""Plays a fleet on a router: all that a page reads of robots and base station, as often as the table of channels says.

python -m benchmarks.support.page_traffic ENDPOINT ROBOTS all|robots
"""

from __future__ import annotations

import asyncio
import math
import sys
from collections.abc import Sequence

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import BusSettings
from muro_zenoh.geometry import Circle as CircleOf
from muro_zenoh.messages import (
    BaseState,
    Behaviour,
    Circle,
    FleetSnapshot,
    Health,
    LeaseState,
    Reply,
    RobotState,
    StopOrder,
    VelocityCommand,
)
from muro_zenoh.transport import Bus, open_bus

_PERIOD = 0.05
_STILL = BaseState(battery=1.0, charging=False, bumper=False, cliff=False, wheel_drop=False, dead_man=False)


async def play(bus: Bus, robots: int, base_station: bool) -> None:
    """Publish until cancelled.

    Args:
        bus: with every role of a fleet.
        robots: how many robots are played.
        base_station: whether the base station is, too; otherwise there is a real one.
    """
    names = [f"r{k + 1}" for k in range(robots)]
    for name in names:
        bus.announce(Role.AGENT, name)
    commands = {n: bus.publisher(channels.CMD_VEL, n) for n in names}
    healths = {n: bus.publisher(channels.HEALTH, n) for n in names}
    bases = {n: bus.publisher(channels.BASE, n) for n in names}
    station = _BaseStation(bus, names) if base_station else None
    loop = asyncio.get_running_loop()
    begin, tick = loop.time(), 0
    while True:
        t, now = tick * _PERIOD, bus.clock.now()
        for k, name in enumerate(names):
            commands[name].put(VelocityCommand(v=0.2 + 0.01 * math.sin(t + k), omega=0.3))
            if (tick + k) % 20 == 0:
                healths[name].put(_health(now, t))
            if (tick + k) % 10 == 0:
                bases[name].put(_STILL)
        if station is not None:
            station.publish(tick)
        tick += 1
        await asyncio.sleep(begin + tick * _PERIOD - loop.time())


class _BaseStation:
    def __init__(self, bus: Bus, names: Sequence[str]) -> None:
        bus.announce(Role.BASESTATION, "basestation")
        bus.answer(channels.STOP_ORDER, lambda order: Reply(accepted=True, revision=1))
        self._names = names
        self._snapshots = bus.publisher(channels.ALL_POSITIONS)
        self._behaviours = {n: bus.publisher(channels.BEHAVIOUR, n) for n in names}
        self._circle = bus.publisher(channels.CIRCLE)
        self._stop = bus.publisher(channels.STOP)
        self._lease = bus.publisher(channels.LEASE)

    def publish(self, tick: int) -> None:
        turned = 0.1 * tick * _PERIOD
        angles = {name: 2.0 * math.pi * k / len(self._names) + turned for k, name in enumerate(self._names)}
        self._snapshots.put(FleetSnapshot(robots=tuple(_robot(name, angle) for name, angle in angles.items())))
        for k, name in enumerate(self._names):
            if (tick + k) % 10 == 0:
                self._behaviours[name].put(Behaviour(behaviour="pursuit", parameters={"cruise": 0.2}, revision=1))
        if tick % 10 == 0:
            self._circle.put(Circle.of(CircleOf(0.0, 0.0, 4.0), 1))
            self._stop.put(StopOrder(all=False, revision=1))
            self._lease.put(LeaseState())


def _robot(name: str, angle: float) -> RobotState:
    c, s = math.cos(angle), math.sin(angle)
    return RobotState(name, 4.0 * c, 4.0 * s, math.remainder(angle + 1.5, 6.2831), 0.2, 0.3, 0.06, "tracking")


def _health(now: float, t: float) -> Health:
    words = ("pose", "odometry", "stop", "circle", "all_positions", "lease", "behaviour")
    numbers = {f"{word}_received": 20.0 * t for word in words} | {f"{word}_age_s": 0.04 for word in words}
    return Health(
        role="agent",
        state="pursuit",
        note="keeps clear of r2",
        numbers={"cpu_s": 0.05 * t, "memory_mb": 45.1, "command_rate_hz": 20.0, **numbers},
        samples={"pose_age_s": (0.06,) * 20, "pose_to_command_s": (0.001,) * 20},
        behaviour_revision=1,
    )


async def main(endpoint: str, robots: int, base_station: bool) -> None:
    roles = (Role.AGENT, Role.BASE, *([Role.BASESTATION] if base_station else []))
    async with open_bus(BusSettings(connect=(endpoint,)), *roles) as bus:
        print("READY traffic", flush=True)
        await play(bus, robots, base_station)


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2]), sys.argv[3] == "all"))
