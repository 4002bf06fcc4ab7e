"""The in-memory link: a network within one process and one event loop, for tests and virtual time.

It carries bytes, so the codec is exercised as over Zenoh.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field

from muro_zenoh.channels import Priority
from muro_zenoh.transport.link import Closable, FileSample, FileToken, Question


def matches(expression: str, key: str) -> bool:
    """Whether a key is in a key expression: ``*`` stands for one chunk, ``**`` for any number of them."""
    return _match(expression.split("/"), key.split("/"))


def _match(expression: list[str], key: list[str]) -> bool:
    if not expression:
        return not key
    head, rest = expression[0], expression[1:]
    if head == "**":
        return any(_match(rest, key[i:]) for i in range(len(key) + 1))
    return bool(key) and head in ("*", key[0]) and _match(rest, key[1:])


@dataclass(slots=True, eq=False)
class _Reader:
    link: MemoryLink
    expression: str
    file: FileSample


@dataclass
class MemoryNetwork:
    """What the links of one network share.

    A sample is filed with its readers while it is put: filing wakes a task at most, and runs none.
    """

    _readers: list[_Reader] = field(default_factory=list)
    _readers_of: dict[str, tuple[_Reader, ...]] = field(default_factory=dict)
    _kept: dict[str, tuple[_Publisher, bytes, str | None]] = field(default_factory=dict)
    _tokens: list[tuple[str, MemoryLink]] = field(default_factory=list)
    _watchers: list[tuple[MemoryLink, str, FileToken]] = field(default_factory=list)
    _answers: list[tuple[str, MemoryLink, Callable[[Question], None]]] = field(default_factory=list)

    def link(self) -> MemoryLink:
        """A new link to this network."""
        return MemoryLink(self)

    def put(self, key: str, payload: bytes, encoding: str | None = None, *, sender: MemoryLink | None = None) -> None:
        """Deliver bytes to every reader but the sender's own; without a sender, as a stranger would."""
        readers = self._readers_of.get(key)
        if readers is None:
            readers = tuple(reader for reader in self._readers if matches(reader.expression, key))
            self._readers_of[key] = readers
        for reader in readers:
            if reader.link is not sender:
                reader.file(key, payload, encoding)

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
    answer: asyncio.Future[bytes]

    def reply(self, payload: bytes, encoding: str) -> None:
        if not self.answer.done():
            self.answer.set_result(payload)


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
    """One process's link to a :class:`MemoryNetwork`."""

    def __init__(self, network: MemoryNetwork) -> None:
        self.network = network
        self.closed = False

    def publisher(self, key: str, *, encoding: str, priority: Priority, keep: bool) -> _Publisher:
        return _Publisher(self, key, encoding, keep)

    def subscribe(self, key_expr: str, file: FileSample, *, encoding: str, keep: bool) -> Closable:
        reader = _Reader(self, key_expr, file)
        self.network._subscribe(reader)
        if keep:
            for key, (_, payload, encoding_sent) in self.network._kept.items():
                if matches(key_expr, key):
                    file(key, payload, encoding_sent)
        return _Undo(lambda: self.network._unsubscribe(lambda other: other is reader))

    def declare_token(self, key: str) -> Closable:
        token = (key, self)
        self.network._tokens.append(token)
        self._tell(key, True)
        return _Undo(lambda: self._drop_token(token))

    def _drop_token(self, token: tuple[str, MemoryLink]) -> None:
        tokens = self.network._tokens
        if token in tokens:
            tokens.remove(token)
            # Two processes may declare the same token: it is gone when both are.
            if all(key != token[0] for key, _ in tokens):
                self._tell(token[0], False)

    def _tell(self, key: str, there: bool) -> None:
        for _, expression, file in self.network._watchers:
            if matches(expression, key):
                file(key, there)

    def watch_tokens(self, key_expr: str, file: FileToken) -> Closable:
        entry = (self, key_expr, file)
        self.network._watchers.append(entry)
        for key, _ in self.network._tokens:
            if matches(key_expr, key):
                file(key, True)
        return _Undo(lambda: self.network._watchers.remove(entry))

    def answer(self, key: str, file: Callable[[Question], None]) -> Closable:
        entry = (key, self, file)
        self.network._answers.append(entry)
        return _Undo(lambda: self.network._answers.remove(entry))

    async def ask(self, key: str, payload: bytes, encoding: str, timeout: float) -> bytes | None:
        answer: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
        asked = [file for there, _, file in self.network._answers if there == key]
        if not asked:
            return None
        for file in asked:
            file(_Question(payload, encoding, answer))
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout):
                return await answer
        return None

    async def close(self) -> None:
        """Leave the network, and take along what was kept and declared here, as a killed process would."""
        self.closed = True
        net = self.network
        net._unsubscribe(lambda reader: reader.link is self)
        net._watchers[:] = [w for w in net._watchers if w[0] is not self]
        net._answers[:] = [a for a in net._answers if a[1] is not self]
        net._kept = {k: v for k, v in net._kept.items() if v[0].link is not self}
        for token in [token for token in net._tokens if token[1] is self]:
            self._drop_token(token)
