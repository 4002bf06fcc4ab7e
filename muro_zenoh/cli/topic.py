"""``muro topic list|echo|hz``: look at any key of the bus."""

from __future__ import annotations

import asyncio
import itertools
import json
import math
import re
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any

import click

from muro_zenoh.cli.options import MuroGroup, bus_options, example
from muro_zenoh.cli.orders import on_bus
from muro_zenoh.errors import ConfigError

if TYPE_CHECKING:
    from muro_zenoh.config import BusSettings
    from muro_zenoh.transport import Bus, Sample

BusFlags = Callable[..., "BusSettings"]

_CHUNK = re.compile(r"\*\*|\*|([^*$#?/]|\$\*)+")
_RAW_SHOWN = 32


def full_key(expression: str, realm: str) -> str:
    """The key expression that is meant: within the realm, unless it begins with the realm, ``**`` or ``/``.

    Args:
        expression: what was typed.
        realm: the first word of our keys.

    Raises:
        ConfigError: it is no Zenoh key expression.
    """
    if expression.startswith("/"):
        full = expression[1:]
    elif expression.split("/")[0] == "**" or expression == realm or expression.startswith(f"{realm}/"):
        full = expression
    else:
        full = f"{realm}/{expression}"
    if not all(_CHUNK.fullmatch(chunk) for chunk in full.split("/")):
        raise ConfigError(
            "KEY", got=repr(expression), expected="words joined by '/', * for any word and ** for any words"
        )
    return full


def type_of(encoding: str | None) -> str:
    """What a writer calls its payload: the message type when it says one, else the encoding.

    Args:
        encoding: as Zenoh has it.
    """
    base, _, schema = (encoding or "").partition(";")
    return schema or base or "-"


def shown(payload: bytes, encoding: str | None) -> str:
    """A payload for people to read: MessagePack as JSON, text as it is, else so many raw bytes.

    Args:
        payload: the bytes.
        encoding: what the writer calls them.
    """
    import msgpack  # type: ignore[import-untyped]  # it publishes no types

    base = (encoding or "").partition(";")[0]
    if base.startswith("text/") or base == "application/json":
        return payload.decode(errors="replace")
    try:
        value = msgpack.unpackb(payload, raw=False, strict_map_key=False)
        # Almost any byte is a MessagePack number: only a writer who says so is believed, or a map.
        if base == "application/msgpack" or isinstance(value, dict):
            return json.dumps(value, default=_beyond_json, ensure_ascii=False)
    except (ValueError, TypeError, msgpack.UnpackException):
        pass
    more = "..." if len(payload) > _RAW_SHOWN else ""
    return f"<{len(payload)} raw bytes, encoding {base or 'not said'}: {payload[:_RAW_SHOWN].hex(' ')}{more}>"


def _beyond_json(value: object) -> str:
    return f"<{len(value)} bytes>" if isinstance(value, bytes) else repr(value)


@click.group(cls=MuroGroup, epilog=example("muro topic list", "muro topic echo pose/r1", "muro topic hz 'cmd_vel/*'"))
def topic() -> None:
    """Look at what goes over the bus."""


def _look(main: Callable[[Bus], Coroutine[Any, Any, int]], settings: BusSettings) -> None:
    """Run a command that prints until it is interrupted, or nobody reads any more."""

    async def run(bus: Bus) -> int:
        try:
            return await main(bus)
        except BrokenPipeError:
            import os
            import sys

            # What is still in the buffer has no reader either.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0

    on_bus(run, settings)


_FOR = click.FloatRange(min=0, min_open=True)


