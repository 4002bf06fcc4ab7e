"""The processes that :mod:`benchmarks.latency` measures: a pose comes in, a command goes out.

``echo.py KIND ENDPOINT NAME``: ``callback`` and ``loop`` are bare Zenoh with the sessions' settings of our bus; ``bus``
is our bus. All of them receive odometry and snapshots, as an agent does, and make nothing of them.
"""

from __future__ import annotations

import asyncio
import sys
from collections import deque

import zenoh

from muro_zenoh import channels
from muro_zenoh.channels import key_of
from muro_zenoh.config import BusSettings
from muro_zenoh.messages import VelocityCommand, encoding_of
from muro_zenoh.runtime.process import ready, run_process
from muro_zenoh.transport import open_bus
from muro_zenoh.transport.zenoh_link import zenoh_config


async def callback(settings: BusSettings, name: str) -> None:
    """Bare Zenoh: callback in, put out, on Zenoh's own thread; nothing between."""
    session = zenoh.open(zenoh_config(settings))
    out = _publisher(session, settings, name)
    _subscribe(session, settings, name, lambda sample: out.put(sample.payload.to_bytes()))
    await _forever(session, name)


async def loop(settings: BusSettings, name: str) -> None:
    """Bare Zenoh in an event loop: the callback wakes the loop, the loop puts."""
    session = zenoh.open(zenoh_config(settings))
    out = _publisher(session, settings, name)
    here = asyncio.get_running_loop()
    queue: deque[bytes] = deque()

    def drain() -> None:
        while queue:
            out.put(queue.popleft())

    def file(sample: zenoh.Sample) -> None:
        queue.append(sample.payload.to_bytes())
        if len(queue) == 1:
            here.call_soon_threadsafe(drain)

    _subscribe(session, settings, name, file)
    await _forever(session, name)


async def bus(settings: BusSettings, name: str) -> None:
    """Our bus: decode, mailbox, task, encode."""
    async with open_bus(settings, channels.Role.AGENT) as opened:
        commands = opened.publisher(channels.CMD_VEL, name)
        poses = opened.every(channels.POSE, name)
        odometry = opened.every(channels.ODOMETRY, name)
        snapshots = opened.latest(channels.ALL_POSITIONS)
        ready("bus", name)
        async for pose in poses:
            odometry.drain()
            snapshots.get()
            commands.put(VelocityCommand(v=pose.message.x, omega=pose.message.theta))


def _publisher(session: zenoh.Session, settings: BusSettings, name: str) -> zenoh.Publisher:
    return session.declare_publisher(
        key_of(settings.realm, channels.CMD_VEL, name),
        encoding=encoding_of(VelocityCommand),
        priority=zenoh.Priority.REAL_TIME,
        congestion_control=zenoh.CongestionControl.DROP,
        express=False,
    )


def _subscribe(session: zenoh.Session, settings: BusSettings, name: str, function) -> None:  # type: ignore[no-untyped-def]
    remote = zenoh.Locality.REMOTE
    keys = {
        key_of(settings.realm, channels.POSE, name): function,
        key_of(settings.realm, channels.ODOMETRY, name): lambda sample: None,
        key_of(settings.realm, channels.ALL_POSITIONS): lambda sample: None,
    }
    for key, callback in keys.items():
        session.declare_subscriber(key, zenoh.handlers.Callback(callback, indirect=False), allowed_origin=remote)


async def _forever(session: zenoh.Session, name: str) -> None:
    ready("bare", name)
    try:
        await asyncio.Event().wait()
    finally:
        session.close()


if __name__ == "__main__":
    kind, endpoint, name = sys.argv[1:]
    main = {"callback": callback, "loop": loop, "bus": bus}[kind]
    sys.exit(run_process(lambda: main(BusSettings(connect=(endpoint,)), name), name))
