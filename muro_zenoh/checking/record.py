"""What a trial is judged by: its trace at 50 Hz, with what an operator ordered and heard.

Times are virtual, counted from the start of the trial [s]; T samples, N robots in the scenario's order.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.base.simulated import STEP
from muro_zenoh.checking.coverage import Activity
from muro_zenoh.checking.operator import Ordered
from muro_zenoh.checking.trace import HealthReport, ProcessEnd, Trace
from muro_zenoh.config import Scenario
from muro_zenoh.config.faults import Fault
from muro_zenoh.elementwise import Array

Flags = NDArray[np.bool_]

PERIOD = 0.02
"""From one sample to the next [s]."""

_JUST_NOW = 0.3
"""A robot that was commanded to drive within this time drives [s]."""


class Incident(NamedTuple):
    """What a fault did, and to whom.

    Attributes:
        fault: the fault.
        start: when it began [s].
        end: when it was over [s].
        robots: the robots that it concerned, each with what it did at ``start``.
    """

    fault: Fault
    start: float
    end: float
    robots: dict[str, Activity]


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """One trial as it went.

    Attributes:
        scenario: the settings.
        seed: of the trial.
        time: (T,) [s].
        pose: (T, N, 3) true x, y [m, world], theta [rad].
        twist: (T, N, 2) true v [m/s], omega [rad/s].
        command: (T, N, 2) what the wheels are commanded: v [m/s], omega [rad/s].
        good_command: (T, N) when the youngest command that a base has received from its own agent was sent [s];
            -inf before the first.
        good_pose: (T, N) when the picture was taken behind the youngest fix that an agent has received [s].
        good_snapshot: (T, N) when the youngest snapshot that an agent has received was sent [s].
        latched: (T, N) whether an agent's stop latch holds it, by its health.
        effects: of the faults; a fault without effect has none.
        reports: all health messages.
        orders: all orders.
        ends: the processes that ended by themselves.
        finished: whether the trial went on to its end.
        digest: of all of this and more; only the same run has it.
    """

    scenario: Scenario
    seed: int
    time: Array
    pose: Array
    twist: Array
    command: Array
    good_command: Array
    good_pose: Array
    good_snapshot: Array
    latched: Flags
    effects: tuple[Incident, ...] = ()
    reports: tuple[HealthReport, ...] = ()
    orders: tuple[Ordered, ...] = ()
    ends: tuple[ProcessEnd, ...] = ()
    finished: bool = True
    digest: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """The robots."""
        return self.scenario.robots

    def effects_on(self, name: str, *kinds: str) -> Iterator[Incident]:
        """What faults of some kinds did to a robot.

        Args:
            name: the robot.
            kinds: the kinds.
        """
        return (effect for effect in self.effects if effect.fault.kind in kinds and name in effect.robots)


def make_record(scenario: Scenario, seed: int, trace: Trace, orders: Iterable[Ordered]) -> Record:
    """The record of a trial.

    Args:
        scenario: its settings.
        seed: of the trial.
        trace: what the fleet left.
        orders: what was ordered meanwhile.
    """
    rows = slice(0, None, round(PERIOD / STEP))
    time = trace.times[rows]
    informed = [trace.informed[name] for name in scenario.robots]
    command = trace.commands[rows]
    latched = _latched(scenario.robots, time, trace.reports)
    return Record(
        scenario=scenario,
        seed=seed,
        time=time,
        pose=trace.poses[rows],
        twist=trace.twists[rows],
        command=command,
        good_command=np.stack([of.command[rows] for of in informed], axis=1),
        good_pose=np.stack([of.pose[rows] for of in informed], axis=1),
        good_snapshot=np.stack([of.snapshot[rows] for of in informed], axis=1),
        latched=latched,
        effects=tuple(_effects(scenario, trace, _Activities(scenario.robots, time, command, latched, trace))),
        reports=trace.reports,
        orders=tuple(orders),
        ends=trace.ends,
        finished=bool(time[-1] >= scenario.duration - 2.0 * PERIOD),
        digest=trace.digest(),
    )


def _latched(robots: tuple[str, ...], time: Array, reports: Iterable[HealthReport]) -> Flags:
    latched = np.zeros((len(time), len(robots)), dtype=bool)
    for report in reports:
        if report.process in robots:
            latched[np.searchsorted(time, report.time) :, robots.index(report.process)] = report.latched
    return latched


class _Activities:
    """What each robot does at a time."""

    def __init__(self, robots: tuple[str, ...], time: Array, command: Array, latched: Flags, trace: Trace) -> None:
        self._robots = robots
        self._time = time
        self._driving = np.any(command != 0.0, axis=2)
        self._latched = latched
        self._starts = {
            name: [0.0, *(e.ended for e in trace.effects if _starts_anew(e.fault, name) and math.isfinite(e.ended))]
            for name in robots
        }

    def of(self, name: str, when: float) -> Activity:
        """What a robot did just before a time."""
        i, row = self._robots.index(name), int(np.searchsorted(self._time, when))
        since = max(start for start in self._starts[name] if start <= when)
        begun = int(np.searchsorted(self._time, since))
        if self._driving[max(begun, row - round(_JUST_NOW / PERIOD)) : row, i].any():
            return Activity.DRIVING
        if self._latched[max(row - 1, 0), i]:
            return Activity.STOPPED
        return Activity.HOLDING if self._driving[begun:row, i].any() else Activity.STARTING


def _starts_anew(fault: Fault, name: str) -> bool:
    return fault.kind in ("crash", "restart") and fault.target == f"{name}/agent"


def _effects(scenario: Scenario, trace: Trace, activities: _Activities) -> Iterator[Incident]:
    for effect in trace.effects:
        if effect.occurred:
            robots = (effect.fault.robot,) if effect.fault.robot else scenario.robots
            doing = {name: activities.of(name, effect.begun) for name in robots}
            yield Incident(effect.fault, effect.begun, min(effect.ended, float(trace.times[-1])), doing)
