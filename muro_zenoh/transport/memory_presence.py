"""The liveliness tokens of the in-memory network: who has declared which, and what each watcher has been shown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from muro_zenoh.transport.key_expressions import matches
from muro_zenoh.transport.link import FileToken

if TYPE_CHECKING:  # it is made of this
    from muro_zenoh.transport.memory_link import MemoryLink

CarryNews = Callable[["MemoryLink", Callable[[], None]], None]
"""Takes news to a link, over the router."""


@dataclass(slots=True, eq=False)
class Watcher:
    """Who wants to know of tokens.

    Attributes:
        link: its link.
        expression: of which tokens.
        file: is called with a key, and whether it is there.
        shown: what was sent to it.
        heard: what has arrived.
    """

    link: MemoryLink
    expression: str
    file: FileToken
    shown: dict[str, None]
    heard: dict[str, None]

    def hear(self, key: str, there: bool) -> None:
        """Take news that has arrived.

        Args:
            key: the token's.
            there: whether it is there now.
        """
        if there:
            self.heard[key] = None
        else:
            self.heard.pop(key, None)
        self.link.run(self.file, key, there)


class Presence:
    """The tokens of one network.

    Args:
        carry: takes news to a watcher's link.
    """

    def __init__(self, carry: CarryNews) -> None:
        self._carry = carry
        self._tokens: list[tuple[str, MemoryLink]] = []
        self._watchers: list[Watcher] = []

    def declare(self, key: str, link: MemoryLink) -> Callable[[], None]:
        """Declare a token.

        Args:
            key: its key.
            link: of the process that declares it.

        Returns:
            Takes it back.
        """
        token = key, link
        self._tokens.append(token)
        self.announce()

        def drop() -> None:
            if token in self._tokens:
                self._tokens.remove(token)
                self.announce()

        return drop

    def watch(self, expression: str, link: MemoryLink, file: FileToken) -> Callable[[], None]:
        """Watch tokens.

        Args:
            expression: which.
            link: of the process that watches.
            file: is called with a key, and whether it is there.

        Returns:
            Ends it.
        """
        watcher = Watcher(link, expression, file, {}, {})
        self._watchers.append(watcher)
        self._show(watcher)

        def end() -> None:
            if watcher in self._watchers:  # not once the link has left
                self._watchers.remove(watcher)

        return end

    def leave(self, link: MemoryLink) -> None:
        """Forget a link that has left: its tokens are gone.

        Args:
            link: the link.
        """
        self._watchers = [watcher for watcher in self._watchers if watcher.link is not link]
        self._tokens = [token for token in self._tokens if token[1] is not link]
        self.announce()

    def announce_again(self, link: MemoryLink) -> None:
        """A link's silence is over: news to it that was under way may have been lost.

        Args:
            link: the link.
        """
        for watcher in self._watchers:
            if watcher.link is link:
                watcher.shown = dict(watcher.heard)
        self.announce()

    def announce(self) -> None:
        """Tell each watcher which tokens have come and gone."""
        for watcher in self._watchers:
            self._show(watcher)

    def _show(self, watcher: Watcher) -> None:
        there = {
            key: None
            for key, link in self._tokens
            # Two processes may declare the same token: it is gone when both are.
            if matches(watcher.expression, key) and _sees(watcher, key, link)
        }
        if watcher.link.silent and not watcher.link.lapsed:
            there = {**watcher.shown, **there}  # of what goes it does not hear either
        gone = [(key, False) for key in watcher.shown if key not in there]
        come = [(key, True) for key in there if key not in watcher.shown]
        for news in (*gone, *come):
            deliver = partial(watcher.hear, *news)
            if watcher.link.lapsed:
                watcher.link.receive(deliver)  # its own end of the link reports that it is closed
            else:
                self._carry(watcher.link, deliver)
        watcher.shown = there


def _sees(watcher: Watcher, key: str, link: MemoryLink) -> bool:
    """Whether a link's token is shown to a watcher: silence shows no change until the lease has run out."""
    if link is watcher.link:
        return True
    if link.lapsed or watcher.link.lapsed:
        return False
    return key in watcher.shown if link.silent or watcher.link.silent else True
