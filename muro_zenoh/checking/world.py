"""The floor of a fleet in memory: what befalls the robots' bodies there, and a record of the truth."""

from __future__ import annotations

import asyncio
from collections import Counter, defaultdict
from collections.abc import Callable
from typing import Final

import numpy as np

from agents.base.simulated import STEP, Floor, SimulatedWheels
from muro_zenoh.elementwise import Array
from muro_zenoh.runtime.clock import Clock
from muro_zenoh.simulation.plant import Plant

_PERIOD: Final = 0.02

_COLUMNS: Final = 7
"""Of a record: x y theta, v omega, commanded v omega."""


class World(Floor):
    """The floor, advanced also when nobody asks.

    Args:
        plant: the robots.
        clock: the true one.
        watchdog: of the wheels [s].

    Attributes:
        has_base: whether a base drives the wheels of a row: then their watchdog leaves it to the base to stop them, so
            that a base whose dead-man fails is found out.
        jammed: how many faults jam the wheels, by row.
        jammed_for: how long jammed wheels were commanded to turn, by row [s].
        driven: the rows whose wheels somebody else drives: v [m/s], omega [rad/s]; the last one counts.
    """

    def __init__(self, plant: Plant, clock: Clock, watchdog: float) -> None:
        super().__init__(plant, clock, watchdog)
        self.has_base: Callable[[int], bool] = lambda row: False
        self.jammed: Counter[int] = Counter()
        self.jammed_for: defaultdict[int, float] = defaultdict(float)
        self.driven: list[tuple[int, tuple[float, float]]] = []
        self._records: list[Array] = []
        self._block: Array = np.empty((0, len(plant), _COLUMNS))
        self._filled = 0

    # ---- what befalls the bodies

    def _has_watchdog(self, row: int) -> bool:
        return not self.has_base(row)

    def _step(self) -> None:
        effective = self.commands
        if self.driven or self.jammed:
            effective = effective.copy()
            for row, twist in self.driven:
                effective[row] = twist
            for row in +self.jammed:
                self.jammed_for[row] += STEP if effective[row].any() else 0.0
                effective[row] = 0.0
                self.plant.jam(row)
        self._advance(effective)
        self._record()

    async def run(self) -> None:
        """Advance the floor until cancelled, whatever becomes of the bases and the cameras."""
        loop = asyncio.get_running_loop()
        begin, count = loop.time(), 0
        while True:
            count += 1
            await asyncio.sleep(begin + count * _PERIOD - loop.time())
            self.catch_up()

    # ---- the record

    def _record(self) -> None:
        if self._filled == len(self._block):
            self._block = np.empty((1024, len(self.plant), _COLUMNS))
            self._records.append(self._block)
            self._filled = 0
        row = self._block[self._filled]
        row[:, 0:3] = self.plant.pose
        row[:, 3:5] = self.plant.twist
        row[:, 5:7] = self.commands
        for robot, hand in self._hands.items():
            row[robot, 3:5] = hand.twist
        self._filled += 1

    @property
    def record(self) -> Array:
        """The truth (T, N, 7) after each :data:`~agents.base.simulated.STEP`: x, y [m], theta [rad], v [m/s], omega
        [rad/s], and what the wheels were commanded: v [m/s], omega [rad/s]."""
        *full, last = self._records or [self._block]
        return np.concatenate((*full, last[: self._filled]))


class GuardedWheels(SimulatedWheels):
    """Wheels that obey the process that drives them until it is killed.

    Args:
        world: the floor.
        row: this robot's row.
    """

    def __init__(self, world: World, row: int) -> None:
        super().__init__(world, row)
        self._cut = False

    def cut(self) -> None:
        """Obey no more."""
        self._cut = True

    def command(self, v: float, omega: float) -> None:
        """Turn the wheels so that a nominal robot would drive at ``v`` [m/s] and ``omega`` [rad/s]."""
        if not self._cut:
            super().command(v, omega)
