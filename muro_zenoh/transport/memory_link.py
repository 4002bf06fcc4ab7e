"""The in-memory link: a network within one process and one event loop, for tests and virtual time.

It carries bytes, so the codec is exercised as over Zenoh. Like Zenoh's its links lead to a router, and each may have
:mod:`troubles <muro_zenoh.transport.memory_faults>`; a message, a query and its answer, a kept value and the news of a
token cross the sender's link, the router and the receiver's link.
"""

from __future__ import annotations

import asyncio
import contextlib
import contextvars
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

from muro_zenoh.channels import Priority
from muro_zenoh.transport.key_expressions import matches
from muro_zenoh.transport.link import Closable, FileSample, FileToken, Question, call_on
from muro_zenoh.transport.memory_faults import Deliver, Trouble, Way
from muro_zenoh.transport.memory_presence import Presence

LEASE: Final = 2.0
"""After this silence a link counts as closed: its tokens are gone, and it sees no others' [s]."""


Witness = Callable[[str, float], None]
"""Called with the key of a sample, and with when it was sent [s, loop], as it reaches a reader."""


@dataclass(slots=True, eq=False)
class _Reader:
    link: MemoryLink
    expression: str
    file: FileSample
    witness: Witness | None

    def take(self, key: str, payload: bytes, encoding: str | None, sent: float) -> None:
        """File a sample that was sent at a time."""
        if self.witness is not None:
            self.witness(key, sent)
        self.file(key, payload, encoding)


class MemoryNetwork:
    """What the links of one network share: the router between them.

    On a link without troubles a sample is filed with its readers while it is put: filing wakes a task at most, and runs
    none.

    Attributes:
        router: what every message crosses that does not stay on one computer.
        changes: what somebody makes of the payloads of a key, by key.
    """

    def __init__(self) -> None:
        self.router = Way(self._settle)
        self.changes: dict[str, list[Callable[[bytes], bytes]]] = {}
        self._calm = True
        self._links: dict[MemoryLink, None] = {}
        self._readers: list[_Reader] = []
        self._readers_of: dict[str, tuple[_Reader, ...]] = {}
        self._kept: dict[str, tuple[_Publisher, bytes, str | None]] = {}
        self._presence = Presence(lambda link, deliver: self.carry(None, link, deliver, reliable=True))
        self._answers: list[tuple[str, MemoryLink, Callable[[Question], None]]] = []

    def link(self, *computers: str, witnesses: Mapping[str, Witness] | None = None) -> MemoryLink:
        """A new link to this network.

        Args:
            computers: where the process runs; those of one computer reach each other past the router.
            witnesses: what looks at the samples that reach it, by key expression.
        """
        link = MemoryLink(self, frozenset(computers), witnesses or {})
        self._links[link] = None
        self._settle()
        link._check_silence()
        return link

    def put(self, key: str, payload: bytes, encoding: str | None = None, *, sender: MemoryLink | None = None) -> None:
        """Deliver bytes to every reader but the sender's own; without a sender, as a stranger would."""
        for change in self.changes.get(key, ()):
            payload = change(payload)
        readers = self._readers_to(key)
        now = asyncio.get_running_loop().time()
        if self._calm:
            for reader in readers:
                if reader.link is not sender:
                    if reader.witness is not None:
                        reader.witness(key, now)
                    reader.file(key, payload, encoding)
            return
        for reader in readers:
            if sender is not None and reader.link is not sender and reader.link.is_near(sender):
                reader.link.receive(partial(reader.take, key, payload, encoding, now))
        spread = partial(self._spread, sender, key, payload, encoding, now)
        (sender.way_out if sender is not None else self.router).send(
            partial(self.router.send, spread) if sender is not None else spread
        )

    def _spread(self, sender: MemoryLink | None, key: str, payload: bytes, encoding: str | None, sent: float) -> None:
        """Send a sample from the router on to its readers."""
        for reader in self._readers_to(key):
            link = reader.link
            if link is not sender and (sender is None or not link.is_near(sender)):
                link.way_in.send(partial(link.receive, partial(reader.take, key, payload, encoding, sent)))

    def _readers_to(self, key: str) -> tuple[_Reader, ...]:
        readers = self._readers_of.get(key)
        if readers is None:
            readers = tuple(reader for reader in self._readers if matches(reader.expression, key))
            self._readers_of[key] = readers
        return readers

    def carry(self, sender: MemoryLink | None, receiver: MemoryLink, deliver: Deliver, reliable: bool = False) -> None:
        """Take something from link to link.

        Args:
            sender: whose; None for a stranger's.
            receiver: whom it is for.
            deliver: hands it over there.
            reliable: whether it is repeated until it has arrived.
        """
        deliver = partial(receiver.receive, deliver)
        if self._calm or (sender is not None and receiver.is_near(sender)):
            deliver()
            return
        hop = partial(self.router.send, partial(receiver.way_in.send, deliver, reliable), reliable)
        if sender is None:
            hop()
        else:
            sender.way_out.send(hop, reliable)

    def _settle(self) -> None:
        self._calm = self.router.calm and all(link.calm for link in self._links)

    def begin(self, trouble: Trouble) -> None:
        """The router has a trouble from now on."""
        self.router.begin(trouble)
        self._check_silence()

    def end(self, trouble: Trouble) -> None:
        """The router has a trouble no more."""
        self.router.end(trouble)
        self._check_silence()

    def _check_silence(self) -> None:
        for link in list(self._links):
            link._check_silence()

    def lapse(self) -> None:
        """Every link counts as closed, because the router is gone."""
        for link in self._links:
            link.lapsed = True
        self._presence.announce()

    def _subscribe(self, reader: _Reader) -> None:
        self._readers.append(reader)
        self._readers_of.clear()  # matched again at the next sample of each key

    def _unsubscribe(self, gone: Callable[[_Reader], bool]) -> None:
        self._readers = [reader for reader in self._readers if not gone(reader)]
        self._readers_of.clear()


