"""The base of every message, and the check that its numbers are finite and not absurdly large."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import cache, lru_cache
from operator import attrgetter
from typing import Annotated, Any, get_args, get_origin

import msgspec
from msgspec import Meta, Struct

Covariance = Annotated[tuple[float, ...], Meta(min_length=9, max_length=9)]
"""Nine floats, row-major, of x [m], y [m], theta [rad]."""

_NAME = r"^[a-z][a-z0-9_]{0,31}$"

Name = Annotated[str, Meta(pattern=_NAME)]
"""A robot's, a camera's or a process's name."""


MOST_NAMES = 1000
"""A list has at most so many names."""

Names = Annotated[tuple[Name, ...], Meta(max_length=MOST_NAMES)]
"""Robots."""


@lru_cache(maxsize=64)
def require_names(names: tuple[str, ...]) -> None:
    """Refuse texts that are not a :data:`Name`. Results are cached, because the same names are checked again and again.

    Args:
        names: the texts.

    Raises:
        ValueError: one is not a name.
    """
    for name in names:
        if not re.fullmatch(_NAME, name):
            raise ValueError(f"name: got {name!r}, expected lower-case letters, digits and _, at most 32")


LARGEST = 1e12
"""Greater numbers are refused: no distance, age or speed is as large, and their squares could overflow in a law."""

Value = bool | int | float | str | tuple[float | str | tuple[float, ...], ...]
"""The type of a behaviour's parameter."""


class Message(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all messages. A message whose ``stamp`` is 0 is stamped and numbered when it is sent.

    Attributes:
        stamp: when it was made (for odometry: when it was measured) [s since 1970, the writer's clock].
        seq: counts a writer's messages on one key from 1.
        epoch: identifies the writer's process; a random number drawn at its start.
    """

    stamp: float = 0.0
    seq: Annotated[int, Meta(ge=0)] = 0
    epoch: Annotated[int, Meta(ge=0)] = 0

    def __post_init__(self) -> None:
        scalars, vectors, others = _number_fields(type(self))
        length = math.hypot(*scalars(self))
        for name in vectors:
            length = math.hypot(length, *getattr(self, name))
        # One call tests all numbers, including NaN and infinities; only if it fails is the field searched for.
        if not length <= LARGEST:
            others = tuple(field.name for field in msgspec.structs.fields(type(self)))
        for name in others:
            require_usable(name, getattr(self, name))


class Order(Message, frozen=True, kw_only=True):
    """Base of the orders that are refused once their sender waits for an answer no longer.

    Attributes:
        until: the end of that wait [s since 1970, a base station's clock]; nil when the sender has not asked for the
            time, and takes an order at any age for given.
        clock: the ``epoch`` of that base station.
    """

    until: float | None = None
    clock: Annotated[int, Meta(ge=0)] = 0


@cache
def _number_fields(
    kind: type[Message],
) -> tuple[Callable[[Message], tuple[float, ...]], tuple[str, ...], tuple[str, ...]]:
    """A getter of the plain floats, the fields that are tuples of floats, and all other fields that may hold floats."""
    types = {field.name: field.type for field in msgspec.structs.fields(kind)}
    scalars = [name for name, annotation in types.items() if _bare(annotation) is float]
    vectors = tuple(name for name, annotation in types.items() if _bare(annotation) == tuple[float, ...])
    others = tuple(
        name
        for name, annotation in types.items()
        if name not in scalars and name not in vectors and _holds_float(annotation)
    )
    # Every message has a stamp. Twice, for an attrgetter of one name gives no tuple.
    return attrgetter(*scalars, "stamp"), vectors, others


def _bare(annotation: Any) -> Any:
    return get_args(annotation)[0] if get_origin(annotation) is Annotated else annotation


def _holds_float(annotation: Any) -> bool:
    return annotation is float or any(_holds_float(part) for part in get_args(annotation))


def require_usable(field: str, value: Any) -> None:
    """Refuse NaN, infinities and numbers beyond :data:`LARGEST` in a value and in its items.

    Args:
        field: the value's name, for the error.
        value: a number, or a tuple or dict of values; other types pass.

    Raises:
        ValueError: a number is refused.
    """
    for item in value if isinstance(value, tuple) else (value,):
        if isinstance(item, float):
            if not abs(item) <= LARGEST:
                raise ValueError(f"{field}: got {item}, expected a finite number of at most {LARGEST:g}")
        elif isinstance(item, tuple):
            require_usable(field, item)
        elif isinstance(item, dict):
            for key, inner in item.items():
                require_usable(f"{field}.{key}", inner)
