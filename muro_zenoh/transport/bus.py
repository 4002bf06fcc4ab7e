"""The bus: typed channels over a link.

Publishers stamp and number; mailboxes decode and count. What a process sends itself is handed over
without encoding, and published as well.
"""

from __future__ import annotations

import asyncio
import itertools
import random
from collections import defaultdict
from collections.abc import Awaitable, Callable, Iterable
from functools import partial
from types import TracebackType
from typing import Any, TypeVar

import msgspec

from muro_zenoh.channels import (
    ALL_ROLES,
    TIME,
    Channel,
    Role,
    Verb,
    alive_in,
    alive_key,
    check_name,
    check_realm,
    key_of,
    verb_key,
)
from muro_zenoh.errors import ConfigError, NoReply, TransportError
from muro_zenoh.messages import AskTime, Message, Order, Reply, decode, encode, encoding_of
from muro_zenoh.messages.base import LARGEST
from muro_zenoh.runtime.clock import Clock, SystemClock
from muro_zenoh.runtime.operator import operator_name
from muro_zenoh.transport.clock_offset import KnownClocks, RoundTrip
from muro_zenoh.transport.inbox import Inbox, Slot
from muro_zenoh.transport.link import Closable, Link, Question
from muro_zenoh.transport.mailboxes import Every, Latest
from muro_zenoh.transport.orders import Orders, nobody_answered, with_deadline
from muro_zenoh.transport.publisher import Publisher
from muro_zenoh.transport.pulse import Pulse
from muro_zenoh.transport.received import Counters
from muro_zenoh.transport.roster import Roster, TokenWatch
from muro_zenoh.transport.tap import Tap

T = TypeVar("T", bound=Message)
I = TypeVar("I", bound=Inbox[Any])  # noqa: E741 - an inbox


