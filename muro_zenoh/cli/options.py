"""Options that several commands share, and parsing of typed values."""

from __future__ import annotations

import functools
import re
import tomllib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import click

from muro_zenoh.errors import ConfigError

if TYPE_CHECKING:
    from muro_zenoh.config import BusSettings

F = TypeVar("F", bound=Callable[..., Any])

BusFlags = Callable[..., "BusSettings"]
"""What a command with :func:`bus_options` receives as ``bus``."""

_BARE = re.compile(r"[A-Za-z_][\w.:/-]*")


def example(*lines: str) -> str:
    """An epilog with examples.

    Args:
        lines: the commands.
    """
    return "\b\nExample" + ("s" if len(lines) > 1 else "") + ":\n" + "\n".join(f"  {line}" for line in lines)


def bus_options(command: F) -> F:
    """Zenoh's own flags, with the same meaning as in every Zenoh program, and ``--realm``.

    The command receives a function ``bus``: called with the file's :class:`~muro_zenoh.config.BusSettings`, or without
    any, it returns them overridden by the flags.

    Args:
        command: the function under the click decorators.
    """

    @click.option("--realm", metavar="WORD", help="First word of every key.  [default: muro]")
    @click.option("--config", metavar="FILE", help="A Zenoh configuration (JSON5); the other flags override it.")
    @click.option("--listen", metavar="ENDPOINT", multiple=True, help="Listen here; repeatable.")
    @click.option(
        "--connect",
        metavar="ENDPOINT",
        multiple=True,
        help="Connect there, such as tcp/127.0.0.1:7447; repeatable.  [default: tcp/127.0.0.1:7447]",
    )
    @click.option("--mode", type=click.Choice(["client", "peer", "router"]), help="Mode of the Zenoh session.")
    @functools.wraps(command)
    def with_bus(
        *args: Any,
        mode: str | None,
        connect: tuple[str, ...],
        listen: tuple[str, ...],
        config: str | None,
        realm: str | None,
        **kwargs: Any,
    ) -> Any:
        def settings(base: BusSettings | None = None) -> BusSettings:
            flags = {"mode": mode, "connect": connect, "listen": listen, "config": config, "realm": realm}
            return override_bus(base, flags)

        return command(*args, bus=settings, **kwargs)

    return with_bus  # type: ignore[return-value]  # called by click with the options' values


def web_options(command: F) -> F:
    """``--web`` and ``--no-web``. The command receives ``web``: an address, None for the default one, or ``off``.

    Args:
        command: the function under the click decorators.
    """

    @click.option("--no-web", is_flag=True, help="No page.")
    @click.option(
        "--web",
        metavar="HOST:PORT",
        envvar="MURO_WEB",
        help="Serve the page here; from other machines only with its token.  [default: 127.0.0.1:8010]",
    )
    @functools.wraps(command)
    def with_web(*args: Any, web: str | None, no_web: bool, **kwargs: Any) -> Any:
        return command(*args, web="off" if no_web else web, **kwargs)

    return with_web  # type: ignore[return-value]  # called by click with the options' values


def override_bus(base: BusSettings | None, flags: dict[str, Any]) -> BusSettings:
    """Bus settings, overridden by flags.

    Args:
        base: the file's settings; None for the defaults.
        flags: values by key of the settings; empty or None when a flag was not given.

    Raises:
        ConfigError: a flag has an invalid value.
    """
    import msgspec

    from muro_zenoh.channels import check_realm
    from muro_zenoh.config import BusSettings
    from muro_zenoh.config.sections import NetworkPoint

    given = {key: value for key, value in flags.items() if value}
    for key in ("connect", "listen"):
        for endpoint in given.get(key, ()):
            try:
                msgspec.convert((endpoint,), tuple[NetworkPoint, ...])
            except msgspec.ValidationError:
                raise ConfigError(
                    f"--{key}", got=repr(endpoint), expected="an endpoint such as tcp/127.0.0.1:7447"
                ) from None
    if "realm" in given:
        check_realm(given["realm"], "--realm")
    return msgspec.structs.replace(base or BusSettings(), **given)


def toml_value(text: str, where: str) -> object:
    """A TOML value; a bare word is text, so that no second pair of quotes is needed in a shell.

    Args:
        text: the typed text.
        where: the option, for the error.

    Raises:
        ConfigError: it is neither.
    """
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        if _BARE.fullmatch(text):
            return text
        raise ConfigError(
            where, got=repr(text), expected='a TOML value such as 0.9, true, [1, 2] or "text"', hint="Check the quotes."
        ) from None


def assignments(given: tuple[str, ...], where: str) -> dict[str, object]:
    """``KEY=VALUE`` arguments as a table by key.

    Args:
        given: the typed arguments.
        where: the option's name, for errors.

    Raises:
        ConfigError: no ``=``, no key, or not a value.
    """
    table: dict[str, object] = {}
    for text in given:
        key, equals, value = text.partition("=")
        key = key.strip()
        if not equals or not key or any(not part for part in key.split(".")):
            raise ConfigError(where, got=repr(text), expected="KEY=VALUE, such as circle.radius=0.9")
        table[key] = toml_value(value.strip(), f"{where} {key}")
    return table
