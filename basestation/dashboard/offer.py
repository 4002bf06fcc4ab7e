"""Where a base station offers its page, and what its operator is told of it."""

from __future__ import annotations

import contextlib
import errno
import importlib.util
import socket
from pathlib import Path
from typing import Final, NamedTuple

from basestation.dashboard.access import Address, Tokens, address_of, tokens_in
from muro_zenoh.errors import ConfigError, MissingExtra

DEFAULT: Final = Address("127.0.0.1", 8010)
"""Where the page is served unless the operator says otherwise."""

_PACKAGES: Final = ("starlette", "uvicorn", "websockets")


class Offer(NamedTuple):
    """A page that is to be served.

    Attributes:
        address: where.
        file: of its tokens.
        tokens: its tokens.
        note: why it is not where it usually is; empty when it is.
    """

    address: Address
    file: Path
    tokens: Tokens
    note: str = ""

    @property
    def lines(self) -> list[str]:
        """What the operator is told."""
        url, lines = self.address.url, [self.note] if self.note else []
        looking = url if self.address.is_local else f"{url}/#token={self.tokens.viewer}"
        return [*lines, f"page: {url}/#token={self.tokens.operator}", f"      to look and to stop only: {looking}"]

    @property
    def options(self) -> tuple[str, ...]:
        """The options of a base station, or of the page's process, that serve it."""
        return "--web", self.address.text, "--tokens", str(self.file)


def offer(web: str | None, file: Path) -> Offer | str:
    """The page that a base station serves.

    Args:
        web: where, as the operator says; None for the default address, or for a free port when that is taken.
        file: of its tokens; made when there is none.

    Returns:
        The page; or why there is none, where nobody asked for it.

    Raises:
        ConfigError: an invalid address, one that cannot be listened on, or a file that is none of tokens.
        MissingExtra: a package is missing for the page that was asked for.
    """
    missing = [name for name in _PACKAGES if importlib.util.find_spec(name) is None]
    if missing:
        error = MissingExtra("web", "the page needs a web server", missing[0])
        if web is not None:
            raise error
        return f"no page: {error}"
    if web is not None:
        address = address_of(web)
        return Offer(_checked(address), file, tokens_in(file))
    try:
        tokens = tokens_in(file)
        if is_free(DEFAULT):
            return Offer(DEFAULT, file, tokens)
        with contextlib.closing(listen(DEFAULT.host, 0)) as probe:
            address = Address(DEFAULT.host, probe.getsockname()[1])
    except (ConfigError, OSError) as error:  # nobody asked for it, and the base station is needed
        return f"no page: {error}"
    note = f"port {DEFAULT.port} is in use, so the page of this fleet is on port {address.port}"
    return Offer(address, file, tokens, note)


def _checked(address: Address) -> Address:
    """An address of this machine, with a free port in place of 0. One that is in use may be left in a moment, by the
    page of the base station before."""
    try:
        with contextlib.closing(listen(address.host, address.port)) as probe:
            return Address(address.host, probe.getsockname()[1])
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            return address
        raise ConfigError(
            "--web",
            got=f"{address.text}: {error.strerror or error}",
            expected="an address of this machine and a port that this user may listen on",
        ) from None


def is_free(address: Address) -> bool:
    """Whether an address can be listened on now.

    Args:
        address: which.
    """
    try:
        listen(*address).close()
    except OSError:
        return False
    return True


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens.

    Args:
        host: where.
        port: which; 0 for a free one.

    Raises:
        OSError: it is taken, or not of this machine.
    """
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    family, kind, proto, _, address = found[0]
    listening = socket.socket(family, kind, proto)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            with contextlib.suppress(OSError):
                listening.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)
        listening.bind(address)
        listening.listen(128)
        listening.setblocking(False)
    except OSError:
        listening.close()
        raise
    return listening


def tokens_beside(state: Path) -> Path:
    """The file of the tokens of a base station, beside that of its kept state.

    Args:
        state: the file of the kept state.
    """
    return state.with_name(f"{state.stem}-tokens.json")


__all__ = ["DEFAULT", "Offer", "is_free", "listen", "offer", "tokens_beside"]