@topic.command("list", epilog=example("muro topic list", "muro topic list --for 5"))
@click.option("--for", "seconds", type=_FOR, default=2.0, show_default=True, metavar="S", help="How long to listen.")
@bus_options
def list_topics(seconds: float, bus: BusFlags) -> None:
    """List the keys that are written to, with their rates and types."""

    async def main(b: Bus) -> int:
        counts: Counter[str] = Counter()
        sizes: Counter[str] = Counter()
        types: dict[str, str] = {}

        def note(sample: Sample) -> None:
            counts[sample.key] += 1
            sizes[sample.key] += len(sample.payload)
            types[sample.key] = type_of(sample.encoding)

        await _listen(b, f"{b.realm}/**", note, seconds)
        width = max((len(key) for key in counts), default=0)
        for key in sorted(counts):
            rate, size = counts[key] / seconds, sizes[key] / counts[key]
            click.echo(f"{key:{width}}  {rate:7.1f} Hz  {size:8.0f} B  {types[key]}")
        if not counts:
            click.echo(f"nothing was written on {b.realm}/** within {seconds:g} s")
        return 0

    _look(main, bus())


@topic.command(
    epilog=example("muro topic echo pose/r1", "muro topic echo 'health/*' --count 5", "muro topic echo /rt/odom")
)
@click.argument("key")
@click.option("--count", type=click.IntRange(min=1), metavar="N", help="Leave after so many.")
@click.option("--for", "seconds", type=_FOR, metavar="S", help="Leave after so long.")
@bus_options
def echo(key: str, count: int | None, seconds: float | None, bus: BusFlags) -> None:
    """Print what is written on KEY.

    A KEY is within the realm (pose/r1 is muro/pose/r1) unless it begins with the realm or with a slash. * stands for
    any word, ** for any words.
    """
    settings = bus()
    expression = full_key(key, settings.realm)

    async def main(b: Bus) -> int:
        left = count if count is not None else math.inf

        def say(sample: Sample) -> bool:
            nonlocal left
            click.echo(f"{sample.key} {shown(sample.payload, sample.encoding)}")
            left -= 1
            return left <= 0

        await _listen(b, expression, say, seconds)
        return 0

    _look(main, settings)


@topic.command(epilog=example("muro topic hz pose/r1", "muro topic hz 'cmd_vel/*' --for 10"))
@click.argument("key")
@click.option("--for", "seconds", type=_FOR, metavar="S", help="Leave after so long.")
@bus_options
def hz(key: str, seconds: float | None, bus: BusFlags) -> None:
    """Print once a second how often KEY is written to, and the shortest and longest wait between two messages."""
    settings = bus()
    expression = full_key(key, settings.realm)

    async def main(b: Bus) -> int:
        arrivals: defaultdict[str, list[float]] = defaultdict(list)

        async def report() -> None:
            while True:
                await asyncio.sleep(1.0)
                _print_rates(arrivals)

        reporting = asyncio.create_task(report())
        try:
            await _listen(b, expression, lambda s: arrivals[s.key].append(s.arrival), seconds, reporting)
        finally:
            reporting.cancel()
        return 0

    _look(main, settings)


def _print_rates(arrivals: dict[str, list[float]]) -> None:
    """Print the rate of each key, and forget all but its newest arrival."""
    stamp = time.strftime("%H:%M:%S")
    for key in sorted(arrivals):
        times = arrivals[key]
        waits = [b - a for a, b in itertools.pairwise(times)]
        if waits:
            rate = len(waits) / (times[-1] - times[0]) if times[-1] > times[0] else math.inf
            least, most = 1e3 * min(waits), 1e3 * max(waits)
            click.echo(f"{stamp} {key}  {rate:.1f} Hz  {len(waits)} new, waits {least:.1f} to {most:.1f} ms")
            del times[:-1]
        else:
            click.echo(f"{stamp} {key}  nothing new")


async def _listen(
    bus: Bus,
    expression: str,
    take: Callable[[Sample], bool | None],
    seconds: float | None,
    beside: asyncio.Task[None] | None = None,
) -> None:
    """Hand over samples until ``take`` returns true, the time is over, or a task beside fails."""
    tap = bus.tap(expression)

    async def listen() -> None:
        async for sample in tap:
            if take(sample):
                return

    listening = asyncio.create_task(listen())
    tasks = {listening, beside} if beside is not None else {listening}
    try:
        done, _ = await asyncio.wait(tasks, timeout=seconds, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            await task
    finally:
        listening.cancel()
        tap.close()
