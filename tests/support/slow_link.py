"""An in-memory link on which everything takes its time, each way, in order."""

from __future__ import annotations

import asyncio
from typing import Any

from muro_zenoh.channels import Priority
from muro_zenoh.transport import MemoryNetwork
from muro_zenoh.transport.link import Closable, FileSample
from muro_zenoh.transport.memory_link import MemoryLink


class SlowLink(MemoryLink):
    """A link of one process.

    Args:
        network: what it is on.
        there: how long from the process to the others [s].
        back: how long to it [s].
    """

    def __init__(self, network: MemoryNetwork, there: float, back: float) -> None:
        super().__init__(network)
        self.there = there
        self.back = back
        self._loop = asyncio.get_running_loop()

    def publisher(self, key: str, *, encoding: str, priority: Priority, keep: bool) -> Any:
        return _SlowPublisher(self, super().publisher(key, encoding=encoding, priority=priority, keep=keep))

    def subscribe(self, key_expr: str, file: FileSample, *, encoding: str, keep: bool) -> Closable:
        def later(key: str, payload: bytes, sent: str | None) -> None:
            self._loop.call_later(self.back, file, key, payload, sent)

        return super().subscribe(key_expr, later, encoding=encoding, keep=keep)

    async def ask(self, key: str, payload: bytes, encoding: str, timeout: float) -> bytes | None:
        await asyncio.sleep(self.there)
        answer = await super().ask(key, payload, encoding, timeout)
        await asyncio.sleep(self.back)
        return answer


class _SlowPublisher:
    def __init__(self, link: SlowLink, inner: Any) -> None:
        self._link = link
        self._inner = inner

    def put(self, payload: bytes) -> bool:
        self._link._loop.call_later(self._link.there, self._inner.put, payload)
        return True

    def close(self) -> None:
        self._inner.close()
