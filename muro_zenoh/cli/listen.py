"""Samples of any key, and their rates."""

from __future__ import annotations

import asyncio
import itertools
import math
import time
from collections import defaultdict
from collections.abc import Callable

import click

from muro_zenoh.transport import Bus, Sample


async def listen_to(
    bus: Bus,
    expression: str,
    take: Callable[[Sample], bool | None],
    seconds: float | None,
    other: asyncio.Task[None] | None = None,
    *,
    keep: bool = False,
) -> None:
    """Pass samples to ``take`` until it returns true, the time is over, or another task fails.

    Args:
        bus: the bus.
        expression: the key expression.
        take: called with each sample; returns true to stop.
        seconds: how long to listen; None for no limit.
        other: a task that runs at the same time.
        keep: begin with the stored values of kept channels.
    """
    tap = bus.tap(expression, keep=keep)

    async def listen() -> None:
        async for sample in tap:
            if take(sample):
                return

    listening = asyncio.create_task(listen())
    tasks = {listening, other} if other is not None else {listening}
    try:
        done, _ = await asyncio.wait(tasks, timeout=seconds, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            await task
    finally:
        listening.cancel()
        tap.close()


async def print_rates(bus: Bus, expression: str, seconds: float | None) -> int:
    """Print the rate of each key once a second; return 1 when nothing was received, otherwise 0.

    Args:
        bus: the bus.
        expression: the key expression.
        seconds: how long to listen; None for no limit.
    """
    arrivals: defaultdict[str, list[float]] = defaultdict(list)

    async def report() -> None:
        while True:
            await asyncio.sleep(1.0)
            if not arrivals:
                click.echo(f"{time.strftime('%H:%M:%S')} {expression}  no message")
            _print_rates(arrivals)

    reporting = asyncio.create_task(report())
    try:
        await listen_to(bus, expression, lambda s: arrivals[s.key].append(s.arrival), seconds, reporting)
    finally:
        reporting.cancel()
    return 0 if arrivals else 1


def _print_rates(arrivals: dict[str, list[float]]) -> None:
    """Print the rate of each key, and keep only its newest arrival."""
    stamp = time.strftime("%H:%M:%S")
    for key in sorted(arrivals):
        times = arrivals[key]
        gaps = [b - a for a, b in itertools.pairwise(times)]
        if gaps:
            rate = len(gaps) / (times[-1] - times[0]) if times[-1] > times[0] else math.inf
            least, most = 1e3 * min(gaps), 1e3 * max(gaps)
            click.echo(f"{stamp} {key}  {rate:.1f} Hz  {len(gaps)} messages, {least:.1f} to {most:.1f} ms apart")
            del times[:-1]
        else:
            click.echo(f"{stamp} {key}  no message")
