"""Who is alive, by the liveliness tokens of processes."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Set

from muro_zenoh.errors import NoReply, TransportError
from muro_zenoh.transport.link import call_on
from muro_zenoh.transport.tap import Waiting


class Roster(Waiting):
    """Who is alive: a set of (role, name), kept up to date by liveliness tokens.

    It fills as the news comes in: until :meth:`complete` has been awaited, somebody who is not in it may be alive.

    Args:
        loop: where its tasks run.
        watch: the tokens.
        hear_all: waits for at most a time [s] until the watch has been told of every token; returns whether it has.
    """

    def __init__(
        self, loop: asyncio.AbstractEventLoop, watch: TokenWatch, hear_all: Callable[[float], Awaitable[bool]]
    ) -> None:
        super().__init__(loop)
        self._watch = watch
        self._hear_all = hear_all
        watch.rosters.append(self)
        self.on_close(lambda: watch.rosters.remove(self))

    @property
    def alive(self) -> Set[tuple[str, str]]:
        """Role and name of everybody; it changes with time."""
        return self._watch.alive

    def of(self, role: str) -> set[str]:
        """The names that are alive in a role."""
        return {name for r, name in self.alive if r == role}

    async def complete(self, *, timeout: float = 2.0) -> None:
        """Wait until everybody is in it whom the router knows to be alive. Peers without a router may know of more.

        Args:
            timeout: how long at most [s].

        Raises:
            NoReply: the router did not say so in time, or there is none.
            TransportError: the roster or the bus was closed.
        """
        told = not self._closed and await self._hear_all(timeout)
        if self._closed:
            raise TransportError("the bus was closed while a task waited on it")
        if not told:
            raise NoReply(
                f"who is alive is not known: the router did not say (waited at most {timeout:g} s). "
                "Is it running, and its computer reachable?"
            )

    async def changed(self) -> None:
        """Wait until somebody comes or goes; those who were there when the roster was opened may not count."""
        await self._wait()

    async def until(self, condition: Callable[[Roster], bool]) -> None:
        """Wait until a condition on this roster holds."""
        while not condition(self):
            await self._wait()


class TokenWatch:
    """The liveliness tokens of a realm, watched once for all rosters of a bus: a session of Zenoh that undeclares its
    subscriber and declares it again misses some (decision 4).

    Attributes:
        alive: role and name of everybody.
        rosters: those that are open.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, parse: Callable[[str], tuple[str, str]]) -> None:
        self.alive: set[tuple[str, str]] = set()
        self.rosters: list[Roster] = []
        self._loop = loop
        self._parse = parse

    def file(self, key: str, there: bool) -> None:
        """Take a token's coming or going from the middleware; from any thread."""
        call_on(self._loop, self._note, key, there)

    def _note(self, key: str, there: bool) -> None:
        who = self._parse(key)
        if there:
            self.alive.add(who)
        else:
            self.alive.discard(who)
        for roster in self.rosters:
            roster._notify()
