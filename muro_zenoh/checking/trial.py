"""One trial: a scenario and a seed in, a small result out that can be sent between processes."""

from __future__ import annotations

import hashlib
import itertools
import math
import time
from collections import Counter
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from muro_zenoh.checking.contacts import contacts, disturbances
from muro_zenoh.checking.coverage import Cell, cell_of
from muro_zenoh.checking.promises import Breach, Judgement, judge
from muro_zenoh.checking.trace import Trace
from muro_zenoh.config import Scenario

DRIVING_SHARE: Final = 0.5
"""A trial counts when its robots drove for this share of the time, on average."""


class Result(NamedTuple):
    """What came of one trial.

    Attributes:
        seed: of the trial.
        duration: how long the fleet ran, in virtual time [s].
        wall: how long that took [s].
        driving: the share of the time for which the robots were commanded to drive, on average.
        lacks: what it lacks to count as a trial, in words; empty when it counts.
        judgements: of each promise, by its name.
        contacts: number of contacts, by class.
        separation: the smallest distance between the centres of two undisturbed robots [m]; infinite for one robot.
        met: the cells of the coverage table that it met.
        digest: of everything that happened; the same seed gives the same one.
    """

    seed: int
    duration: float
    wall: float
    driving: float
    lacks: str
    judgements: Mapping[str, Judgement]
    contacts: Mapping[str, int]
    separation: float
    met: Counter[Cell]
    digest: str

    @property
    def breaches(self) -> tuple[Breach, ...]:
        """All breaches, the first one first."""
        found = itertools.chain.from_iterable(judgement.breaches for judgement in self.judgements.values())
        return tuple(sorted(found, key=lambda breach: breach.time))

    @property
    def counts(self) -> bool:
        """Whether it counts as a trial: it lacks nothing, or has broken a promise with less."""
        return not self.lacks or bool(self.breaches)


def run_trial(scenario: Scenario, seed: int) -> tuple[Trace, Result]:
    """Run a trial and judge it.

    Args:
        scenario: its settings, with faults and orders.
        seed: of starts, noise, and the order of what is ready at one instant.

    Raises:
        IncompleteTrace: not all of it was watched.
    """
    from muro_zenoh.checking.fleet import run_fleet

    began = time.perf_counter()
    trace = run_fleet(scenario, seed)
    wall = time.perf_counter() - began
    return trace, result_of(trace, wall)


def result_of(trace: Trace, wall: float) -> Result:
    """Judge a trace.

    Args:
        trace: the trace.
        wall: how long it took [s].

    Raises:
        IncompleteTrace: not all of the trial was watched.
    """
    driving = float(np.any(trace.command != 0.0, axis=2).mean())
    return Result(
        seed=trace.seed,
        duration=float(trace.time[-1]),
        wall=wall,
        driving=driving,
        lacks=_lack(trace, driving),
        judgements=judge(trace),
        contacts=Counter(str(contact.kind) for contact in contacts(trace)),
        separation=_separation(trace),
        met=Counter(
            {cell_of(effect.fault, activity) for effect in trace.effects for activity in effect.robots.values()}
        ),
        digest=digest_of(trace),
    )


def _separation(trace: Trace) -> float:
    least, disturbed = math.inf, disturbances(trace)
    for i, j in itertools.combinations(range(len(trace.names)), 2):
        apart = np.hypot(*(trace.pose[:, i, :2] - trace.pose[:, j, :2]).T)
        least = min(least, float(apart.min(initial=math.inf, where=~(disturbed[:, i] | disturbed[:, j]))))
    return least


def _lack(trace: Trace, driving: float) -> str:
    faults = trace.scenario.faults
    without = [fault.kind for fault in faults if all(effect.fault != fault for effect in trace.effects)]
    if driving < DRIVING_SHARE:
        return f"its robots drove for {driving:.0%} of the time"
    if without:
        return f"no effect of {' and '.join(without)}"
    changes = [given for given in trace.orders if given.order.kind == "behaviour" and given.order.at > 0.0]
    if changes and not any(given.accepted for given in changes):
        return "no change of behaviour was accepted"
    return ""


def digest_of(trace: Trace) -> str:
    """A digest of everything that happened.

    Args:
        trace: the trace.
    """
    digest = hashlib.sha256()
    for array in (trace.time, trace.pose, trace.twist, trace.command, trace.good_pose, trace.good_command):
        digest.update(np.ascontiguousarray(array).tobytes())
    digest.update(repr((trace.effects, trace.reports, trace.orders)).encode())
    return digest.hexdigest()
