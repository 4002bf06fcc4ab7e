"""The base of every message, and the check that all its numbers are finite."""

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
        total = sum(scalars(self))
        for name in vectors:
            total = sum(getattr(self, name), total)
        # One sum tests all numbers; only if it is not finite is the field searched for.
        if not math.isfinite(total):
            others = tuple(field.name for field in msgspec.structs.fields(type(self)))
        for name in others:
            require_finite(name, getattr(self, name))


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


def require_finite(field: str, value: Any) -> None:
    """Refuse NaN and infinities in a value and in its items.

    Args:
        field: the value's name, for the error.
        value: a number, or a tuple or dict of values; other types pass.

    Raises:
        ValueError: a number is not finite.
    """
    if isinstance(value, float):
        if not math.isfinite(value):
            raise ValueError(f"{field}: got {value}, expected a finite number")
    elif isinstance(value, tuple):
        for item in value:
            require_finite(field, item)
    elif isinstance(value, dict):
        for key, item in value.items():
            require_finite(f"{field}.{key}", item)
