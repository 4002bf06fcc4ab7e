"""The two networks that the bus must behave the same on."""

from __future__ import annotations

import contextlib
import uuid
from collections.abc import AsyncIterator, Iterable, Iterator
from contextlib import AsyncExitStack
from typing import Protocol

import pytest
import pytest_asyncio
import zenoh

from muro_zenoh.channels import ALL_ROLES, Role
from muro_zenoh.runtime.clock import Clock
from muro_zenoh.transport import Bus, MemoryNetwork, make_bus, open_bus
from tests.support.leaks import no_task_left, no_thread_or_process_left
from tests.support.router import Router, router

__all__ = ["no_task_left", "no_thread_or_process_left"]


class Network(Protocol):
    """Where the buses of one test meet."""

    realm: str

    async def open(self, clock: Clock | None = None, *, roles: Iterable[Role] = ALL_ROLES) -> Bus:
        """A bus, as a process of its own would have it; closed after the test."""
        ...

    def put(self, key: str, payload: bytes, encoding: str | None = None) -> None:
        """What a stranger puts, who knows nothing of this library."""
        ...


class Memory:
    """The in-memory network."""

    def __init__(self, stack: AsyncExitStack) -> None:
        self.realm = "lab"
        self._network = MemoryNetwork()
        self._stack = stack

    async def open(self, clock: Clock | None = None, *, roles: Iterable[Role] = ALL_ROLES) -> Bus:
        bus = make_bus(self._network.link(), self.realm, roles=roles, clock=clock)
        return await self._stack.enter_async_context(bus)

    def put(self, key: str, payload: bytes, encoding: str | None = None) -> None:
        self._network.put(key, payload, encoding)


class Zenoh:
    """Zenoh through a router process."""

    def __init__(self, stack: AsyncExitStack, through: Router) -> None:
        self.realm = f"t{uuid.uuid4().hex[:12]}"  # the router is shared, its tests are not
        self._router = through
        self._stack = stack
        self._stranger: zenoh.Session | None = None

    async def open(self, clock: Clock | None = None, *, roles: Iterable[Role] = ALL_ROLES) -> Bus:
        bus = open_bus(self._router.settings(self.realm), *roles, clock=clock)
        return await self._stack.enter_async_context(bus)

    def put(self, key: str, payload: bytes, encoding: str | None = None) -> None:
        if self._stranger is None:
            self._stranger = stranger(self._router.endpoint)
            self._stack.callback(self._stranger.close)
        # On a busy machine a large one would else be dropped, before anybody could reject it.
        block = zenoh.CongestionControl.BLOCK
        self._stranger.put(key, payload, encoding=encoding, congestion_control=block)


def stranger(endpoint: str) -> zenoh.Session:
    """A bare Zenoh session."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


@pytest.fixture(scope="session")
def shared_router() -> Iterator[Router]:
    """One router for all tests that only pass through it."""
    with router() as running:
        yield running


@pytest_asyncio.fixture(params=["memory", "zenoh"])
async def network(request: pytest.FixtureRequest, shared_router: Router) -> AsyncIterator[Network]:
    """Each test runs on the in-memory network and on Zenoh."""
    async with contextlib.AsyncExitStack() as stack:
        if request.param == "memory":
            yield Memory(stack)
        else:
            yield Zenoh(stack, shared_router)
