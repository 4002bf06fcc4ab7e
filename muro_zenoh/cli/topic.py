"""``muro topic list|echo|hz``: look at any key of the bus."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any

import click

from muro_zenoh.cli.group import MuroGroup
from muro_zenoh.cli.options import BusFlags, bus_options, example
from muro_zenoh.cli.orders import on_bus

if TYPE_CHECKING:
    from muro_zenoh.config import BusSettings
    from muro_zenoh.transport import Bus, Sample


@click.group(cls=MuroGroup, epilog=example("muro topic list", "muro topic echo pose/r1", "muro topic hz 'cmd_vel/*'"))
def topic() -> None:
    """Look at the messages on the bus."""


def _listen(main: Callable[[Bus], Coroutine[Any, Any, int]], settings: BusSettings) -> None:
    """Run a command that prints until it is interrupted, or its output is closed."""

    async def run(bus: Bus) -> int:
        try:
            return await main(bus)
        except BrokenPipeError:
            import os
            import sys

            # The buffered output has no reader either.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0

    on_bus(run, settings)


_FOR = click.FloatRange(min=0, min_open=True)


@topic.command("list", epilog=example("muro topic list", "muro topic list --for 5"))
@click.option(
    "--for", "seconds", type=_FOR, default=2.0, show_default=True, metavar="S", help="How long to listen [s]."
)
@bus_options
def list_topics(seconds: float, bus: BusFlags) -> None:
    """List the keys with traffic, with rate, size and type."""
    from muro_zenoh.cli.listen import listen_to
    from muro_zenoh.cli.payloads import type_of

    async def main(b: Bus) -> int:
        counts: Counter[str] = Counter()
        sizes: Counter[str] = Counter()
        types: dict[str, str] = {}

        def note(sample: Sample) -> None:
            counts[sample.key] += 1
            sizes[sample.key] += len(sample.payload)
            types[sample.key] = type_of(sample.encoding)

        await listen_to(b, f"{b.realm}/**", note, seconds)
        width = max((len(key) for key in counts), default=0)
        for key in sorted(counts):
            rate, size = counts[key] / seconds, sizes[key] / counts[key]
            click.echo(f"{key:{width}}  {rate:7.1f} Hz  {size:8.0f} B  {types[key]}")
        if not counts:
            click.echo(f"no message on {b.realm}/** within {seconds:g} s")
        return 0

    _listen(main, bus())


@topic.command(
    epilog=example("muro topic echo pose/r1", "muro topic echo 'health/*' --count 5", "muro topic echo /rt/odom")
)
@click.argument("key")
@click.option("--count", type=click.IntRange(min=1), metavar="N", help="Exit after this many messages.")
@click.option("--for", "seconds", type=_FOR, metavar="S", help="Exit after this time.")
@bus_options
def echo(key: str, count: int | None, seconds: float | None, bus: BusFlags) -> None:
    """Print the messages on KEY, beginning with the stored value of a kept channel (such as stop or circle).

    A KEY is within the realm (pose/r1 is muro/pose/r1) unless it begins with the realm or with a slash. * matches any
    word, ** any words.
    """
    from muro_zenoh.cli.listen import listen_to
    from muro_zenoh.cli.payloads import full_key, shown

    settings = bus()
    expression = full_key(key, settings.realm)

    async def main(b: Bus) -> int:
        left = count if count is not None else math.inf

        received = False

        def print_sample(sample: Sample) -> bool:
            nonlocal left, received
            received = True
            click.echo(f"{sample.key} {shown(sample.payload, sample.encoding)}")
            left -= 1
            return left <= 0

        await listen_to(b, expression, print_sample, seconds, keep=True)
        if not received:
            click.echo(f"no message on {expression}", err=True)
            return 1
        return 0

    _listen(main, settings)


@topic.command(epilog=example("muro topic hz pose/r1", "muro topic hz 'cmd_vel/*' --for 10"))
@click.argument("key")
@click.option("--for", "seconds", type=_FOR, metavar="S", help="Exit after this time.")
@bus_options
def hz(key: str, seconds: float | None, bus: BusFlags) -> None:
    """Print the rate of KEY once a second, and the shortest and longest time between two messages."""
    from muro_zenoh.cli.listen import print_rates
    from muro_zenoh.cli.payloads import full_key

    settings = bus()
    expression = full_key(key, settings.realm)

    async def main(b: Bus) -> int:
        return await print_rates(b, expression, seconds)

    _listen(main, settings)
