"""Contacts between robots in a trace, classed by what the two were doing."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from muro_zenoh.checking.trace import Flags, Trace
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


def contacts(trace: Trace) -> Iterator[Contact]:
    """All contacts of a trace, pair by pair.

    Args:
        trace: the trace.
    """
    disturbed = disturbances(trace)
    standing = _standing(trace)
    for i, j in itertools.combinations(range(len(trace.names)), 2):
        touching = gaps(trace, i, j) < 0.0
        for k in np.flatnonzero(touching & ~np.concatenate(([False], touching[:-1]))).tolist():
            kind = ContactClass.OURS
            if disturbed[k, i] or disturbed[k, j]:
                kind = ContactClass.DISTURBED
                for one, other in ((i, j), (j, i)):
                    # The other one moved, or it did not drive into anything.
                    moved = np.hypot(*trace.twist[k, other]) > STANDING
                    if disturbed[k, one] and standing[k, one] and not disturbed[k, other] and moved:
                        kind = ContactClass.STANDING
            yield Contact(float(trace.time[k]), kind, (trace.names[i], trace.names[j]))


def gaps(trace: Trace, i: int, j: int) -> Array:
    """The gap between two bodies (T,) [m]; negative when they overlap.

    Args:
        trace: the trace.
        i: a robot's index.
        j: the other's.
    """
    robots = trace.scenario.robot
    apart: Array = np.hypot(*(trace.pose[:, i, :2] - trace.pose[:, j, :2]).T)
    return apart - robots[trace.names[i]].radius - robots[trace.names[j]].radius


def disturbances(trace: Trace) -> Flags:
    """Whether each robot is disturbed (T, N): from the effect of such a fault until it is over and done with.

    Args:
        trace: the trace.
    """
    disturbed = np.zeros((len(trace.time), len(trace.names)), dtype=bool)
    for i, name in enumerate(trace.names):
        for effect in trace.effects_on(name, *DISTURBING):
            clear = np.full(len(trace.time), np.inf)
            for j in range(len(trace.names)):
                if j != i:
                    clear = np.minimum(clear, gaps(trace, i, j))
            over = np.flatnonzero((trace.time >= effect.end + AFTERWARDS) & (clear >= CLEARANCE))
            end = int(over[0]) if len(over) else len(trace.time)
            disturbed[np.searchsorted(trace.time, effect.start) : end, i] = True
    return disturbed


def _standing(trace: Trace) -> Flags:
    """Whether each robot has stood where it is for a while (T, N), neither driven nor carried."""
    moving = np.abs(trace.twist[..., 0]) > STANDING
    step = np.zeros_like(moving, dtype=np.float64)
    step[1:] = np.hypot(*np.moveaxis(np.diff(trace.pose[..., :2], axis=0), -1, 0))
    moving |= step > STANDING * np.gradient(trace.time)[:, None] + 1e-9
    index = np.where(moving, np.arange(len(trace.time))[:, None], -1)
    last = np.maximum.accumulate(index, axis=0)
    since = np.where(last >= 0, trace.time[np.maximum(last, 0)], -np.inf)
    stood: Flags = trace.time[:, None] - since >= STOOD
    return stood
