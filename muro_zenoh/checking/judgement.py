"""What came of a promise in one trial, and the times at which something was so."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from muro_zenoh.checking.record import Flags, Record


class Breach(NamedTuple):
    """A ``promise`` was broken at ``time`` [s], by these ``robots``: ``what`` happened, in words."""

    promise: str
    time: float
    robots: tuple[str, ...]
    what: str

    def __str__(self) -> str:
        return f"{self.what} at {self.time:.1f} s"


class Judgement(NamedTuple):
    """How many times a promise was ``evaluated`` in a record, and the ``breaches``."""

    evaluated: int
    breaches: tuple[Breach, ...]


def episodes(flags: Flags) -> list[tuple[int, int]]:
    """The runs of True: first index, and the one after the last.

    Args:
        flags: (T,).
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def between(record: Record, start: float, end: float) -> Flags:
    """Which samples (T,) are between two times.

    Args:
        record: the record.
        start: the first time [s].
        end: the last time [s].
    """
    within: Flags = (record.time >= start) & (record.time <= end)
    return within
