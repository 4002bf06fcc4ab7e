"""Texts for settings errors: the value found, and what a type expects."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal, get_args, get_origin

from msgspec import Meta

from muro_zenoh.quantities import Quantity

_PLAIN: Final[dict[Any, str]] = {float: "a number", int: "a whole number", str: "text", bool: "true or false"}


def show(value: object) -> str:
    """A value as in the file, with its kind."""
    kind = {bool: "boolean", int: "integer", float: "number", str: "text", list: "array", dict: "table"}
    return f"{value!r} ({kind.get(type(value), type(value).__name__)})"


def expected(kind: Any) -> str:
    """The values of a type, in words.

    Args:
        kind: the type, with its limits.
    """
    base = get_args(kind)[0] if get_origin(kind) is Annotated else kind
    notes = getattr(kind, "__metadata__", ())
    if quantity := next((note for note in notes if isinstance(note, Quantity)), None):
        return str(quantity)
    if get_origin(base) is Literal:
        return "one of " + ", ".join(repr(value) for value in get_args(base))
    if base in _PLAIN:
        patterns = [f"like {note.pattern}" for note in notes if isinstance(note, Meta) and note.pattern]
        return " ".join([_PLAIN[base], *patterns])
    options = [option for option in get_args(base) if option is not type(None)]
    if get_origin(base) is tuple:
        return f"an array of {expected(options[0])}"
    return " or ".join(map(expected, options)) if options else str(base)
