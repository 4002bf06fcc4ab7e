"""Key expressions as Zenoh has them, for the in-memory link."""

from __future__ import annotations

from functools import lru_cache


@lru_cache(maxsize=8192)
def matches(expression: str, key: str) -> bool:
    """Whether a key is in a key expression: ``*`` stands for one chunk, ``**`` for any number of them.

    Args:
        expression: the key expression.
        key: the key.
    """
    return _match(expression.split("/"), key.split("/"))


def _match(expression: list[str], key: list[str]) -> bool:
    if not expression:
        return not key
    head, rest = expression[0], expression[1:]
    if head == "**":
        return any(_match(rest, key[i:]) for i in range(len(key) + 1))
    return bool(key) and head in ("*", key[0]) and _match(rest, key[1:])
