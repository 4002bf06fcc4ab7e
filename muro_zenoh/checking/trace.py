"""What was seen of one trial: the truth, sampled evenly from its start to its end, and what happened.

Times are virtual, counted from the start of the trial [s]; T samples, N robots in the scenario's order.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from muro_zenoh.checking.coverage import Activity
from muro_zenoh.config import Scenario
from muro_zenoh.config.faults import Fault
from muro_zenoh.config.order import OrderRow
from muro_zenoh.elementwise import Array

Flags = NDArray[np.bool_]

PERIOD = 0.02
"""From one sample to the next [s]."""


class Effect(NamedTuple):
    """What a fault did.

    Attributes:
        fault: the fault.
        start: when its first effect occurred: a message was delayed, a process stood still, a robot was lifted [s].
        end: when it was over [s].
        robots: the robots that it concerned, each with what it did at ``start``.
    """

    fault: Fault
    start: float
    end: float
    robots: dict[str, Activity]


class Report(NamedTuple):
    """A health message as a faultless listener received it: at ``time`` [s], of ``process``, with its ``reasons``, and
    the ``failure`` of its behaviour."""

    time: float
    process: str
    reasons: tuple[str, ...]
    failure: str = ""


class Ordered(NamedTuple):
    """An ``order`` that was given at ``time`` [s], and whether it was ``accepted``."""

    time: float
    order: OrderRow
    accepted: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
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
        good_pose: (T, N) when the youngest fix that an agent has received was captured [s].
        good_snapshot: (T, N) when the youngest snapshot that an agent has received was sent [s].
        latched: (T, N) whether an agent's stop latch holds it.
        effects: of the faults, in the order of the scenario's; a fault without effect has none.
        reports: all health messages.
        orders: all orders.
        finished: whether the trial went on to its end.
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
    effects: tuple[Effect, ...] = ()
    reports: tuple[Report, ...] = ()
    orders: tuple[Ordered, ...] = ()
    finished: bool = True

    @property
    def names(self) -> tuple[str, ...]:
        """The robots."""
        return self.scenario.robots

    def effects_on(self, name: str, *kinds: str) -> Iterator[Effect]:
        """What faults of some kinds did to a robot.

        Args:
            name: the robot.
            kinds: the kinds.
        """
        return (effect for effect in self.effects if effect.fault.kind in kinds and name in effect.robots)
