"""Waiting, closing, and cancellation at any await. On the in-memory bus and on Zenoh alike."""

from __future__ import annotations

import asyncio
import functools
import os
import signal
import sys
import time
from asyncio.subprocess import PIPE

import pytest

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.errors import ConfigError, TransportError
from muro_zenoh.messages import (
    Circle,
    Reply,
    SetCircle,
    Stop,
)
from tests.contract.conftest import Network
from tests.contract.helpers import answered, speed
from tests.support.router import router
from tests.support.waiting import seconds, within

# ---- waiting


async def test_two_tasks_at_one_mailbox_is_an_error(network: Network) -> None:
    bus = await network.open()
    box = bus.latest(channels.VELOCITY, "r1")
    first = asyncio.create_task(box.next())
    await asyncio.sleep(0)
    with pytest.raises(TransportError, match="two tasks wait"):
        await box.next()
    bus.publisher(channels.VELOCITY, "r1").put(speed(1.0))
    assert (await within(1, first, "the first waiter")).message.speed == 1.0


@pytest.mark.parametrize("what", ["mailbox", "bus"])
async def test_closing_ends_a_wait(network: Network, what: str) -> None:
    bus = await network.open()
    box = bus.latest(channels.VELOCITY, "r1")
    waiting = asyncio.create_task(box.next())
    await asyncio.sleep(0)
    if what == "mailbox":
        box.close()
    else:
        await bus.close()
    with pytest.raises(TransportError, match="velocity/r1"):
        await within(2, waiting, "the end of the wait")
    with pytest.raises(TransportError, match="closed"):
        await box.next()


async def test_what_is_closed_is_undeclared_once(network: Network) -> None:
    bus = await network.open()
    for declared in (bus.latest(channels.VELOCITY, "r1"), bus.tap(f"{network.realm}/**"), bus.roster()):
        undone: list[str] = []
        declared.on_close(functools.partial(undone.append, "once"))
        assert undone == []
        declared.close()
        declared.close()
        await asyncio.sleep(0)
        assert undone == ["once"]


async def test_closing_ends_the_wait_for_presence_and_samples(network: Network) -> None:
    bus = await network.open()
    roster, tap = bus.roster(), bus.tap(f"{network.realm}/**")

    async def drink() -> None:
        async for _ in tap:
            pass

    async def complete() -> None:
        while True:
            await roster.complete()

    awaited = (roster.until(lambda r: False), roster.changed(), complete(), drink())
    waits = [asyncio.create_task(wait) for wait in awaited]
    await asyncio.sleep(0.01)
    await bus.close()
    for wait in waits:
        with pytest.raises(TransportError, match="closed"):
            await within(2, wait, "the end of the wait")
    with pytest.raises(TransportError, match="closed"):
        await within(2, roster.until(lambda r: False), "the end of a wait that began after closing")
    with pytest.raises(TransportError, match="closed"):
        await roster.complete()


async def test_a_closed_bus_says_so(network: Network) -> None:
    bus = await network.open()
    out = bus.publisher(channels.VELOCITY, "r1")
    await bus.close()
    await bus.close()
    out.put(speed(1.0))  # a task's last word in its finally must not raise
    for use in (
        lambda: bus.publisher(channels.VELOCITY, "r1"),
        lambda: bus.latest(channels.VELOCITY, "r1"),
        lambda: bus.every(channels.VELOCITY, "*"),
        lambda: bus.tap("**"),
        lambda: bus.announce(Role.AGENT, "r1"),
        lambda: bus.roster(),
        lambda: bus.answer(channels.STOP_ORDER, lambda order: Reply(accepted=True)),
    ):
        with pytest.raises(TransportError, match="closed"):
            use()
    with pytest.raises(TransportError, match="closed"):
        await bus.ask(channels.STOP_ORDER, Stop())


async def test_a_hundred_buses_open_and_close(network: Network) -> None:
    for _ in range(100):
        bus = await within(5, network.open(), "opening")
        box = bus.every(channels.VELOCITY, "*")
        out = bus.publisher(channels.CIRCLE)
        bus.announce(Role.AGENT, "r1")
        out.put(Circle(x=0.0, y=0.0, radius=1.0))
        waiting = asyncio.create_task(box.next())
        await asyncio.sleep(0)
        await within(5, bus.close(), "closing")
        with pytest.raises(TransportError):
            await waiting


