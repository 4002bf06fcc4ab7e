"""One trial: a scenario and a seed in, a small result out that can be sent between processes."""

from __future__ import annotations

import itertools
import math
import time
from collections import Counter
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from muro_zenoh.checking.contacts import contacts, disturbances
from muro_zenoh.checking.coverage import Cell, cell_of
from muro_zenoh.checking.judgement import Breach, Judgement
from muro_zenoh.checking.operator import Operator
from muro_zenoh.checking.promises import judge
from muro_zenoh.checking.record import PERIOD, Record, make_record
from muro_zenoh.checking.run import run_fleet
from muro_zenoh.config import Scenario

DRIVING_SHARE: Final = 0.5
"""A trial counts when its robots drove for this share of the time, on average."""


class Result(NamedTuple):
    """What came of one trial.

    Attributes:
        seed: of the trial.
        duration: how long the fleet ran, in virtual time [s].
        cpu: processor time that this took [s].
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
    cpu: float
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


def run_trial(scenario: Scenario, seed: int) -> tuple[Record, Result]:
    """Run a trial and judge it.

    Args:
        scenario: its settings, with faults and orders.
        seed: of starts, noise, and the order of what is ready at one instant.

    Raises:
        IncompleteRecord: not all of it was watched.
    """
    began = time.process_time()
    operator = Operator(scenario)
    trace = run_fleet(scenario, seed, operator)
    cpu = time.process_time() - began
    record = make_record(scenario, seed, trace, operator.orders)
    return record, result_of(record, cpu)


def result_of(record: Record, cpu: float) -> Result:
    """Judge a record.

    Args:
        record: the record.
        cpu: processor time that it took [s].

    Raises:
        IncompleteRecord: not all of the trial was watched.
    """
    driving = float(np.any(record.command != 0.0, axis=2).mean())
    return Result(
        seed=record.seed,
        duration=round(len(record.time) * PERIOD, 2),
        cpu=cpu,
        driving=driving,
        lacks=_lack(record, driving),
        judgements=judge(record),
        contacts=Counter(str(contact.kind) for contact in contacts(record)),
        separation=_separation(record),
        met=Counter(
            {cell_of(effect.fault, activity) for effect in record.effects for activity in effect.robots.values()}
        ),
        digest=record.digest,
    )


def _separation(record: Record) -> float:
    least, disturbed = math.inf, disturbances(record)
    for i, j in itertools.combinations(range(len(record.names)), 2):
        apart = np.hypot(*(record.pose[:, i, :2] - record.pose[:, j, :2]).T)
        least = min(least, float(apart.min(initial=math.inf, where=~(disturbed[:, i] | disturbed[:, j]))))
    return least


def _lack(record: Record, driving: float) -> str:
    faults = record.scenario.faults
    without = [f"{fault.kind} {fault.target}" for fault in faults if all(e.fault != fault for e in record.effects)]
    if driving < DRIVING_SHARE:
        return f"its robots drove for {driving:.0%} of the time"
    if without:
        return f"no effect of {' and '.join(without)}"
    changes = [given for given in record.orders if given.order.kind == "behaviour" and given.order.at > 0.0]
    if changes and not any(given.accepted for given in changes):
        return "no change of behaviour was accepted"
    return ""
