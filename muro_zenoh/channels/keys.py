"""Names and keys.

A key is ``<realm>/<channel>`` or ``<realm>/<channel>/<name>``. The realm is ``muro`` unless the settings say otherwise,
so that labs can share a network.
"""

from __future__ import annotations

import re
from typing import Any, Final

from muro_zenoh.channels.kinds import Channel, Verb
from muro_zenoh.errors import ConfigError

__all__ = [
    "NAME_PATTERN",
    "alive_in",
    "alive_key",
    "check_name",
    "check_realm",
    "key_of",
    "name_in",
    "verb_key",
]

NAME_PATTERN: Final = re.compile(r"[a-z][a-z0-9_]{0,31}")
_REALM_PATTERN: Final = re.compile(r"[a-z][a-z0-9_]{0,31}(/[a-z][a-z0-9_]{0,31})*")


def check_name(name: str, where: str = "name") -> str:
    """Return the name if it is valid. Zenoh would accept spaces and wildcards; we do not.

    Args:
        name: of a robot, a camera or a process.
        where: what has the name, for the error.

    Raises:
        ConfigError: it does not match ``[a-z][a-z0-9_]{0,31}``.
    """
    if not NAME_PATTERN.fullmatch(name):
        raise ConfigError(
            where, got=repr(name), expected="lower-case letters, digits and _, at most 32, a letter first"
        )
    return name


def check_realm(realm: str, where: str = "bus.realm") -> str:
    """Return the realm if it is valid: names joined by ``/``.

    Args:
        realm: the first words of every key.
        where: the setting, for the error.

    Raises:
        ConfigError: it is not.
    """
    if not _REALM_PATTERN.fullmatch(realm):
        raise ConfigError(where, got=repr(realm), expected="a name such as 'muro', or names joined by '/'")
    return realm


def key_of(realm: str, channel: Channel[Any], name: str = "") -> str:
    """The key of a channel, or its key expression when ``name`` is ``*``.

    Args:
        realm: the first words of the key.
        channel: the channel.
        name: the robot's (camera's, process's) name, where the channel has names.

    Raises:
        ConfigError: a name where the channel has none, no name where it needs one, or an invalid one.
    """
    _check_named(channel.named, name, f"channel {channel.word}", any_name=True)
    return f"{realm}/{channel.word}/{name}" if name else f"{realm}/{channel.word}"


def name_in(realm: str, channel: Channel[Any], key: str) -> str:
    """The name in a channel's key; empty for a channel without names."""
    return key[len(realm) + len(channel.word) + 2 :]


def verb_key(realm: str, verb: Verb[Any], name: str = "") -> str:
    """The key of an order: ``<realm>/<order>/<name>``, or ``<realm>/<role>/<order>`` where only one process answers.

    Args:
        realm: the first words of the key.
        verb: the order.
        name: the recipient, where the order has names.

    Raises:
        ConfigError: a name where the order has none, no name where it needs one, or an invalid one.
    """
    _check_named(verb.named, name, f"order {verb.word}")
    return f"{realm}/{verb.word}/{name}" if name else f"{realm}/{verb.answered_by}/{verb.word}"


def alive_key(realm: str, role: str, name: str) -> str:
    """The key of a liveliness token."""
    return f"{realm}/alive/{role}/{name}"


def alive_in(realm: str, key: str) -> tuple[str, str]:
    """Role and name in the key of a liveliness token."""
    role, _, name = key[len(realm) + len("/alive/") :].partition("/")
    return role, name


def _check_named(named: str, name: str, where: str, *, any_name: bool = False) -> None:
    if not named:
        if name:
            raise ConfigError(where, got=f"the name {name!r}", expected="no name: it has one key only")
    elif not (any_name and name == "*"):
        check_name(name, where)
