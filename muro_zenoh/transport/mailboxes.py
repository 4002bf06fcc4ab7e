"""The two mailboxes that tasks read: the newest message of each name, or every one."""

from __future__ import annotations

from collections import deque
from typing import Final, TypeVar

from muro_zenoh.messages import Message
from muro_zenoh.transport.inbox import Filed, Inbox, Slot
from muro_zenoh.transport.received import Received

T = TypeVar("T", bound=Message)


_OVERTAKEN: Final = 1.0
"""A message that comes by this time after a later one of its writer was overtaken, or came twice [s]. After it, ``seq``
counts anew, or one wrong number would lock its writer out."""


class Latest(Inbox[T]):
    """Keeps the newest message of each key, and wakes its reader once for all that came in the meantime.

    The newest of one writer is the one with the highest ``seq``, also when others come later.
    """

    def __init__(self, slot: Slot[T], depth: int = 4) -> None:
        # depth: garbage behind a good message does not displace it, unless there is a lot of it
        super().__init__(slot, depth)
        self._newest: dict[str, Received[T]] = {}
        self._unread: dict[str, Received[T]] = {}
        self._unseen: set[str] = set()  # names whose newest was not read yet, by next() or get()

    def get(self, name: str = "") -> Received[T] | None:
        """The newest message of a name, read or not, without waiting. On a mailbox of one key leave ``name`` out."""
        if self._raw:
            self._sort()
        if not name and self._newest:
            name = next(iter(self._newest))
        self._unseen.discard(name)
        return self._newest.get(name)

    def values(self) -> dict[str, Received[T]]:
        """The newest message of each name."""
        if self._raw:
            self._sort()
        self._unseen.clear()
        return dict(self._newest)

    def forget(self, name: str) -> None:
        """Drop what is known of a name."""
        if self._raw:
            self._sort()
        self._forget(name)

    def _forget(self, name: str) -> None:
        self._unseen.discard(name)
        self._newest.pop(name, None)
        self._unread.pop(name, None)

    def _displaced(self) -> None:
        self._counters.replaced += 1

    def _sort_key(self, key: str, filed: list[Filed]) -> None:
        # From the newest on: those behind the first good one are not worth their decoding while they come in order.
        newest = before = self._newest.get(key[self._prefix :])
        while filed:
            item = self._open(key, *filed.pop())
            if item is None:
                continue
            if newest is not None and _was_overtaken(item, newest):
                self._counters.replaced += 1
                continue
            if newest is not before:
                self._counters.replaced += 1
                newest = item
                continue
            newest = item
            last, known = item.message, before.message if before is not None else None
            # With as many before it as wait here, it is the last of them, unless some were lost besides.
            if known is None or known.epoch != last.epoch or not last.seq or last.seq > known.seq + len(filed):
                break
        self._counters.replaced += len(filed)
        filed.clear()
        if newest is not None and newest is not before:
            self._accept(newest)

    def _accept(self, item: Received[T]) -> None:
        if item.name in self._unseen:
            self._counters.replaced += 1
        self._unseen.add(item.name)
        self._unread.pop(item.name, None)  # so that the longest unread name comes first
        self._newest[item.name] = self._unread[item.name] = item

    def _take(self) -> Received[T] | None:
        for name in self._unread:
            self._unseen.discard(name)
            return self._unread.pop(name)
        return None


def _was_overtaken(item: Received[T], newest: Received[T]) -> bool:
    """Whether a message was sent before the newest one of its writer, or is that one once more."""
    mine, known = item.message, newest.message
    return mine.epoch == known.epoch and 0 < mine.seq <= known.seq and item.arrival - newest.arrival <= _OVERTAKEN


class Every(Inbox[T]):
    """A bounded queue; when it is full the oldest goes, and is counted."""

    def __init__(self, slot: Slot[T], depth: int = 64) -> None:
        super().__init__(slot, depth)
        self._queue: deque[Received[T]] = deque(maxlen=depth)

    def drain(self) -> list[Received[T]]:
        """All that waits, oldest first, without waiting."""
        if self._raw:
            self._sort()
        items = list(self._queue)
        self._queue.clear()
        return items

    def _displaced(self) -> None:
        self._counters.dropped += 1

    def _sort_key(self, key: str, filed: list[Filed]) -> None:
        for sample in filed:
            item = self._open(key, *sample)
            if item is not None:
                self._accept(item)

    def _accept(self, item: Received[T]) -> None:
        if len(self._queue) == self._queue.maxlen:
            self._displaced()
        self._queue.append(item)

    def _take(self) -> Received[T] | None:
        return self._queue.popleft() if self._queue else None
