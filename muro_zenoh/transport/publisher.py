"""Sending: a message is stamped and numbered, handed over within the process, and encoded for the others."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

import msgspec

from muro_zenoh.messages import Message, encode
from muro_zenoh.runtime.clock import Clock
from muro_zenoh.transport.inbox import Inbox
from muro_zenoh.transport.link import LinkPublisher
from muro_zenoh.transport.received import Counters

T = TypeVar("T", bound=Message)

_set = msgspec.structs.force_setattr


class Publisher(Generic[T]):
    """Sends one channel's messages on one key, to other processes and to this one's own mailboxes.

    Args:
        key: the key.
        link: where it goes to other processes.
        readers: this process's mailboxes of the key; the bus keeps the list up to date.
        clock: for stamps.
        numbering: this process's ``epoch``, and the ``seq`` of each message: all publishers of a key count together.
        counters: shared by all publishers of a channel.
        operator: whose messages these are, where that matters.
    """

    def __init__(
        self,
        key: str,
        link: LinkPublisher,
        readers: list[Inbox[T]],
        clock: Clock,
        numbering: tuple[int, Iterator[int]],
        counters: Counters,
        operator: str,
    ) -> None:
        self._key = key
        self._link = link
        self._readers = readers
        self._now = clock.now
        self._epoch, self._numbers = numbering
        self._counters = counters
        self._operator = operator
        self._closers = [link.close]
        self._closed = False

    def put(self, message: T) -> T:
        """Send a message; it never blocks.

        Args:
            message: its ``seq`` and ``epoch`` are filled in, and its ``stamp`` when it is 0.

        Returns:
            The message as it was sent; once this is closed, the message as it came in, which goes nowhere.
        """
        if self._closed:
            return message
        # A copy that is not checked a second time; the caller's own stays as it is.
        sent: T = message.__copy__()  # type: ignore[attr-defined]  # what copy.copy() calls, by a longer path
        if not message.stamp:
            _set(sent, "stamp", self._now())
        _set(sent, "seq", next(self._numbers))
        _set(sent, "epoch", self._epoch)
        if self._operator:
            _set(sent, "operator", self._operator)
        for inbox in self._readers:
            inbox.hand(self._key, sent)
        if not self._link.put(encode(sent)):
            self._counters.unsent += 1
        return sent

    def close(self) -> None:
        """Undeclare it; a second time does nothing."""
        if not self._closed:
            self._closed = True
            for close in self._closers:
                close()

    def on_close(self, close: Callable[[], None]) -> None:
        """Have ``close`` called when this is closed."""
        self._closers.append(close)
