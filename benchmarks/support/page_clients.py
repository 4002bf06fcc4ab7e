"""Clients of a page that read and throw away, in a process of their own; some of them stop reading.

python -m benchmarks.support.page_clients ws://127.0.0.1:8010/ws TOKEN CLIENTS ASLEEP SECONDS
"""

from __future__ import annotations

import asyncio
import json
import sys
from typing import Any

from websockets.asyncio.client import connect


async def main(url: str, token: str, clients: int, asleep: int, lasts: float) -> None:
    """Read for a time, and print how much came.

    Args:
        url: of the page's WebSocket.
        token: to look with.
        clients: how many read.
        asleep: how many more do not.
        lasts: how long [s].
    """
    size, states = 0, 0
    protocols: Any = ["muro", f"token.{token}"]

    async def read() -> None:
        nonlocal size, states
        async with connect(url, subprotocols=protocols, max_size=None, compression=None) as socket:
            await socket.recv()
            await socket.recv()  # the greeting, and the first state, which is whole
            async for data in socket:
                size += len(data)
                states += 1

    async def sleep() -> None:
        async with connect(url, subprotocols=protocols, max_size=None, compression=None, max_queue=1) as socket:
            socket.transport.pause_reading()
            await asyncio.sleep(lasts)

    tasks = [asyncio.create_task(read()) for _ in range(clients)]
    tasks += [asyncio.create_task(sleep()) for _ in range(asleep)]
    print("READY clients", flush=True)
    await asyncio.sleep(lasts)
    found = {"bytes_per_s": size / lasts / max(1, clients), "states_per_s": states / lasts / max(1, clients)}
    print(json.dumps(found), flush=True)
    for task in tasks:
        task.cancel()
    await asyncio.wait(tasks) if tasks else None


if __name__ == "__main__":
    url, token, clients, asleep, lasts = sys.argv[1:]
    asyncio.run(main(url, token, int(clients), int(asleep), float(lasts)))