async def test_names_are_checked(network: Network) -> None:
    bus = await network.open()
    for use in (
        lambda: bus.publisher(channels.VELOCITY, "R1"),
        lambda: bus.publisher(channels.VELOCITY),
        lambda: bus.publisher(channels.VELOCITY, "*"),
        lambda: bus.publisher(channels.CIRCLE, "r1"),
        lambda: bus.latest(channels.VELOCITY, "**"),
        lambda: bus.every(channels.VELOCITY, "r1/x"),
        lambda: bus.announce(Role.AGENT, "R1"),
    ):
        with pytest.raises(ConfigError):
            use()


# ---- cancellation


async def test_a_cancelled_wait_loses_no_message(network: Network) -> None:
    bus = await network.open()
    out = bus.publisher(channels.VELOCITY, "r1")
    box = bus.every(channels.VELOCITY, "r1")
    for i in range(50):
        waiting = asyncio.create_task(box.next())
        await asyncio.sleep(0)
        if i % 2:
            out.put(speed(i))  # the wait is over, and cancelled before it could say so
        waiting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiting
        if not i % 2:
            out.put(speed(i))
        assert (await within(1, box.next(), "the message")).message.speed == i


async def test_a_cancelled_question_is_clean(network: Network) -> None:
    bus, base = await network.open(), await network.open()
    asked = asyncio.Event()

    def handle(order: SetCircle) -> Reply:
        asked.set()
        return Reply(accepted=True)

    base.answer(channels.SET_CIRCLE, handle)
    await answered(bus)
    for _ in range(20):
        asking = asyncio.create_task(bus.ask(channels.SET_CIRCLE, SetCircle(radius=1.0)))
        await asyncio.sleep(0)
        asking.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asking
    assert (await bus.ask(channels.SET_CIRCLE, SetCircle(radius=1.0))).accepted


async def test_closing_goes_through_when_it_is_cancelled(network: Network) -> None:
    bus = await network.open()
    closing = asyncio.create_task(bus.close())
    await asyncio.sleep(0)
    closing.cancel()
    await asyncio.wait([closing], timeout=seconds(5))
    assert closing.done()
    await bus.close()
    with pytest.raises(TransportError, match="closed"):
        bus.latest(channels.CIRCLE)


async def test_a_cancelled_open_leaves_nothing(network: Network) -> None:
    for pause in (0.0, 0.0, 0.001, 0.003, 0.01):
        opening = asyncio.create_task(network.open())
        await asyncio.sleep(pause)
        opening.cancel()
        await asyncio.wait([opening], timeout=seconds(7))
        assert opening.done()


_LEAVING = """
import asyncio, os, signal, sys, time
from muro_zenoh.channels import Role
from muro_zenoh.config import BusSettings
from muro_zenoh.transport import open_bus

async def main():
    async with open_bus(BusSettings(connect=(sys.argv[1],)), Role.OPERATOR) as bus:
        os.kill(int(sys.argv[2]), signal.SIGSTOP)
        end = time.monotonic() + 0.5
        while time.monotonic() < end:  # fills the way to the router, so that the session cannot say goodbye
            bus._link._session.put("lab/x", bytes(20_000))
        print("leaving", flush=True)

asyncio.run(main())
"""


async def test_a_session_that_does_not_close_holds_no_process() -> None:
    with router() as stopped:
        pid = stopped.process.pid
        try:
            script = [sys.executable, "-c", _LEAVING, stopped.endpoint, str(pid)]
            process = await asyncio.create_subprocess_exec(*script, stdout=PIPE, stderr=PIPE)
            assert process.stdout is not None
            await within(20, process.stdout.readline(), "the session full")
            began = time.monotonic()
            _, said = await within(20, process.communicate(), "its end")
            assert time.monotonic() - began < seconds(3.0)  # Zenoh's own close takes ten
            assert process.returncode == 0
            assert b"did not close its session" in said
        finally:
            os.kill(pid, signal.SIGCONT)
