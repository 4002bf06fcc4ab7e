"""From messages to bytes and back.

A wrong type, an unknown or missing field, NaN and infinities raise a :class:`MessageError`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, Final, TypeVar, get_args, get_origin

import msgspec

from muro_zenoh.errors import MessageError
from muro_zenoh.messages.base import Message

VERSION = 1
"""Version of all message layouts; it is part of the encoding, as in ``application/msgpack;PoseFix.1``."""

MAX_PAYLOAD = 8 * 2**20
"""Larger payloads are rejected without decoding [bytes]; a 1080p grey frame is 2 MB."""

LAST_STAMP = 1e11
"""Later stamps are invalid [s since 1970]; it is in the year 5138."""

M = TypeVar("M", bound=Message)


encode: Final[Callable[[Message], bytes]] = msgspec.msgpack.Encoder().encode
"""The message as a MessagePack map."""


def decode(data: bytes, kind: type[M]) -> M:
    """A message from its bytes.

    Args:
        data: the bytes.
        kind: the expected message type.

    Raises:
        MessageError: the bytes are not such a message: more than :data:`MAX_PAYLOAD`, not MessagePack, a wrong type, an
            unknown or missing field, a number that is not finite or absurdly large, no stamp or an invalid one.
    """
    message: M = decoder(kind)(data)
    return message


@cache
def decoder(kind: type[M]) -> Callable[[bytes], M]:
    """:func:`decode` for one kind, to decode many.

    Args:
        kind: the expected message type.
    """
    raw = msgspec.msgpack.Decoder(kind).decode
    shareable = not any(_holds_dict(field.type) for field in msgspec.structs.fields(kind))
    known: tuple[bytes, M | None] = b"", None

    def decode_it(data: bytes) -> M:
        # In a fleet in memory every robot decodes the same bytes, and a frozen message can be shared.
        nonlocal known
        if data is known[0] and known[1] is not None:
            return known[1]
        if len(data) > MAX_PAYLOAD:
            raise MessageError(f"got {len(data)} bytes, expected at most {MAX_PAYLOAD}")
        try:
            message: M = raw(data)
        except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
            raise MessageError(f"{kind.__name__}: {error}") from error
        if not 0.0 < message.stamp <= LAST_STAMP:
            raise MessageError(f"{kind.__name__}: got stamp {message.stamp!r}, expected seconds since 1970")
        if shareable:
            known = data, message
        return message

    return decode_it


def _holds_dict(annotation: Any) -> bool:
    return get_origin(annotation) is dict or any(map(_holds_dict, get_args(annotation)))


def encoding_of(kind: type[Message]) -> str:
    """The Zenoh encoding of a message type, such as ``application/msgpack;PoseFix.1``."""
    return f"application/msgpack;{kind.__name__}.{VERSION}"


def check_encoding(encoding: str | None, kind: type[Message]) -> None:
    """Refuse bytes whose encoding says something else. Without an encoding version 1 is assumed.

    Raises:
        MessageError: another type, another version, or no MessagePack at all.
    """
    if encoding is None or encoding in _UNSPECIFIED or encoding == encoding_of(kind):
        return
    raise MessageError(f"{kind.__name__}: got encoding {encoding!r}, expected {encoding_of(kind)!r}")


_UNSPECIFIED = frozenset({"", "zenoh/bytes", "application/octet-stream", "application/msgpack"})
