"""Who may open the page: tokens, and the checks of ``Host`` and ``Origin``."""

from __future__ import annotations

import hmac
import ipaddress
import json
import os
import secrets
import socket
from collections.abc import Collection
from enum import Enum
from pathlib import Path
from typing import Final, NamedTuple

from muro_zenoh.errors import ConfigError

PROTOCOL: Final = "muro"
_TOKEN: Final = "token."

_ELSEWHERE: Final = {"0.0.0.0": (socket.AF_INET, "192.0.2.1"), "::": (socket.AF_INET6, "2001:db8::1")}
"""For all addresses of this machine, one of nobody (RFC 5737, RFC 3849): the way there has this machine's address."""


class Right(Enum):
    """What a client may do."""

    NONE = 0
    VIEW = 1
    """Read, and stop robots."""
    STEER = 2
    """Everything."""


class Tokens(NamedTuple):
    """The tokens of a base station: the ``viewer``'s, and the ``operator``'s."""

    viewer: str
    operator: str


def tokens_in(file: Path) -> Tokens:
    """The tokens in a file; new ones are written to it when there is none, so that links outlive a restart.

    Args:
        file: the file; nobody but its owner can read it.

    Raises:
        ConfigError: it cannot be read or written, or has no tokens.
    """
    try:
        try:
            known = json.loads(file.read_text())
            return Tokens(str(known["viewer"]), str(known["operator"]))
        except FileNotFoundError:
            tokens = Tokens(secrets.token_urlsafe(16), secrets.token_urlsafe(16))
            with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as new:
                json.dump(tokens._asdict(), new)
            return tokens
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(
            str(file), got=str(error), expected="the tokens of the page", hint="Remove the file, and new ones are made."
        ) from None


class Address(NamedTuple):
    """Where the page is served: ``host``, a name or an address, and ``port``."""

    host: str
    port: int

    @property
    def is_local(self) -> bool:
        """Whether only this machine reaches it."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def text(self) -> str:
        """``HOST:PORT``, as it is typed."""
        return f"{_bracketed(self.host)}:{self.port}"

    @property
    def url(self) -> str:
        """What to open in a browser, without a token."""
        host = _of_this_machine(self.host) if self.host in _ELSEWHERE else self.host
        return f"http://{_bracketed(host)}:{self.port}"


def address_of(text: str) -> Address:
    """An address as it is typed.

    Args:
        text: ``HOST:PORT``, or ``[HOST]:PORT`` for an IPv6 address.

    Raises:
        ConfigError: it is not one.
    """
    host, colon, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not colon or not host or not port.isascii() or not port.isdigit() or not int(port) < 65536:
        raise ConfigError("--web", got=repr(text), expected="HOST:PORT, such as 127.0.0.1:8010")
    return Address(host, int(port))


class Access:
    """Decides what a client may do.

    Args:
        address: where the page is served.
        tokens: of this base station.

    Attributes:
        address: the same.
    """

    def __init__(self, address: Address, tokens: Tokens) -> None:
        self.address = address
        self._tokens = tokens

    def right(self, protocols: Collection[str]) -> Right:
        """What a client may do.

        Args:
            protocols: the WebSocket's subprotocols that it asks for; its token is among them.
        """
        for protocol in protocols:
            if not protocol.startswith(_TOKEN):
                continue
            token = protocol.removeprefix(_TOKEN).encode()
            if hmac.compare_digest(token, self._tokens.operator.encode()):
                return Right.STEER
            if hmac.compare_digest(token, self._tokens.viewer.encode()):
                return Right.VIEW
            return Right.NONE
        return Right.VIEW if self.address.is_local else Right.NONE

    def admits_host(self, host: str) -> bool:
        """Whether a ``Host`` is this server. A page of a stranger whose name leads here by a trick in the DNS is not.

        Args:
            host: the header.
        """
        name, colon, port = host.rpartition(":")
        if not colon or host.endswith("]"):  # browsers leave out the port 80
            name, port = host, "80"
        name = name.removeprefix("[").removesuffix("]").lower()
        if port != str(self.address.port):
            return False
        if self.address.is_local:
            return name in ("localhost", "127.0.0.1", "::1", self.address.host)
        ours = socket.gethostname().lower()
        return _is_number(name) or name in ("localhost", ours, f"{ours}.local", self.address.host.lower())

    def admits_origin(self, origin: str | None, host: str) -> bool:
        """Whether a WebSocket comes from a page of this server. Browsers always say; a program may leave it out.

        Args:
            origin: the header; None without one.
            host: the header ``Host``.
        """
        return origin is None or origin in (f"http://{host}", f"https://{host}")


def _of_this_machine(everywhere: str) -> str:
    """An address at which others reach this machine; its name when it has no network."""
    family, elsewhere = _ELSEWHERE[everywhere]
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as asking:
            asking.connect((elsewhere, 9))  # nothing is sent
            return str(asking.getsockname()[0])
    except OSError:
        return socket.gethostname()


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def _is_number(host: str) -> bool:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True
