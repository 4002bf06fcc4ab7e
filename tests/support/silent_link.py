"""A connection of a page that falls silent, as one does whose network is gone."""

from __future__ import annotations

from playwright.async_api import WebSocketRoute


class SilentLink:
    """A connection between a page and its base station that stays open, and may let nothing pass."""

    def __init__(self) -> None:
        self._passes = True

    def connected(self, page: WebSocketRoute) -> None:
        """A page connects."""
        base = page.connect_to_server()
        page.on_message(lambda message: base.send(message) if self._passes else None)
        base.on_message(lambda message: page.send(message) if self._passes else None)

    async def cut(self) -> None:
        """Let nothing pass: neither end learns of it."""
        self._passes = False

    def mend(self) -> None:
        """Let everything pass again."""
        self._passes = True
