"""Plays a fleet on a router: all that a page reads of robots and base station, as often as the table of channels says.

python -m benchmarks.support.page_traffic ENDPOINT ROBOTS
"""

from __future__ import annotations

import asyncio
import math
import sys

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


async def play(bus: Bus, robots: int) -> None:
    """Publish until cancelled.

    Args:
        bus: with every role of a fleet.
        robots: how many robots are played.
    """
    names = [f"r{k + 1}" for k in range(robots)]
    for name in names:
        bus.announce(Role.AGENT, name)
    bus.announce(Role.BASESTATION, "basestation")
    bus.answer(channels.STOP_ORDER, lambda order: Reply(accepted=True, revision=1))
    snapshots, commands = bus.publisher(channels.ALL_POSITIONS), {n: bus.publisher(channels.CMD_VEL, n) for n in names}
    healths = {n: bus.publisher(channels.HEALTH, n) for n in names}
    behaviours = {n: bus.publisher(channels.BEHAVIOUR, n) for n in names}
    bases = {n: bus.publisher(channels.BASE, n) for n in names}
    circle, stop, lease = bus.publisher(channels.CIRCLE), bus.publisher(channels.STOP), bus.publisher(channels.LEASE)
    loop = asyncio.get_running_loop()
    begin, tick = loop.time(), 0
    while True:
        t, now = tick * _PERIOD, bus.clock.now()
        angles = {name: 2.0 * math.pi * k / robots + 0.1 * t for k, name in enumerate(names)}
        snapshots.put(FleetSnapshot(robots=tuple(_robot(name, angle) for name, angle in angles.items())))
        for k, name in enumerate(names):
            commands[name].put(VelocityCommand(v=0.2 + 0.01 * math.sin(t + k), omega=0.3))
            if (tick + k) % 20 == 0:
                healths[name].put(_health(now, t))
            if (tick + k) % 10 == 0:
                behaviours[name].put(Behaviour(behaviour="pursuit", parameters={"cruise": 0.2}, revision=1))
                bases[name].put(_STILL)
        if tick % 10 == 0:
            circle.put(Circle.of(CircleOf(0.0, 0.0, 4.0), 1))
            stop.put(StopOrder(all=False, revision=1))
            lease.put(LeaseState())
        tick += 1
        await asyncio.sleep(begin + tick * _PERIOD - loop.time())


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


async def main(endpoint: str, robots: int) -> None:
    roles = (Role.AGENT, Role.BASESTATION, Role.BASE)
    async with open_bus(BusSettings(connect=(endpoint,)), *roles) as bus:
        print("READY traffic", flush=True)
        await play(bus, robots)


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2])))