@dataclass(slots=True)
class _Question:
    payload: bytes
    encoding: str | None
    answer: Callable[[bytes], None]

    def reply(self, payload: bytes, encoding: str) -> None:
        self.answer(payload)


class _Undo:
    """Does one thing once."""

    def __init__(self, undo: Callable[[], None]) -> None:
        self._undo: Callable[[], None] | None = undo

    def close(self) -> None:
        undo, self._undo = self._undo, None
        if undo is not None:
            undo()


class _Publisher:
    def __init__(self, link: MemoryLink, key: str, encoding: str, keep: bool) -> None:
        self.link, self._key, self._encoding, self._keep = link, key, encoding, keep
        self._closed = False

    def put(self, payload: bytes) -> bool:
        if self._closed or self.link.closed:
            return False
        network = self.link.network
        if self._keep:
            network._kept[self._key] = (self, payload, self._encoding)
        network.put(self._key, payload, self._encoding, sender=self.link)
        return True

    def close(self) -> None:
        """Send no more, and take along what was kept here, as Zenoh does."""
        self._closed = True
        kept = self.link.network._kept.get(self._key)
        if kept is not None and kept[0] is self:
            del self.link.network._kept[self._key]


class MemoryLink:
    """One process's link to a :class:`MemoryNetwork`.

    Args:
        network: the network.
        computers: where the process runs.
        witnesses: what looks at the samples that reach it, by key expression.

    Attributes:
        closed: whether it has left.
        way_in: of what others send.
        way_out: of what it sends.
        silent: whether nothing passes now.
        lapsed: whether the router takes it for closed, because it has been silent for the lease.
    """

    def __init__(self, network: MemoryNetwork, computers: frozenset[str], witnesses: Mapping[str, Witness]) -> None:
        self.network = network
        self.computers = computers
        self.closed = False
        self.silent = False
        self.lapsed = False
        self.way_in, self.way_out = Way(network._settle), Way(network._settle)
        self._witnesses = witnesses
        self._context = contextvars.copy_context()
        self._backlog: list[Deliver] | None = None  # of a frozen process
        self._silences = 0

    @property
    def calm(self) -> bool:
        """Whether everything passes at once."""
        return self.way_in.calm and self.way_out.calm and self._backlog is None

    def is_near(self, other: MemoryLink) -> bool:
        """Whether another link is on the same computer, or the same, so that the router is not between them.

        Args:
            other: the other one.
        """
        return other is self or not self.computers.isdisjoint(other.computers)

    # ---- troubles

    def begin(self, trouble: Trouble, direction: str = "both") -> None:
        """Have a trouble from now on.

        Args:
            trouble: which.
            direction: ``in``, ``out`` or ``both``.
        """
        for way in self._ways(direction):
            way.begin(trouble)
        self._check_silence()

    def end(self, trouble: Trouble, direction: str = "both") -> None:
        """Have a trouble no more.

        Args:
            trouble: which.
            direction: ``in``, ``out`` or ``both``.
        """
        for way in self._ways(direction):
            way.end(trouble)
        self._check_silence()

    def _ways(self, direction: str) -> tuple[Way, ...]:
        return {"in": (self.way_in,), "out": (self.way_out,)}.get(direction, (self.way_in, self.way_out))

    def freeze(self) -> None:
        """Take nothing from now on, because the process does not run; what comes waits."""
        self._backlog = self._backlog or []
        self.network._settle()
        self._check_silence()

    def thaw(self) -> None:
        """Take what has come since :meth:`freeze`."""
        backlog, self._backlog = self._backlog or [], None
        for deliver in backlog:
            deliver()
        self.network._settle()
        self._check_silence()

    def receive(self, deliver: Deliver) -> None:
        """Take what has arrived.

        Args:
            deliver: hands it over.
        """
        if self.closed:
            return
        if self._backlog is not None:
            self._backlog.append(deliver)
        else:
            deliver()

    def run(self, file: Callable[..., None], *given: object) -> None:
        """Call into the process whose link this is.

        Args:
            file: one of its functions.
            given: passed on.
        """
        self._context.copy().run(file, *given)

    def _check_silence(self) -> None:
        silent = self.way_in.silent or self.way_out.silent or self.network.router.silent or self._backlog is not None
        if silent is self.silent:
            return
        self.silent = silent
        self._silences += 1
        if silent:
            loop = asyncio.get_running_loop()
            loop.call_later(LEASE, self._lapse, self._silences, context=contextvars.Context())
            return
        self.lapsed = False
        self.network._presence.announce_again(self)

    def _lapse(self, silence: int) -> None:
        if silence == self._silences and not self.closed:
            self.lapsed = True
            self.network._presence.announce()

    # ---- the link

    def publisher(self, key: str, *, encoding: str, priority: Priority, keep: bool) -> _Publisher:
        return _Publisher(self, key, encoding, keep)

    def subscribe(self, key_expr: str, file: FileSample, *, encoding: str, keep: bool) -> Closable:
        reader = _Reader(self, key_expr, file, self._witnesses.get(key_expr))
        self.network._subscribe(reader)
        if keep:
            for key, (publisher, payload, encoding_sent) in self.network._kept.items():
                if matches(key_expr, key) and not publisher.link.frozen:
                    self.network.carry(publisher.link, self, partial(file, key, payload, encoding_sent))
        return _Undo(lambda: self.network._unsubscribe(lambda other: other is reader))

    @property
    def frozen(self) -> bool:
        """Whether its process does not run."""
        return self._backlog is not None

    def declare_token(self, key: str) -> Closable:
        return _Undo(self.network._presence.declare(key, self))

    def watch_tokens(self, key_expr: str, file: FileToken) -> Closable:
        return _Undo(self.network._presence.watch(key_expr, self, file))

    async def hear_all_tokens(self, key_expr: str, timeout: float) -> bool:
        told = asyncio.Event()
        loop = asyncio.get_running_loop()

        def at_router() -> None:  # on the way of the news, and behind it
            self.way_in.send(partial(self.receive, partial(call_on, loop, told.set)), True)

        if self.lapsed:
            return False
        self.way_out.send(partial(self.network.router.send, at_router, True), True)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout):
                return await told.wait()
        return False

    def answer(self, key: str, file: Callable[[Question], None]) -> Closable:
        entry = (key, self, file)
        self.network._answers.append(entry)

        def forget() -> None:
            if entry in self.network._answers:  # not once the link has left
                self.network._answers.remove(entry)

        return _Undo(forget)

    async def ask(self, key: str, payload: bytes, encoding: str, timeout: float) -> bytes | None:
        answer: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
        network = self.network
        asked = [
            (link, file)
            for there, link, file in network._answers
            if there == key and (link is self or not (link.lapsed or self.lapsed))
        ]
        if not asked:
            return None

        def take(reply: bytes) -> None:
            if not answer.done():
                answer.set_result(reply)

        def carry_back(link: MemoryLink, reply: bytes) -> None:
            if not link.closed:
                network.carry(link, self, partial(take, reply))

        for link, file in asked:
            question = _Question(payload, encoding, partial(carry_back, link))
            network.carry(self, link, partial(link.run, file, question))
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout):
                return await answer
        return None

    async def close(self) -> None:
        """Leave the network, and take along what was kept and declared here, as a killed process would."""
        self.leave()

    def leave(self) -> None:
        """The same at once."""
        self.closed = True
        net = self.network
        net._unsubscribe(lambda reader: reader.link is self)
        net._answers[:] = [a for a in net._answers if a[1] is not self]
        net._kept = {k: v for k, v in net._kept.items() if v[0].link is not self}
        net._links.pop(self, None)
        net._settle()
        net._presence.leave(self)
