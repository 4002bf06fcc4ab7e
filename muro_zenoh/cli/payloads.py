"""Typed keys, and payloads as text."""

from __future__ import annotations

import json
import re

import msgpack  # type: ignore[import-untyped]  # it publishes no types

from muro_zenoh.errors import ConfigError

_CHUNK = re.compile(r"\*\*|\*|([^*$#?/]|\$\*)+")
_RAW_SHOWN = 32


def full_key(expression: str, realm: str) -> str:
    """The full key expression of a typed one: within the realm, unless it begins with the realm, ``**`` or ``/``.

    Args:
        expression: the typed key expression.
        realm: the first word of our keys.

    Raises:
        ConfigError: it is not a Zenoh key expression.
    """
    if expression.startswith("/"):
        full = expression[1:]
    elif expression.split("/")[0] == "**" or expression == realm or expression.startswith(f"{realm}/"):
        full = expression
    else:
        full = f"{realm}/{expression}"
    if not all(_CHUNK.fullmatch(chunk) for chunk in full.split("/")):
        raise ConfigError(
            "KEY", got=repr(expression), expected="words joined by '/', * for any word and ** for any words"
        )
    return full


def type_of(encoding: str | None) -> str:
    """The message type in a payload's encoding, or the encoding itself when it has none.

    Args:
        encoding: the Zenoh encoding.
    """
    base, _, schema = (encoding or "").partition(";")
    return schema or base or "-"


def shown(payload: bytes, encoding: str | None) -> str:
    """A payload as text: MessagePack as JSON, text as it is, anything else as raw bytes.

    Args:
        payload: the bytes.
        encoding: the Zenoh encoding, as set by the writer.
    """
    base = (encoding or "").partition(";")[0]
    if base.startswith("text/") or base == "application/json":
        return payload.decode(errors="replace")
    try:
        value = msgpack.unpackb(payload, raw=False, strict_map_key=False)
        # Almost any byte is a valid MessagePack number: without that encoding only a map is decoded as MessagePack.
        if base == "application/msgpack" or isinstance(value, dict):
            return json.dumps(value, default=_beyond_json, ensure_ascii=False)
    except (ValueError, TypeError, msgpack.UnpackException):
        pass
    more = "..." if len(payload) > _RAW_SHOWN else ""
    return f"<{len(payload)} raw bytes, encoding {base or 'unknown'}: {payload[:_RAW_SHOWN].hex(' ')}{more}>"


def _beyond_json(value: object) -> str:
    return f"<{len(value)} bytes>" if isinstance(value, bytes) else repr(value)
