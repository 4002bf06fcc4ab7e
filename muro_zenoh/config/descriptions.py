"""What a settings error says: what was got, and what a type expects."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal, get_args, get_origin

from msgspec import Meta


def show(value: object) -> str:
    """A value as the file has it, with its kind."""
    kind = {bool: "boolean", int: "integer", float: "number", str: "text", list: "array", dict: "table"}
    return f"{value!r} ({kind.get(type(value), type(value).__name__)})"


def unit_of(kind: type, key: str) -> str:
    """The unit that a section's docstring gives an attribute, such as ``[m]``; empty when it has none."""
    entry = re.search(rf"^ +{key}: (.*?)(?=^ +\w+: |\Z)", kind.__doc__ or "", re.MULTILINE | re.DOTALL)
    found = re.search(r"\[[^\]]+\]", entry.group(1)) if entry else None
    return found.group() if found else ""


def expected(kind: Any, unit: str = "") -> str:
    """What a type takes, in words.

    Args:
        kind: the type, with its bounds.
        unit: such as ``[m]``.
    """
    return f"{_words(kind)} {unit}".strip()


def _words(kind: Any) -> str:
    meta = [m for m in getattr(kind, "__metadata__", ()) if isinstance(m, Meta)]
    base = get_args(kind)[0] if get_origin(kind) is Annotated else kind
    if get_origin(base) is Literal:
        return "one of " + ", ".join(repr(a) for a in get_args(base))
    if base is float and not meta:
        return "a number"
    plain = {float: "a number", int: "a whole number", str: "text", bool: "true or false"}
    if base in plain:
        words = [plain[base]]
        for m in meta:
            bounds = (("above", m.gt), ("at least", m.ge), ("below", m.lt), ("at most", m.le))
            words += [f"{word} {bound:g}" for word, bound in bounds if bound is not None]
            if m.pattern:
                words.append(f"like {m.pattern}")
        return " ".join(words)
    options = [a for a in get_args(base) if a is not type(None)]
    if get_origin(base) is tuple or base is tuple:
        return f"an array of {_words(options[0])}"
    if options:
        return " or ".join(_words(a) for a in options)
    return str(base)
