"""Delta debugging: the fewest parts of something that still break."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

T = TypeVar("T")


def fewest(parts: Sequence[T], breaks: Callable[[Sequence[T]], bool], guesses: Iterable[Sequence[T]] = ()) -> list[T]:
    """A part of a sequence that breaks, and of which no single one can be left out.

    Args:
        parts: all of them, which break; their order is kept.
        breaks: whether some of them break.
        guesses: parts that may suffice, tried first; the smallest that breaks is where the search begins.

    Source: A. Zeller and R. Hildebrandt, Simplifying and isolating failure-inducing input, 2002: ``ddmin``.
    """
    left = list(parts)
    for guess in sorted(guesses, key=len):
        if len(guess) < len(left) and breaks(guess):
            left = list(guess)
            break
    pieces = 2
    while left:
        size = max(1, len(left) // pieces)
        chunks = [left[i : i + size] for i in range(0, len(left), size)]
        for index in range(len(chunks)):
            rest = [part for other, chunk in enumerate(chunks) if other != index for part in chunk]
            if breaks(rest):
                left, pieces = rest, max(pieces - 1, 2)
                break
        else:
            if size == 1:
                break
            pieces = min(2 * pieces, len(left))
    return left


def least(low: float, high: float, breaks: Callable[[float], bool], step: float) -> float:
    """The least number, to within a step, that breaks, by bisection.

    Args:
        low: does not break, or is not tried.
        high: breaks.
        breaks: whether a number breaks; a greater one should when a smaller one does.
        step: precision.
    """
    while high - low > step:
        middle = 0.5 * (low + high)
        if breaks(middle):
            high = middle
        else:
            low = middle
    return high
