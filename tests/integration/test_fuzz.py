"""Nothing that a stranger sends outlasts him: mutated messages on every key of a running pursuit."""

from __future__ import annotations

import asyncio
import gc
import logging
import os
import sys
import time
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import pytest
import zenoh

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.errors import NoReply
from muro_zenoh.messages import Health, Resume
from muro_zenoh.orders.stop import resume_robots
from muro_zenoh.runtime.virtual_time import run_virtually
from muro_zenoh.scoring.collector import Collector
from muro_zenoh.transport import Bus
from muro_zenoh.transport.memory_link import MemoryLink
from tests.support.fleet import real_fleet
from tests.support.fleet import stranger as session_of_a_stranger
from tests.support.memory_fleet import MemoryFleet, memory_fleet, scenario
from tests.support.stranger import Stranger
from tests.support.waiting import seconds

log = logging.getLogger(__name__)

ROBOTS = 5
MESSAGES, DURATION = 41_000, 25.0
IN_MEMORY, AT_ONCE = 100_000, 50
SEED = 7
RECOVERY = 3.0
"""After the last bad message and a resume every robot drives again within this time [s]."""


class TestInMemory:
    @pytest.mark.slow
    @pytest.mark.parametrize("seed", range(SEED, SEED + int(os.environ.get("MURO_FUZZ_SEEDS", "1"))))
    def test_a_stranger_is_counted_and_forgotten(self, seed: int) -> None:
        run_virtually(self._fuzz(seed))

    async def _fuzz(self, seed: int) -> None:
        async with memory_fleet(scenario(ROBOTS, "pursuit")) as fleet:
            await fleet.until(lambda: len(fleet.driving) == ROBOTS, 3, "everybody drives")
            observer = await fleet.bus(Role.OPERATOR)
            collector = Collector(observer, fleet.scenario)
            collecting = asyncio.create_task(collector.run())
            stranger = Stranger(seed)
            link = fleet.network.link()
            link.subscribe("muro/**", stranger.hear, encoding="", keep=False)
            asking: set[asyncio.Task[bytes | None]] = set()
            collector.begin()
            await asyncio.sleep(1.5)
            before = _messages(fleet)
            logging.disable()  # pytest would keep every line
            try:
                sent = await self._flood(fleet, link, stranger, asking, IN_MEMORY // 5)  # until every buffer is full
                assert not collecting.done(), collecting.exception()
                collecting.cancel()  # it keeps what it receives, as it should
                await asyncio.wait({collecting})
                await observer.close()
                blocks = await self._memory()
                sent += await self._flood(fleet, link, stranger, asking, IN_MEMORY - sent)
                leaked = await self._memory() - blocks
            finally:
                logging.disable(logging.NOTSET)

            await self._recovers(fleet)
            assert not asking
            received, rejected = (after - b for after, b in zip(_messages(fleet), before, strict=True))
            log.info("seed %d: sent %d, rejected %d of %d, %s", seed, sent, rejected, received, dict(stranger.made))
            log.info("%d blocks of memory more after %d messages; %s", leaked, sent, dict(stranger.sent))
            assert sent == IN_MEMORY
            assert rejected > 0.2 * sent
            every = {channel.word for channel in channels.CHANNELS} | {f"order {verb.word}" for verb in channels.VERBS}
            assert set(stranger.sent) == every
            assert min(stranger.sent.values()) > 0.001 * sent
            assert leaked < 0.1 * sent, "less than one block for ten messages: none is kept"

    async def _flood(
        self,
        fleet: MemoryFleet,
        link: MemoryLink,
        stranger: Stranger,
        asking: set[asyncio.Task[bytes | None]],
        messages: int,
    ) -> int:
        sent = 0
        while sent < messages:
            for _ in range(AT_ONCE):
                message = stranger.next()
                sent += 1
                if message.is_order:
                    question = link.ask(message.key, message.payload, message.encoding or "", 1.0)
                    asked = asyncio.create_task(question)
                    asking.add(asked)
                    asked.add_done_callback(asking.discard)
                else:
                    fleet.network.put(message.key, message.payload, message.encoding, sender=link)
            await asyncio.sleep(0.01)
            assert not fleet.ends, "a process has ended by itself"
        return sent

    async def _memory(self) -> int:
        """The blocks of memory in use, when what was sent has been dealt with."""
        await asyncio.sleep(3.0)
        gc.collect()
        return sys.getallocatedblocks()

    async def _recovers(self, fleet: MemoryFleet) -> None:
        await fleet.order(channels.RESUME, Resume(revision=fleet.kept.stop.revision))
        moved = set()

        def driving() -> bool:
            moved.update(name for name in fleet.scenario.robots if fleet.speed(name) > 0.02)
            return len(fleet.driving) == ROBOTS and len(moved) == ROBOTS

        took = await fleet.until(driving, RECOVERY, "every robot drives again")
        log.info("recovered in %.2f s", took)

        travelled = dict.fromkeys(fleet.scenario.robots, 0.0)
        for _ in range(200):
            await asyncio.sleep(0.1)
            for name in travelled:
                travelled[name] += 0.1 * fleet.speed(name)
        assert min(travelled.values()) > 2.0, f"in 20 s they went on at 0.2 m/s, more or less: {travelled}"


def _messages(fleet: MemoryFleet) -> tuple[int, int]:
    """Received and rejected, by the newest health numbers of everybody."""
    return _totals(received.message for received in fleet._healths.values().values())


def _totals(healths: Iterable[Health]) -> tuple[int, int]:
    totals: Counter[str] = Counter()
    for health in healths:
        for key, value in health.numbers.items():
            totals[key.rpartition("_")[2]] += int(value)
    return totals["received"], totals["rejected"]


@pytest.mark.slow
async def test_a_stranger_is_counted_and_forgotten_over_zenoh(tmp_path: Path) -> None:
    """Real processes: router, simulator, base station with its camera, five agents."""
    async with real_fleet(tmp_path, robots=ROBOTS) as fleet:
        await fleet.until(fleet.driving, 10, "everybody drives")
        pids = {name: process.pid for name, process in fleet.process.items()}
        stranger, sent = Stranger(SEED), 0
        session = session_of_a_stranger(fleet.endpoint)
        try:
            session.declare_subscriber(
                "muro/**",
                zenoh.handlers.Callback(
                    lambda sample: stranger.hear(str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding)),
                    indirect=False,
                ),
                allowed_origin=zenoh.Locality.REMOTE,
            )
            await asyncio.sleep(2.0)
            began = time.monotonic()
            while sent < MESSAGES:
                due = min(int((time.monotonic() - began) * MESSAGES / DURATION), MESSAGES)
                for _ in range(due - sent):
                    message = stranger.next()
                    content = {"payload": message.payload, "encoding": message.encoding}
                    if message.is_order:
                        session.get(message.key, _ignore, **content, timeout=1.0)
                    else:
                        session.put(message.key, **content)
                sent = due
                await asyncio.sleep(0.005)
        finally:
            session.close()
        received, rejected = _totals(fleet.health.values())

        # On a busy machine the base station is not through with the flood when it ends.
        async with asyncio.timeout(seconds(15)):
            while not await _resumed(fleet.bus):  # noqa: ASYNC110 - an order, and not an event
                await asyncio.sleep(0.1)
        since = time.monotonic()
        await fleet.until(fleet.driving, RECOVERY, "every robot drives again")
        took = time.monotonic() - since
        log.info("sent %d, rejected %d of %d; drove again after %.2f s", sent, rejected, received, took)
        assert {name: process.pid for name, process in fleet.process.items()} == pids
        assert all(process.running for process in fleet.process.values())
        assert rejected > 0.2 * sent
        await fleet.ring(limit=60.0)


async def _resumed(bus: Bus) -> bool:
    with suppress(NoReply):
        return (await resume_robots(bus, ())).reply.accepted
    return False


def _ignore(reply: object) -> None:
    """Replies to a stranger's orders."""
