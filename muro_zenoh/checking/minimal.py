"""The smallest trial that still breaks a promise: fewest faults, orders and robots, shortest time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import msgspec

from muro_zenoh.checking.judgement import Breach
from muro_zenoh.checking.record import Record
from muro_zenoh.checking.shrink import fewest
from muro_zenoh.checking.trial import run_trial
from muro_zenoh.config import Scenario

AFTER: Final = 0.5
"""A shortened trial goes on for this time after its breach [s]."""

Breaks = Callable[[Scenario, int], Breach | None]
"""From a scenario and a seed to the first breach; None when there is none."""


class Minimal(NamedTuple):
    """A trial that breaks a promise: ``scenario`` and ``seed``; the ``breach``; and how many ``runs`` it took."""

    scenario: Scenario
    seed: int
    breach: Breach
    runs: int


def breach_of(promise: str) -> Breaks:
    """Runs trials, and looks for a breach of one promise.

    Args:
        promise: its name.
    """

    def first(scenario: Scenario, seed: int) -> Breach | None:
        _, result = run_trial(scenario, seed)
        return next((breach for breach in result.breaches if breach.promise == promise), None)

    return first


def with_starts(record: Record) -> Scenario:
    """A trial's scenario with the robots' starts in it, so that each starts there without the others, too.

    Args:
        record: the trial.
    """
    first = record.pose[0].round(4).tolist()
    return msgspec.structs.replace(
        record.scenario, starts={name: tuple(pose) for name, pose in zip(record.names, first, strict=True)}
    )


def minimal(scenario: Scenario, seed: int, breach: Breach, breaks: Breaks) -> Minimal:
    """Shrink a trial that breaks a promise.

    With other robots the noise differs, so a fleet without some robots is tried with three seeds.

    Args:
        scenario: the trial's; with its starts, or other robots would start elsewhere.
        seed: the trial's.
        breach: its breach.
        breaks: runs a trial.
    """
    return _Shrinking(scenario, seed, breach, breaks).run()


class _Shrinking:
    def __init__(self, scenario: Scenario, seed: int, breach: Breach, breaks: Breaks) -> None:
        self._scenario = _until(scenario, breach.time + AFTER)
        self._seed = seed
        self._breach = breach
        self._breaks = breaks
        self._runs = 0

    def run(self) -> Minimal:
        while True:
            before = self._scenario
            self._drop_faults()
            self._drop_robots()
            self._drop_orders()
            if self._scenario == before:
                return Minimal(self._scenario, self._seed, self._breach, self._runs)

    def _takes(self, scenario: Scenario, seeds: Sequence[int]) -> bool:
        """Whether a trial breaks too; if so it is the one to shrink further, cut after its breach."""
        for seed in seeds:
            self._runs += 1
            breach = self._breaks(scenario, seed)
            if breach is not None:
                self._scenario, self._seed, self._breach = _until(scenario, breach.time + AFTER), seed, breach
                return True
        return False

    def _drop_faults(self) -> None:
        fewest(
            self._scenario.faults,
            lambda some: self._takes(msgspec.structs.replace(self._scenario, faults=tuple(some)), [self._seed]),
            guesses=[()],
        )

    def _drop_orders(self) -> None:
        fewest(
            self._scenario.orders,
            lambda some: self._takes(msgspec.structs.replace(self._scenario, orders=tuple(some)), [self._seed]),
            guesses=[()],
        )

    def _drop_robots(self) -> None:
        suspects = [name for name in self._scenario.robots if name in self._breach.robots]
        befallen = {fault.robot for fault in self._scenario.faults}
        wider = [name for name in self._scenario.robots if name in suspects or name in befallen]
        fewest(
            self._scenario.robots,
            lambda some: bool(some) and self._takes(_only(self._scenario, some), range(self._seed, self._seed + 3)),
            guesses=[guess for guess in (suspects, wider) if guess],
        )


def _until(scenario: Scenario, end: float) -> Scenario:
    """The scenario cut at a time, without what begins later."""
    end = min(scenario.duration, math.ceil(10.0 * end) / 10.0)
    return msgspec.structs.replace(
        scenario,
        duration=end,
        faults=tuple(fault for fault in scenario.faults if fault.at < end),
        orders=tuple(order for order in scenario.orders if order.at < end),
    )


def _only(scenario: Scenario, robots: Sequence[str]) -> Scenario:
    """The scenario with some of its robots."""
    orders = []
    for order in scenario.orders:
        named = tuple(name for name in order.robots if name in robots)
        if named or not order.robots:
            orders.append(msgspec.structs.replace(order, robots=named))
    return msgspec.structs.replace(
        scenario,
        robot={name: settings for name, settings in scenario.robot.items() if name in robots},
        starts={name: start for name, start in scenario.starts.items() if name in robots},
        goals={name: goals for name, goals in scenario.goals.items() if name in robots},
        faults=tuple(fault for fault in scenario.faults if not fault.robot or fault.robot in robots),
        orders=tuple(orders),
    )
