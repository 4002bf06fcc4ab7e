"""What a bus needs of the middleware: the one seam, with a Zenoh side and an in-memory side.

A link carries bytes. It calls back on any thread; the callbacks only file and return.
"""

from __future__ import annotations

import asyncio
import contextlib
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Protocol

from muro_zenoh.channels import Priority

FileSample = Callable[[str, bytes, str | None], None]
"""Takes a key, a payload and what the writer called its encoding."""

FileToken = Callable[[str, bool], None]
"""Takes a token's key, and whether it is there."""


class Closable(Protocol):
    """Something declared on a link."""

    def close(self) -> None:
        """Undeclare it; a second time does nothing."""
        ...


class Declared(ABC):
    """Something declared on a link that tasks wait at, and what is to be done when it is closed."""

    def __init__(self) -> None:
        self._closers: list[Callable[[], None]] = []
        self._closed = False

    def on_close(self, close: Callable[[], None]) -> None:
        """Have ``close`` called when this is closed."""
        self._closers.append(close)

    def close(self) -> None:
        """Undeclare it; a task that waits here gets a :class:`~muro_zenoh.errors.TransportError`. A second time does
        nothing."""
        if self._closed:
            return
        self._closed = True
        for close in self._closers:
            close()
        self._notify()

    @abstractmethod
    def _notify(self) -> None:
        """Wake the task that waits."""


def call_on(loop: asyncio.AbstractEventLoop, function: Callable[..., object], *given: object) -> None:
    """Call a function on a loop, soon, from any thread; a loop that is closed has nobody left who wants it."""
    with contextlib.suppress(RuntimeError):
        loop.call_soon_threadsafe(function, *given)


class LinkPublisher(Closable, Protocol):
    """Sends bytes on one key."""

    def put(self, payload: bytes) -> bool:
        """Send; never blocks, never raises for a link that is closing. Whether the middleware took it."""
        ...


class Question(Protocol):
    """A query that waits for its one answer."""

    @property
    def payload(self) -> bytes:
        """What was asked."""
        ...

    @property
    def encoding(self) -> str | None:
        """What the asker called its encoding."""
        ...

    def reply(self, payload: bytes, encoding: str) -> None:
        """Answer it. Callable from any thread."""
        ...


class Link(Protocol):
    """A connection to the middleware."""

    def publisher(self, key: str, *, encoding: str, priority: Priority, keep: bool) -> LinkPublisher:
        """Declare a writer; ``keep``: late joiners get its last value."""
        ...

    def subscribe(self, key_expr: str, file: FileSample, *, encoding: str, keep: bool) -> Closable:
        """Declare a reader of others' samples, not of this link's own; ``encoding``: what they will mostly have;
        ``keep``: including the values that are kept already, by any writer."""
        ...

    def declare_token(self, key: str) -> Closable:
        """Declare a liveliness token, which disappears with this link."""
        ...

    def watch_tokens(self, key_expr: str, file: FileToken) -> Closable:
        """Hear of tokens: those that are there, and those that come and go."""
        ...

    async def hear_all_tokens(self, key_expr: str, timeout: float) -> bool:
        """Wait until those of this link who watch tokens have been told of all that the router knows of.

        Returns:
            Whether the router said within ``timeout`` [s] that these are all.
        """
        ...

    def answer(self, key: str, file: Callable[[Question], None]) -> Closable:
        """Take questions on a key."""
        ...

    async def ask(self, key: str, payload: bytes, encoding: str, timeout: float) -> bytes | None:
        """The first answer to a question, or None when none came within ``timeout`` [s]."""
        ...

    async def close(self) -> None:
        """Undeclare everything and leave."""
        ...
