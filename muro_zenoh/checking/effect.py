"""What a fault did to a fleet in memory, and how one is applied."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from muro_zenoh.checking.fleet import VirtualFleet
from muro_zenoh.checking.process import Process
from muro_zenoh.config.faults import Fault, Place


@dataclass(slots=True)
class Effect:
    """What a fault did.

    Attributes:
        fault: which.
        begun: when [s since the start]; infinite when it never began.
        ended: when it ended [s since the start]; infinite when the run ended first.
        amount: how much it did, in ``what``; 0 when nothing came of it.
        what: what is counted: ``messages lost``, ``s frozen`` ...
    """

    fault: Fault
    begun: float = math.inf
    ended: float = math.inf
    amount: float = 0.0
    what: str = ""

    @property
    def occurred(self) -> bool:
        """Whether anything came of it."""
        return self.amount > 0.0

    def __str__(self) -> str:
        return f"{self.fault.kind} of {self.fault.target} at {self.fault.at:g} s: {self.amount:.3g} {self.what}"


End = Callable[[], None]
"""Ends a fault, and completes its effect."""

Begin = Callable[[VirtualFleet, Any, Effect, random.Random], End]
"""Begins a fault: of the fleet, the fault, its effect, and a generator for what is random in it."""


def processes_of(fleet: VirtualFleet, fault: Fault) -> list[Process]:
    """The processes that a fault's target names; none for the router.

    Args:
        fleet: the fleet.
        fault: the fault.
    """
    match fault.place:
        case Place.ROBOT:
            return [fleet.processes[f"{fault.robot}/agent"], fleet.base_of(fault.robot)]
        case Place.CAMERAS:
            return [fleet.processes[f"camera/{name}"] for name in fleet.cameras]
        case Place.ROUTER:
            return []
        case _:
            return [fleet.processes[fault.target]]
