"""The bus: typed channels over a link.

Publishers stamp and number; mailboxes decode and count. What a process sends to itself is handed over as it is, and
published besides.
"""

from __future__ import annotations

import asyncio
import logging
import math
import random
from collections import defaultdict
from collections.abc import Callable
from types import TracebackType
from typing import Any, Generic, TypeVar

import msgspec

from muro_zenoh.channels import (
    CHANNELS,
    Channel,
    Verb,
    alive_in,
    alive_key,
    check_name,
    check_realm,
    key_of,
    verb_key,
)
from muro_zenoh.errors import MessageError, NoReply
from muro_zenoh.messages import Message, Reply, check_encoding, decode, encode, encoding_of
from muro_zenoh.runtime.clock import Clock, SystemClock
from muro_zenoh.transport.inbox import Counters, Every, Inbox, Latest, Waker
from muro_zenoh.transport.link import Closable, Link, LinkPublisher, Question
from muro_zenoh.transport.tap import Roster, Tap

log = logging.getLogger(__name__)

T = TypeVar("T", bound=Message)
I = TypeVar("I", bound=Inbox[Any])  # noqa: E741 - an inbox


class Publisher(Generic[T]):
    """Sends one channel's messages on one key."""

    def __init__(self, bus: Bus, key: str, link: LinkPublisher) -> None:
        self._bus = bus
        self._key = key
        self._link = link
        self._seq = 0

    def put(self, message: T) -> T:
        """Send a message; it never blocks.

        Args:
            message: its ``seq`` and ``epoch`` are filled in, and its ``stamp`` when it is 0.

        Returns:
            The message as it was sent.
        """
        self._seq += 1
        sent = msgspec.structs.replace(
            message, stamp=message.stamp or self._bus.clock.now(), seq=self._seq, epoch=self._bus.epoch
        )
        for inbox in self._bus._readers.get(self._key, ()):
            inbox.hand(self._key, sent)
        self._link.put(encode(sent))
        return sent

    def close(self) -> None:
        """Undeclare it; a second time does nothing."""
        self._link.close()


