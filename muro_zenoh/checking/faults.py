"""Applies the faults of a scenario to a fleet in memory, and notes what each of them really did.

Each kind has a function that begins it, and returns one that ends it; they are in the three files of these names.
Adding a kind: such a function, in the file's table.
"""

from __future__ import annotations

import asyncio
import contextvars
import math
import random
from collections.abc import Iterator
from contextlib import contextmanager

from muro_zenoh.checking import link_faults, process_faults, robot_faults
from muro_zenoh.checking.effect import Effect, End
from muro_zenoh.checking.fleet import VirtualFleet
from muro_zenoh.config.faults import CrashFault, Place, ProcessFault, RestartFault

_APPLY = link_faults.APPLY | process_faults.APPLY | robot_faults.APPLY


class Faults:
    """The faults of a fleet's scenario.

    Args:
        fleet: the fleet.
        seed: for what is random in them.

    Attributes:
        effects: what each did, in the order of the scenario.
        failures: errors of ours in applying them.
    """

    def __init__(self, fleet: VirtualFleet, seed: int) -> None:
        self.effects = [Effect(fault) for fault in fleet.scenario.faults]
        self._fleet = fleet
        self._seed = seed
        self.failures: list[Exception] = []
        self._ends: dict[int, End] = {}

    def schedule(self) -> None:
        """Have them begin and end when they are due, counted from now; those due now begin before anything runs."""
        loop, outside = asyncio.get_running_loop(), contextvars.Context()
        for number, effect in enumerate(self.effects):
            fault = effect.fault
            if fault.at == 0.0 and not isinstance(fault, ProcessFault):
                self._begin(number)
            else:
                loop.call_later(fault.at, self._begin, number, context=outside)
            if math.isfinite(fault.end):
                loop.call_later(fault.end, self._end, number, context=outside)

    def finish(self) -> None:
        """End those that are left, so that their effects are complete; but start no process for that."""
        for number in list(self._ends):
            fault = self.effects[number].fault
            if fault.place is Place.ROUTER or not isinstance(fault, CrashFault | RestartFault):
                self._end(number)
                self.effects[number].ended = math.inf

    def _begin(self, number: int) -> None:
        effect = self.effects[number]
        effect.begun = self._fleet.elapsed
        rng = random.Random(self._seed * 1_000_003 + number)
        with self._noting_failures():
            self._ends[number] = _APPLY[type(effect.fault)](self._fleet, effect.fault, effect, rng)

    def _end(self, number: int) -> None:
        self.effects[number].ended = self._fleet.elapsed
        with self._noting_failures():
            self._ends.pop(number, _nothing)()

    @contextmanager
    def _noting_failures(self) -> Iterator[None]:
        """The loop would only log them."""
        try:
            yield
        except Exception as error:
            self.failures.append(error)


def _nothing() -> None:
    """The end of a fault that could not begin."""
