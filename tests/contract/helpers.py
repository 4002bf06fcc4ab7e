"""What the tests of the bus share."""

from __future__ import annotations

import asyncio
import itertools
import time
from collections.abc import Callable
from typing import TypeVar

import msgpack

from muro_zenoh import channels
from muro_zenoh.errors import NoReply
from muro_zenoh.messages import (
    Message,
    Odometry,
    Reply,
    SetCircle,
    SpeedReference,
)
from muro_zenoh.transport import Bus, Every, Latest
from tests.support.waiting import given_again, seconds, within

Order = TypeVar("Order", bound=Message)
Box = Latest[SpeedReference] | Every[SpeedReference]


def speed(value: float) -> SpeedReference:
    return SpeedReference(speed=value)


def plain(value: float, **other: object) -> bytes:
    """A SpeedReference as a stranger makes it, who has a MessagePack library and the page of channels."""
    packed: bytes = msgpack.packb({"stamp": time.time(), "speed": value, **other})
    return packed


async def linked(put: Callable[[float], object], *boxes: Box) -> None:
    """Return when what is put arrives in every box, and empties them: a subscription takes time to reach a writer."""
    for box in boxes:
        for probe in itertools.count(1):
            put(-float(probe))
            try:
                async with asyncio.timeout(0.05):
                    await box.next()
                break
            except TimeoutError:
                assert probe < 100 * seconds(1), "no message arrived at all"
        await _until_probe(box, -float(probe))
    for box in boxes:
        if isinstance(box, Every):
            box.drain()


async def _until_probe(box: Box, last: float) -> None:
    newest = box.get() if isinstance(box, Latest) else None
    while newest is None or newest.message.speed != last:
        try:
            newest = await within(0.5, box.next(), "the last probe")
        except AssertionError:
            return  # it was the one that was read already


async def until(condition: Callable[[], bool], what: str) -> None:
    """Wait for what has no event, such as a counter."""
    deadline = time.monotonic() + seconds(5)
    while not condition():
        assert time.monotonic() < deadline, what
        await asyncio.sleep(0.005)


def odometry(x: float) -> Odometry:
    return Odometry(x=x, y=0.0, theta=0.0, v=0.0, omega=0.0)


async def odometry_linked(put: Callable[[Odometry], object], box: Every[Odometry]) -> None:
    for probe in itertools.count(1):
        put(odometry(-float(probe)))
        try:
            async with asyncio.timeout(0.05):
                while (await box.next()).message.x != -float(probe):
                    pass
            return
        except TimeoutError:
            assert probe < 100 * seconds(1), "no message arrived at all"


async def asked(bus: Bus, verb: channels.Verb[Order], order: Order, name: str = "") -> Reply:
    """The answer to an order; given again where its receiver had just stood still, as any process may."""
    return await given_again(lambda: bus.ask(verb, order, name=name, timeout=seconds(5)), lambda reply: reply.reason)


async def answered(bus: Bus) -> None:
    """Return when the base station's answers reach ``bus``."""
    await first_answer(bus, channels.SET_CIRCLE, SetCircle())


async def first_answer(bus: Bus, verb: channels.Verb[Order], order: Order, name: str = "") -> Reply:
    """The answer of one who may not be known at the sender yet."""
    async with asyncio.timeout(seconds(5)):
        while True:
            try:
                return await asked(bus, verb, order, name)
            except NoReply:
                await asyncio.sleep(0.01)
