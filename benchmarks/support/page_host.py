"""A process with a timer of 5 ms, and with the page in a thread, or without: how late the timer is.

python -m benchmarks.support.page_host thread|process|none LAB ENDPOINT PORT TOKENS SETTLED SECONDS
"""

from __future__ import annotations

import asyncio
import json
import sys
import threading
from pathlib import Path

import msgspec

from basestation.dashboard.access import Address, tokens_in
from basestation.dashboard.process import run_dashboard
from muro_zenoh.config import find_scenario
from muro_zenoh.runtime.process import worker_threads

_PERIOD = 0.005


async def lateness(settled: float, lasts: float) -> list[float]:
    """How late a timer wakes, again and again [s].

    Args:
        settled: how long to wait before [s].
        lasts: how long to measure [s].
    """
    await asyncio.sleep(settled)
    loop, found = asyncio.get_running_loop(), []
    end = loop.time() + lasts
    while (due := loop.time() + _PERIOD) < end:
        await asyncio.sleep(_PERIOD)
        found.append(loop.time() - due)
    return sorted(found)


def main() -> None:
    where, file, endpoint, port, tokens, settled, lasts = sys.argv[1:]
    with worker_threads(1, "vision"):  # as in a base station: it sets how soon a thread gives way
        if where == "thread":
            scenario = find_scenario(file)
            scenario = msgspec.structs.replace(
                scenario, bus=msgspec.structs.replace(scenario.bus, connect=(endpoint,), mode="client")
            )
            page = run_dashboard(scenario, Address("127.0.0.1", int(port)), tokens_in(Path(tokens)))
            threading.Thread(target=lambda: asyncio.run(page), daemon=True).start()
        late = asyncio.run(lateness(float(settled) + 1.0, float(lasts)))
    rows = {"late_p50_ms": late[len(late) // 2], "late_p99_ms": late[int(0.99 * len(late))], "late_max_ms": late[-1]}
    print(json.dumps({key: round(1e3 * value, 3) for key, value in rows.items()}), flush=True)
    import os

    os._exit(0)  # the thread's loop serves until it is cancelled


if __name__ == "__main__":
    main()
