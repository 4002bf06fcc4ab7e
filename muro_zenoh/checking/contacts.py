"""Contacts between robots in a record, classed by what the two were doing."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from muro_zenoh.checking.record import Flags, Record
from muro_zenoh.elementwise import Array

DISTURBING: Final = ("carry", "foreign_driver", "lie")
"""Faults after which a robot is not what the others take it for."""

AFTERWARDS: Final = 2.0
"""A robot counts as disturbed for this time after such a fault [s] ..."""

CLEARANCE: Final = 0.05
"""... and until it was once this far from every other body [m]."""

STANDING: Final = 0.01
"""A robot slower than this stands [m/s]."""

STOOD: Final = 1.6
"""Others have seen where a robot stands, and can have stopped before it, after this time [s]: 0.6 s of information, and
1 s to brake from any speed that a robot of this project has."""

_SEEN_BY: Final = 0.6
_BRAKING: Final = STOOD - _SEEN_BY
"""Nobody can know of a robot of which no picture has arrived this time [s] after it was put down, or after the start;
once one has, the others need this time to brake [s]."""


class ContactClass(StrEnum):
    """Who touched whom."""

    OURS = "ours"
    """Two robots that run the control loop and were not disturbed."""

    STANDING = "standing"
    """An undisturbed robot drove into a disturbed one that stood there."""

    DISTURBED = "disturbed"
    """Any other contact of a disturbed robot: it drove into another one, or was put down on it."""


class Contact(NamedTuple):
    """One episode of two bodies in touch, from ``time`` [s]; the ``kind``, and the ``robots``."""

    time: float
    kind: ContactClass
    robots: tuple[str, str]


def contacts(record: Record) -> Iterator[Contact]:
    """All contacts of a record, pair by pair.

    Args:
        record: the record.
    """
    disturbed = disturbances(record)
    standing = _standing(record) & ~_unknown(record)
    for i, j in itertools.combinations(range(len(record.names)), 2):
        touching = gaps(record, i, j) < 0.0
        for k in np.flatnonzero(touching & ~np.concatenate(([False], touching[:-1]))).tolist():
            kind = ContactClass.OURS
            if disturbed[k, i] or disturbed[k, j]:
                kind = ContactClass.DISTURBED
                for one, other in ((i, j), (j, i)):
                    # The other one moved, or it did not drive into anything.
                    moved = np.hypot(*record.twist[k, other]) > STANDING
                    if disturbed[k, one] and standing[k, one] and not disturbed[k, other] and moved:
                        kind = ContactClass.STANDING
            yield Contact(float(record.time[k]), kind, (record.names[i], record.names[j]))


def gaps(record: Record, i: int, j: int) -> Array:
    """The gap between two bodies (T,) [m]; negative when they overlap.

    Args:
        record: the record.
        i: a robot's index.
        j: the other's.
    """
    robots = record.scenario.robot
    apart: Array = np.hypot(*(record.pose[:, i, :2] - record.pose[:, j, :2]).T)
    return apart - robots[record.names[i]].radius - robots[record.names[j]].radius


def disturbances(record: Record) -> Flags:
    """Whether each robot is disturbed (T, N): from the effect of such a fault until it is over and done with.

    Args:
        record: the record.
    """
    disturbed = np.zeros((len(record.time), len(record.names)), dtype=bool)
    for i, name in enumerate(record.names):
        for effect in record.effects_on(name, *DISTURBING):
            clear = np.full(len(record.time), np.inf)
            for j in range(len(record.names)):
                if j != i:
                    clear = np.minimum(clear, gaps(record, i, j))
            over = np.flatnonzero((record.time >= effect.end + AFTERWARDS) & (clear >= CLEARANCE))
            end = int(over[0]) if len(over) else len(record.time)
            disturbed[np.searchsorted(record.time, effect.start) : end, i] = True
    return disturbed | _unknown(record)


def _unknown(record: Record) -> Flags:
    """Whether nobody can know where a robot stands (T, N): no camera has seen it yet, or since it was carried."""
    unknown = np.zeros((len(record.time), len(record.names)), dtype=bool)
    for i, name in enumerate(record.names):
        put_down = [(effect.end, effect.end) for effect in record.effects_on(name, "carry")]
        for begin, picture in [(0.0, -math.inf), *put_down]:
            later = np.flatnonzero((record.time >= begin) & (record.good_pose[:, i] > picture))
            seen = float(record.time[later[0]]) if len(later) else math.inf
            if seen > begin + _SEEN_BY:
                unknown[(record.time >= begin) & (record.time < seen + _BRAKING), i] = True
    return unknown


def _standing(record: Record) -> Flags:
    """Whether each robot has stood where it is for a while (T, N), neither driven nor carried."""
    moving = np.abs(record.twist[..., 0]) > STANDING
    step = np.zeros_like(moving, dtype=np.float64)
    step[1:] = np.hypot(*np.moveaxis(np.diff(record.pose[..., :2], axis=0), -1, 0))
    moving |= step > STANDING * np.gradient(record.time)[:, None] + 1e-9
    index = np.where(moving, np.arange(len(record.time))[:, None], -1)
    last = np.maximum.accumulate(index, axis=0)
    since = np.where(last >= 0, record.time[np.maximum(last, 0)], -np.inf)
    stood: Flags = record.time[:, None] - since >= STOOD
    return stood
