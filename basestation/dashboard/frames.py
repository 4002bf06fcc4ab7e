"""States as bytes, each made once for all clients that need the same: what is slow goes only to those that lack it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import msgpack  # type: ignore[import-untyped]  # it publishes no types

_pack: Final = msgpack.Packer(use_single_float=True, autoreset=True).pack
"""Numbers for a picture: seven digits are enough."""

_pack_exactly: Final = msgpack.Packer(autoreset=True).pack


class Frames:
    """The newest state of a fleet, and when each of its slow parts last changed.

    Attributes:
        revision: counts the changes of slow parts; a client that has all of them has this one.
        seq: counts the states.
    """

    def __init__(self) -> None:
        self.revision = 0
        self.seq = 0
        self._fast = b""
        self._parts: dict[str, tuple[int, bytes]] = {}
        self._details: dict[str, tuple[int, bytes]] = {}
        self._events: list[tuple[int, bytes]] = []
        self._made: dict[int, bytes] = {}

    def set_part(self, name: str, value: Any) -> None:
        """Set a slow part; it has changed when its bytes have.

        Args:
            name: of the part.
            value: of the part.
        """
        packed = _pack_exactly(value)
        known = self._parts.get(name)
        if known is None or known[1] != packed:
            self._parts[name] = self._next(), packed

    def set_detail(self, robot: str, value: Mapping[str, Any]) -> None:
        """Set what is slow of one robot.

        Args:
            robot: its name.
            value: its details.
        """
        packed = _pack_exactly(value)
        known = self._details.get(robot)
        if known is None or known[1] != packed:
            self._details[robot] = self._next(), packed

    def add_event(self, event: Any, most: int) -> None:
        """Add an event.

        Args:
            event: the event.
            most: how many are kept.
        """
        self._events.append((self._next(), _pack_exactly(event)))
        del self._events[:-most]

    def set_state(self, t: float, robots: Mapping[str, Any]) -> None:
        """Set what is new in every state.

        Args:
            t: the time [s].
            robots: what is fast, by the robot's name.
        """
        self.seq += 1
        self._made.clear()
        self._fast = b"".join(
            (
                *(_text("kind"), _text("state"), _text("t"), _pack_exactly(t)),
                *(_text("seq"), _pack(self.seq), _text("robots"), _pack(robots)),
            )
        )

    def since(self, revision: int) -> bytes:
        """The newest state, as one who has the slow parts up to a revision needs it.

        Args:
            revision: what was sent to him last; -1 for nothing.
        """
        made = self._made.get(revision)
        if made is None:
            made = self._made[revision] = self._make(revision)
        return made

    def _make(self, revision: int) -> bytes:
        parts = [b"", self._fast]
        count = 4
        for name, (changed, packed) in self._parts.items():
            if changed > revision:
                parts += [_text(name), packed]
                count += 1
        details = [(name, packed) for name, (changed, packed) in self._details.items() if changed > revision]
        if details:
            packer = msgpack.Packer()
            parts += [_text("details"), packer.pack_map_header(len(details))]
            parts += [part for name, packed in details for part in (_text(name), packed)]
            count += 1
        events = [packed for added, packed in self._events if added > revision]
        if events:
            parts += [_text("events"), msgpack.Packer().pack_array_header(len(events)), *events]
            count += 1
        parts[0] = msgpack.Packer().pack_map_header(count)
        return b"".join(parts)

    def _next(self) -> int:
        self.revision += 1
        self._made.clear()
        return self.revision


def _text(text: str) -> bytes:
    packed: bytes = _pack(text)
    return packed