class Bus:
    """A process's place on the bus. Made by :func:`muro_zenoh.transport.open_bus`.

    Args:
        link: the middleware.
        realm: the first word of every key.
        roles: of this process: what it may publish, ask, answer and announce.
        clock: for stamps and arrival times.
        epoch: this process's number; drawn at random for each bus, but where a run is to be repeated.
        usage: gauges of the process that has this bus, for its health.

    Attributes:
        epoch: this process's number.
        counters: what became of the messages, by the channel's word.
        operator: who gives orders from this process; its orders and velocities say so.
        clocks: other processes' clocks, as far as they were measured; mailboxes judge their messages by them.
    """

    def __init__(
        self,
        link: Link,
        realm: str,
        roles: Iterable[Role],
        clock: Clock,
        epoch: int | None = None,
        usage: Callable[[], dict[str, float]] = dict,
    ) -> None:
        self.realm = check_realm(realm)
        self.roles = frozenset(roles)
        self.clock = clock
        self.epoch = draw_epoch(random.SystemRandom()) if epoch is None else epoch
        self.counters: defaultdict[str, Counters] = defaultdict(Counters)
        self.operator = operator_name() if Role.OPERATOR in self.roles else ""
        self.clocks = KnownClocks()
        self._usage = usage
        self._link = link
        self._loop = asyncio.get_running_loop()
        self._readers: dict[str, list[Inbox[Any]]] = {}
        self._open: dict[Closable, None] = {}  # in the order of their declaration
        self._wildcards: list[tuple[str, Inbox[Any]]] = []  # with the start of their keys
        self._numbers: dict[str, itertools.count[int]] = {}  # the next `seq` of each key that this process writes
        self._orders: list[Orders[Any]] = []
        self._pulse: Pulse | None = None
        self._tokens: TokenWatch | None = None
        self._closed = False

    # ---- channels

    def publisher(self, channel: Channel[T], name: str = "", *, keep: bool = True) -> Publisher[T]:
        """A writer on a channel.

        Args:
            channel: which.
            name: the robot's (camera's, process's) name, where the channel has names.
            keep: whether late joiners get its last value, if the channel's values are kept. False for a writer that is
                closed soon: each reader would ask it for its value.

        Raises:
            ConfigError: no role of this process writes the channel; or the name is invalid, missing or superfluous.
        """
        self._check_open()
        self._check_role({party.role for party in channel.writers}, f"channel {channel.word}", "publish on it")
        if name == "*":
            raise ConfigError(f"channel {channel.word}", got="the name '*' to publish on", expected="one name")
        key = key_of(self.realm, channel, name)
        keep = keep and channel.delivery == "kept"
        link = self._link.publisher(key, encoding=encoding_of(channel.kind), priority=channel.priority, keep=keep)
        readers = self._readers.setdefault(key, [])
        if key not in self._numbers:
            self._numbers[key] = itertools.count(1)
            # Mailboxes of `*` that were declared first get the new key's messages too.
            readers += [inbox for start, inbox in self._wildcards if key.startswith(start)]
        publisher: Publisher[T] = Publisher(
            key,
            link,
            readers,
            self.clock,
            (self.epoch, self._numbers[key]),
            self.counters[channel.word],
            self.operator if "operator" in channel.kind.__struct_fields__ else "",
        )
        publisher.on_close(lambda: self._forget(publisher))
        self._open[publisher] = None
        return publisher

    def latest(self, channel: Channel[T], name: str = "", *, own_only: bool = False) -> Latest[T]:
        """A mailbox with the newest message of a name, or of each name when ``name`` is ``*``.

        Args:
            channel: which.
            name: whose; ``*`` for all names.
            own_only: take only what this process sends, so that no other process can speak for it.
        """
        return self._subscribe(channel, name, Latest(self._slot(channel, name)), own_only)

    def every(self, channel: Channel[T], name: str = "", depth: int = 64) -> Every[T]:
        """A bounded queue of a name's messages, or of all names when ``name`` is ``*``.

        Args:
            channel: which.
            name: whose; ``*`` for all names.
            depth: how many wait at most; when it is full, the oldest is dropped and counted.
        """
        return self._subscribe(channel, name, Every(self._slot(channel, name), depth))

    def _slot(self, channel: Channel[T], name: str) -> Slot[T]:
        prefix = len(self.realm) + len(channel.word) + 2
        counters = self.counters[channel.word]
        where = key_of(self.realm, channel, name)
        return Slot(channel.kind, prefix, self.clock, self._loop, counters, where, channel.stale_after, self.clocks)

    def _subscribe(self, channel: Channel[T], name: str, inbox: I, own_only: bool = False) -> I:
        self._check_open()
        expression = key_of(self.realm, channel, name)
        if name == "*":
            start = expression[:-1]
            self._wildcards.append((start, inbox))
            ours = [key for key in self._numbers if key.startswith(start)]
        else:
            ours = [expression]
        for key in ours:
            self._readers.setdefault(key, []).append(inbox)
        if not own_only:
            inbox.on_close(
                self._link.subscribe(
                    expression, inbox.file, encoding=encoding_of(channel.kind), keep=channel.delivery == "kept"
                ).close
            )
        inbox.on_close(lambda: self._forget(inbox))
        self._open[inbox] = None
        return inbox

    def _forget(self, thing: Closable) -> None:
        self._open.pop(thing, None)
        for readers in self._readers.values():
            if thing in readers:
                readers.remove(thing)
        self._wildcards = [entry for entry in self._wildcards if entry[1] is not thing]

    def _check_role(self, roles: Iterable[Role], where: str, what: str) -> None:
        if self.roles.isdisjoint(roles):
            raise ConfigError(
                where,
                got=f"a process with the role {_either(self.roles)} to {what}",
                expected=f"one with the role {_either(roles)}",
                hint="The roles are given where the bus is opened; docs/channels.md says which role does what",
            )

    def _check_open(self) -> None:
        if self._closed:
            raise TransportError("this bus is closed: declare what a task needs before, or open another")

    # ---- presence

    def announce(self, role: Role, name: str) -> None:
        """Declare this process alive as ``<realm>/alive/<role>/<name>``; the token goes when the process does.

        Args:
            role: one of this process's.
            name: the robot's, where the role is of a robot; else the process's.

        Raises:
            ConfigError: not a role of this process, or not a name.
        """
        self._check_open()
        self._check_role((role,), f"presence of {name}", "announce it")
        self._open[self._link.declare_token(alive_key(self.realm, role, check_name(name)))] = None

    def roster(self) -> Roster:
        """Who is alive, kept up to date."""
        self._check_open()
        everybody = alive_key(self.realm, "*", "*")
        if self._tokens is None:
            tokens = TokenWatch(self._loop, lambda key: alive_in(self.realm, key))
            self._open[self._link.watch_tokens(everybody, tokens.file)] = None
            self._tokens = tokens
        roster = Roster(self._loop, self._tokens, partial(self._link.hear_all_tokens, everybody))
        roster.on_close(lambda: self._forget(roster))
        self._open[roster] = None
        return roster

    # ---- orders

    async def ask(self, verb: Verb[T], order: T, *, name: str = "", timeout: float = 1.0) -> Reply:
        """Give an order and wait for its answer.

        Args:
            verb: which order.
            order: what exactly.
            name: whom it is for, where the order has names.
            timeout: how long to wait [s].

        Raises:
            ConfigError: no role of this process gives the order; or the name is invalid, missing or superfluous.
            NoReply: nobody answered in time.
            MessageError: the answer is not a reply.
        """
        self._check_open()
        self._check_role(verb.asked_by, f"order {verb.word}", "give it")
        key = verb_key(self.realm, verb, name)
        dated = await self._dated(order, timeout)
        payload = await self._link.ask(key, encode(self._stamped(dated)), encoding_of(verb.kind), timeout)
        if payload is None:
            raise NoReply(nobody_answered(verb, key, name, timeout))
        return decode(payload, Reply)

    async def _dated(self, order: T, timeout: float) -> T:
        """The order, with the time until which its answer is awaited where that matters."""
        if not isinstance(order, Order) or order.until is not None:
            return order
        key, began, sent = verb_key(self.realm, TIME), self._loop.time(), self.clock.now()
        payload = await self._link.ask(key, encode(self._stamped(AskTime())), encoding_of(AskTime), timeout)
        if payload is not None:
            reply = decode(payload, Reply)
            trip = RoundTrip(sent, reply.received, reply.stamp, self.clock.now())
            return with_deadline(order, trip, reply.epoch, timeout)
        if self._loop.time() - began > 0.9 * timeout:
            # It would arrive when nobody waits for its answer any more, as this question will.
            raise NoReply(nobody_answered(TIME, key, "", timeout))
        return order  # there is nobody to ask: the middleware knows that at once

    def _ahead_of(self, epoch: int) -> float:
        """What to add to a process's clock to have ours [s]; infinite for one that was not measured."""
        return 0.0 if epoch == self.epoch else self.clocks.offset(epoch, self.clock.now())

    def answer(self, verb: Verb[T], handle: Callable[[T], Reply | Awaitable[Reply]], *, name: str = "") -> Closable:
        """Take an order: ``handle`` is called on the loop, and what it returns, or what is awaited then, is the answer.

        Args:
            verb: which order.
            handle: takes the order, returns the reply or an awaitable of it; it must not block. A
                :class:`~muro_zenoh.errors.MuroError` that is raised refuses the order with the error's text; any other
                is logged as well, for it is a bug.
            name: whose orders, where the order has names.

        Returns:
            Takes no more orders once it is closed; those being answered are finished.

        Raises:
            ConfigError: no role of this process answers the order; or the name is invalid, missing or superfluous.
        """
        self._check_open()
        self._check_role((verb.answered_by,), f"order {verb.word}", "answer it")
        key = verb_key(self.realm, verb, name)
        word = verb.word if verb.named else f"{verb.answered_by}/{verb.word}"
        if self._pulse is None:
            self._pulse = Pulse(self._loop, self.clock)
            self._open[self._pulse] = None
        orders = Orders(
            verb,
            key,
            handle,
            self._send_reply,
            self.clock,
            self._loop,
            self.counters[word],
            self._pulse,
            self._ahead_of,
        )
        self._orders.append(orders)
        declared = self._link.answer(key, orders.file)
        self._open[declared] = None
        return declared

    def _send_reply(self, question: Question, reply: Reply, received: float) -> None:
        reply = msgspec.structs.replace(self._stamped(reply), received=received)
        question.reply(encode(reply), encoding_of(Reply))

    def _stamped(self, message: T) -> T:
        signed = {"operator": self.operator} if getattr(message, "operator", None) == "" else {}
        return msgspec.structs.replace(message, stamp=self.clock.now(), epoch=self.epoch, **signed)

    # ---- looking at anything

    def tap(self, key_expr: str, depth: int = 1024, *, keep: bool = False) -> Tap:
        """Bytes of any key, for tools; nothing is decoded.

        Args:
            key_expr: a Zenoh key expression.
            depth: how many samples wait at most.
            keep: begin with the values that were kept before.
        """
        self._check_open()
        tap = Tap(self._loop, self.clock, depth)
        tap.on_close(self._link.subscribe(key_expr, tap.file, encoding="", keep=keep).close)
        tap.on_close(lambda: self._forget(tap))
        self._open[tap] = None
        return tap

    def numbers(self) -> dict[str, float]:
        """The counters, and what the process uses, as gauges for a :class:`~muro_zenoh.messages.Health`; channels that
        were silent are left out."""
        now = self.clock.now()
        numbers = self._usage()
        for word, c in self.counters.items():
            for what in ("received", "dropped", "replaced", "rejected", "late", "unsent"):
                if count := getattr(c, what):
                    numbers[f"{word}_{what}"] = count
            if c.arrival:
                numbers[f"{word}_age_s"] = round(now - c.arrival, 4)
                # A stranger may say any clock, and so any delay; a health message has a largest number.
                numbers[f"{word}_delay_s"] = round(min(c.delay, LARGEST), 4)
        return numbers

    # ---- lifetime

    async def close(self) -> None:
        """Undeclare everything and leave; a second time does nothing."""
        self._closed = True
        for thing in reversed(list(self._open)):
            thing.close()
        self._open.clear()
        if answering := [task for orders in self._orders for task in orders.close()]:
            await asyncio.wait(answering)
        await self._link.close()

    async def __aenter__(self) -> Bus:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()


def draw_epoch(rng: random.Random) -> int:
    """The number of a process that starts.

    Args:
        rng: the generator.

    Returns:
        Not 0, and of 48 bits: exact in every language's numbers.
    """
    return rng.getrandbits(48) | 1


def _either(roles: Iterable[Role]) -> str:
    return " or ".join(sorted(roles))


def make_bus(
    link: Link,
    realm: str = "muro",
    *,
    roles: Iterable[Role] = ALL_ROLES,
    clock: Clock | None = None,
    epoch: int | None = None,
    usage: Callable[[], dict[str, float]] = dict,
) -> Bus:
    """A bus over any link; for the in-memory one, and for tests.

    Args:
        link: the middleware.
        realm: the first words of every key.
        roles: of the process; all of them by default, for tests that play every process.
        clock: for stamps and arrival times; the system's by default.
        epoch: the process's number; drawn at random by default.
        usage: gauges of the process, for its health; none by default.
    """
    return Bus(link, realm, roles, clock or SystemClock(), epoch, usage)
