"""Words for people: numbers of things."""

from __future__ import annotations


def counted(number: int, noun: str) -> str:
    """A number of things, such as ``1 robot`` or ``2 robots``.

    Args:
        number: how many.
        noun: the singular; its plural ends in s.
    """
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
