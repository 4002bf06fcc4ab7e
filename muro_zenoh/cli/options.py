"""Options that several commands share, and how their errors look."""

from __future__ import annotations

import functools
import re
import tomllib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import click

from muro_zenoh.errors import ConfigError, MuroError

if TYPE_CHECKING:
    from muro_zenoh.config import BusSettings

F = TypeVar("F", bound=Callable[..., Any])

_BARE = re.compile(r"[A-Za-z_][\w.:/-]*")


def example(*lines: str) -> str:
    """An epilog with examples, as they are typed.

    Args:
        lines: commands.
    """
    return "\b\nExample" + ("s" if len(lines) > 1 else "") + ":\n" + "\n".join(f"  {line}" for line in lines)


def bus_options(command: F) -> F:
    """Zenoh's own flags, which mean what they mean in every Zenoh program, and ``--realm``.

    The command gets a :class:`~muro_zenoh.config.BusSettings` maker as ``bus``: called with the file's settings, or
    with none, it returns them with the flags laid over.

    Args:
        command: the function under the click decorators.
    """

    @click.option("--realm", metavar="WORD", help="First word of every key.  [default: muro]")
    @click.option("--config", metavar="FILE", help="A Zenoh configuration (JSON5); the other flags are laid over it.")
    @click.option("--listen", metavar="ENDPOINT", multiple=True, help="Listen here; repeatable.")
    @click.option(
        "--connect",
        metavar="ENDPOINT",
        multiple=True,
        help="Connect there, such as tcp/127.0.0.1:7447; repeatable.  [default: tcp/127.0.0.1:7447]",
    )
    @click.option("--mode", type=click.Choice(["client", "peer", "router"]), help="Of the Zenoh session.")
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
        def settings(ground: BusSettings | None = None) -> BusSettings:
            flags = {"mode": mode, "connect": connect, "listen": listen, "config": config, "realm": realm}
            return lay_over(ground, flags)

        return command(*args, bus=settings, **kwargs)

    return with_bus  # type: ignore[return-value]  # called by click with what the options say


def lay_over(ground: BusSettings | None, flags: dict[str, Any]) -> BusSettings:
    """Bus settings with flags laid over.

    Args:
        ground: the file's settings; None for the defaults.
        flags: by key of the settings; what is empty or None was not given.

    Raises:
        ConfigError: a flag's value is not one.
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
    return msgspec.structs.replace(ground or BusSettings(), **given)


def toml_value(text: str, where: str) -> object:
    """A value as TOML has it; a bare word is text, so that a shell's quotes need no quotes of their own.

    Args:
        text: what was typed.
        where: for the error.

    Raises:
        ConfigError: it is neither.
    """
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        if _BARE.fullmatch(text):
            return text
        raise ConfigError(
            where, got=repr(text), expected='a TOML value such as 0.9, true, [1, 2] or "text"', hint="Mind the quotes."
        ) from None


def assignments(given: tuple[str, ...], where: str) -> dict[str, object]:
    """``KEY=VALUE`` arguments as a table by key.

    Args:
        given: what was typed.
        where: the option's name, for errors.

    Raises:
        ConfigError: no ``=``, no key, or a value that is none.
    """
    table: dict[str, object] = {}
    for text in given:
        key, equals, value = text.partition("=")
        key = key.strip()
        if not equals or not key or any(not part for part in key.split(".")):
            raise ConfigError(where, got=repr(text), expected="KEY=VALUE, such as circle.radius=0.9")
        table[key] = toml_value(value.strip(), f"{where} {key}")
    return table


class MuroGroup(click.Group):
    """A group whose commands report this project's errors in one line: exit code 2 for wrong settings, else 1."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except MuroError as error:
            click.echo(f"{ctx.find_root().info_name}: {error}", err=True)
            ctx.exit(2 if isinstance(error, ConfigError) else 1)