class Bus:
    """A process's place on the bus. Made by :func:`muro_zenoh.transport.open_bus`.

    Args:
        link: the middleware.
        realm: the first word of every key.
        clock: for stamps and arrival times.

    Attributes:
        epoch: this process's number; drawn anew for each bus.
        counters: what became of the messages, by the channel's word.
    """

    def __init__(self, link: Link, realm: str, clock: Clock) -> None:
        self.realm = check_realm(realm)
        self.clock = clock
        # 48 bits: exact in every language's numbers
        self.epoch = random.SystemRandom().getrandbits(48) | 1
        self.counters: defaultdict[str, Counters] = defaultdict(Counters)
        self._link = link
        self._loop = asyncio.get_running_loop()
        self._waker = Waker(self._loop)
        self._readers: dict[str, list[Inbox[Any]]] = {}
        self._open: list[Closable] = []
        self._watched: list[tuple[Channel[Any], str, Inbox[Any]]] = []
        self._publishers: list[str] = []

    # ---- channels

    def publisher(self, channel: Channel[T], name: str = "") -> Publisher[T]:
        """A writer on a channel.

        Args:
            channel: which.
            name: the robot's (camera's, process's) name, where the channel has names.

        Raises:
            ConfigError: not a name, or a name too many or too few.
        """
        key = key_of(self.realm, channel, name)
        link = self._link.publisher(
            key, encoding=encoding_of(channel.kind), priority=channel.priority, keep=channel.delivery == "kept"
        )
        publisher: Publisher[T] = Publisher(self, key, link)
        self._open.append(publisher)
        # Wildcard mailboxes that were there first learn of the new key.
        self._publishers.append(key)
        for other, expression, inbox in self._watched:
            if other is channel and expression.endswith("/*"):
                self._readers.setdefault(key, []).append(inbox)
        return publisher

    def latest(self, channel: Channel[T], name: str = "", *, own_only: bool = False) -> Latest[T]:
        """A mailbox with the newest message of a name, or of each name when ``name`` is ``*``.

        Args:
            channel: which.
            name: whose; ``*`` for everybody's.
            own_only: take only what this very process sends; nobody else can then speak for it.
        """
        return self._subscribe(channel, name, Latest(*self._slot(channel, name)), own_only)

    def every(self, channel: Channel[T], name: str = "", depth: int = 64) -> Every[T]:
        """A bounded queue of a name's messages, or of everybody's when ``name`` is ``*``.

        Args:
            channel: which.
            name: whose; ``*`` for everybody's.
            depth: how many wait at most; beyond, the oldest goes and is counted.
        """
        return self._subscribe(channel, name, Every(*self._slot(channel, name), depth))

    def _slot(self, channel: Channel[T], name: str) -> tuple[type[T], int, Clock, Waker, Counters, str]:
        prefix = len(self.realm) + len(channel.word) + 2
        counters = self.counters[channel.word]
        return channel.kind, prefix, self.clock, self._waker, counters, key_of(self.realm, channel, name)

    def _subscribe(self, channel: Channel[T], name: str, inbox: I, own_only: bool = False) -> I:
        expression = key_of(self.realm, channel, name)
        ours = (key for key in self._publishers if key.startswith(expression[:-1])) if name == "*" else (expression,)
        for key in ours:
            self._readers.setdefault(key, []).append(inbox)
        self._watched.append((channel, expression, inbox))
        inbox.on_close(lambda: self._forget(inbox))
        if not own_only:
            inbox.on_close(self._link.subscribe(expression, inbox.file, keep=channel.delivery == "kept").close)
        self._open.append(inbox)
        return inbox

    def _forget(self, inbox: Inbox[Any]) -> None:
        for readers in self._readers.values():
            if inbox in readers:
                readers.remove(inbox)
        self._watched = [entry for entry in self._watched if entry[2] is not inbox]

    # ---- presence

    def announce(self, role: str, name: str) -> None:
        """Declare this process alive as ``<realm>/alive/<role>/<name>``; the token goes when the process does.

        Args:
            role: ``agent``, ``base``, ``basestation``, ``simulator``, ``router`` or ``operator``.
            name: who of them.
        """
        key = alive_key(self.realm, check_name(role, "role"), check_name(name))
        self._open.append(self._link.declare_token(key))

    def roster(self) -> Roster:
        """Who is alive, kept up to date."""
        roster = Roster(self._loop, lambda key: alive_in(self.realm, key))
        roster.on_close(self._link.watch_tokens(alive_key(self.realm, "*", "*"), roster.file).close)
        self._open.append(roster)
        return roster

    # ---- orders

    async def ask(self, verb: Verb[T], order: T, timeout: float = 1.0) -> Reply:
        """Give an order to the base station and wait for its answer.

        Args:
            verb: which order.
            order: what exactly.
            timeout: how long to wait [s].

        Raises:
            NoReply: nobody answered in time.
        """
        order = msgspec.structs.replace(order, stamp=self.clock.now(), epoch=self.epoch)
        key = verb_key(self.realm, verb)
        payload = await self._link.ask(key, encode(order), encoding_of(verb.kind), timeout)
        if payload is None:
            raise NoReply(
                f"{key}: nobody answered (waited at most {timeout:g} s), expected the base station to. "
                "Is `muro basestation` running, and on this router?"
            )
        return decode(payload, Reply)

    def answer(self, verb: Verb[T], handle: Callable[[T], Reply]) -> None:
        """Take an order: ``handle`` is called on the loop, and what it returns is the answer.

        Args:
            verb: which order.
            handle: takes the order, returns the reply; it must not block.
        """
        key = verb_key(self.realm, verb)

        def on_loop(question: Question) -> None:
            try:
                check_encoding(question.encoding, verb.kind)
                reply = handle(decode(question.payload, verb.kind))
            except MessageError as error:
                self.counters[f"basestation/{verb.word}"].rejected += 1
                reply = Reply(accepted=False, reason=str(error))
            question.reply(
                encode(msgspec.structs.replace(reply, stamp=self.clock.now(), epoch=self.epoch)), encoding_of(Reply)
            )

        def file(question: Question) -> None:
            try:
                self._loop.call_soon_threadsafe(on_loop, question)
            except RuntimeError:
                log.debug("%s: a question came after the loop had closed", key)

        self._open.append(self._link.answer(key, file))

    # ---- looking at anything

    def tap(self, key_expr: str, depth: int = 1024) -> Tap:
        """Bytes of any key, for tools; nothing is decoded.

        Args:
            key_expr: a Zenoh key expression.
            depth: how many samples wait at most.
        """
        tap = Tap(self._loop, self.clock, depth)
        tap.on_close(self._link.subscribe(key_expr, tap.file, keep=False).close)
        self._open.append(tap)
        return tap

    def numbers(self) -> dict[str, float]:
        """The counters as gauges for a :class:`~muro_zenoh.messages.Health`; channels that were silent are left out."""
        numbers: dict[str, float] = {}
        for word, c in self.counters.items():
            if not c.received:
                continue
            numbers[f"{word}_received"] = c.received
            if c.dropped:
                numbers[f"{word}_dropped"] = c.dropped
            if c.rejected:
                numbers[f"{word}_rejected"] = c.rejected
            if math.isfinite(c.delay):
                numbers[f"{word}_delay_s"] = round(c.delay, 4)
        return numbers

    # ---- lifetime

    async def close(self) -> None:
        """Undeclare everything and leave; a second time does nothing."""
        opened, self._open = self._open, []
        for thing in reversed(opened):
            thing.close()
        await self._link.close()

    async def __aenter__(self) -> Bus:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()


def make_bus(link: Link, realm: str = "muro", clock: Clock | None = None) -> Bus:
    """A bus over any link; for the in-memory one, and for tests."""
    return Bus(link, realm, clock or SystemClock())


assert len({c.word for c in CHANNELS}) == len(CHANNELS), "two rows of the channel table share a word"
