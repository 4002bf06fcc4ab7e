"""What only real processes can show: freezes, kills, threads and files. Over Zenoh."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from pathlib import Path

import psutil
import pytest
import pytest_asyncio

from muro_zenoh import channels
from muro_zenoh.channels import ALL_ROLES, Role
from muro_zenoh.config import BusSettings
from muro_zenoh.errors import NotConnected, TransportError
from muro_zenoh.messages import Odometry, StopOrder
from muro_zenoh.transport import Bus, open_bus
from tests.contract.conftest import Zenoh
from tests.support.process import CHILDREN, Process
from tests.support.router import Router, free_port, router, router_command
from tests.support.waiting import seconds, within

STALE = channels.ODOMETRY.stale_after or 0.0


@pytest_asyncio.fixture
async def fleet(shared_router: Router) -> AsyncIterator[Zenoh]:
    async with AsyncExitStack() as stack:
        yield Zenoh(stack, shared_router)


async def test_a_frozen_process_finds_its_backlog_stale(shared_router: Router, fleet: Zenoh) -> None:
    bus = await fleet.open()
    out = bus.publisher(channels.ODOMETRY, "r1")

    async def send(count: int) -> float:
        """Messages, 50 a second at most; the stamp of the last one."""
        for _ in range(count):
            out.put(Odometry(x=0.0, y=0.0, theta=0.0, v=0.0, omega=0.0))
            last = bus.clock.now()
            await asyncio.sleep(0.02)
        return last

    async def ages(until: float) -> dict[float, float]:
        """The ages by their stamps at which the messages up to a stamp, and one more, were read."""
        found: dict[float, float] = {}
        while not found or max(found) < until:
            _, _, stamp, age = (await asyncio.to_thread(reader.line, "GOT")).split()
            found[float(stamp)] = float(age)
        return found

    # Its lease is long: the router must keep what is sent, however slow the machine is.
    script = [str(CHILDREN / "reader.py"), shared_router.endpoint, fleet.realm, "r1", "60"]
    with Process(script, name="reader") as reader:
        reader.ready()
        await within(5, bus.roster().until(lambda r: "r1" in r.of("base")), "the reader")
        await send(10)
        reader.line("GOT")
        reader.send(signal.SIGSTOP)
        frozen = bus.clock.now()
        last = await send(60)
        await asyncio.sleep(2 * STALE)
        reader.send(signal.SIGCONT)
        sending = asyncio.create_task(send(100_000))
        try:
            during = {at: age for at, age in (await ages(last)).items() if frozen + 0.05 < at <= last}
            assert len(during) > 50
            assert min(during.values()) > STALE
            async with asyncio.timeout(seconds(5)):  # what comes from now on is as fresh as ever
                while min((await ages(bus.clock.now())).values()) >= STALE:
                    pass
        finally:
            sending.cancel()


async def test_presence_ends_with_the_process_and_not_with_its_lease(shared_router: Router, fleet: Zenoh) -> None:
    bus = await fleet.open()
    roster = bus.roster()
    script = str(CHILDREN / "reader.py")
    with Process([script, shared_router.endpoint, fleet.realm, "r1", "60"], name="reader") as reader:
        reader.ready()
        await within(5, roster.until(lambda r: r.of("base") == {"r1"}), "the reader")
        reader.kill()
        async with asyncio.timeout(30.0):  # half its lease, however slow the machine is
            await roster.until(lambda r: not r.of("base"))


async def test_a_writer_finds_readers_again_after_the_router_came_back() -> None:
    with router() as running:
        settings = running.settings()
        async with open_bus(settings, *ALL_ROLES) as writer, open_bus(settings, *ALL_ROLES) as reader:
            box = reader.latest(channels.ODOMETRY, "r1")
            kept = reader.latest(channels.CIRCLE)
            out = writer.publisher(channels.ODOMETRY, "r1")
            await _flows(writer, out.put, box.next)
            assert kept.get() is None
            running.process.kill()
            successor = Process(router_command(running.endpoint), name="second router")
            with successor:
                successor.ready()
                while box.get() is not None:
                    box.forget("r1")
                await _flows(writer, out.put, box.next)


async def _flows(writer: Bus, put: object, take: object) -> None:
    async def send() -> None:
        while True:
            put(Odometry(x=0.0, y=0.0, theta=0.0, v=0.0, omega=0.0))  # type: ignore[operator]
            await asyncio.sleep(0.02)

    sending = asyncio.create_task(send())
    try:
        await within(10, take(), "a message")  # type: ignore[operator]
    finally:
        sending.cancel()


async def test_opening_and_closing_leaves_no_thread_and_no_file(shared_router: Router) -> None:
    me = psutil.Process()

    async def cycle() -> None:
        async with open_bus(shared_router.settings("cycles"), *ALL_ROLES) as bus:
            bus.every(channels.ODOMETRY, "*")
            bus.publisher(channels.CIRCLE)

    for _ in range(5):
        await cycle()
    threads, files = me.num_threads(), _files()
    for _ in range(50):
        await cycle()
    assert me.num_threads() <= threads + 2
    assert _files() <= files + 2


def _files() -> int:
    """Open files. Not Zenoh's shared memory: each side keeps a small segment of others a while after they left."""
    names = []
    for number in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):
            names.append(number.readlink().as_posix())
    return sum(not name.startswith("/dev/shm/") for name in names)


async def test_no_router_is_reported_with_what_to_do() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with pytest.raises(NotConnected, match=f"{endpoint}.*muro router"):
        await within(8, _open(endpoint), "the refusal")


async def test_an_open_that_finds_no_router_can_be_cancelled() -> None:
    opening = asyncio.create_task(_open(f"tcp/127.0.0.1:{free_port()}"))
    await asyncio.sleep(0.1)
    opening.cancel()
    began = time.monotonic()
    with pytest.raises(asyncio.CancelledError):
        await opening
    assert time.monotonic() - began < seconds(1.0)


async def test_a_taken_port_is_reported(shared_router: Router) -> None:
    settings = BusSettings(mode="router", connect=(), listen=(shared_router.endpoint,))
    with pytest.raises(TransportError, match="Is the port taken"):
        async with open_bus(settings, Role.AGENT):
            pass


async def test_a_refused_configuration_is_reported() -> None:
    with pytest.raises(TransportError, match=r"no-such-file\.json5"):
        async with open_bus(BusSettings(config="no-such-file.json5"), Role.AGENT):
            pass


async def _open(endpoint: str) -> None:
    async with open_bus(BusSettings(connect=(endpoint,)), Role.AGENT):
        pass


async def test_who_opens_and_closes_what_is_kept_does_not_freeze(shared_router: Router, fleet: Zenoh) -> None:
    """``undeclare()`` waited for Zenoh's thread, and that for the GIL: a page stood still with a stop in its hands."""
    bus = await fleet.open()
    out = bus.publisher(channels.STOP)
    script = [str(CHILDREN / "kept.py"), shared_router.endpoint, fleet.realm, "1500"]
    with Process(script, name="kept") as process:
        process.ready()
        done = asyncio.create_task(asyncio.to_thread(process.line, "DONE", 30.0))
        while not done.done():
            out.put(StopOrder(all=False))
            await asyncio.sleep(0.002)
        await done
