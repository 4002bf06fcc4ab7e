"""Applies the faults of links to a fleet in memory."""

from __future__ import annotations

import random

from muro_zenoh.checking.effect import Begin, Effect, End, processes_of
from muro_zenoh.checking.fleet import VirtualFleet
from muro_zenoh.config import faults as f
from muro_zenoh.config.faults import Fault, Place
from muro_zenoh.transport import memory_faults as troubles
from muro_zenoh.transport.memory_faults import Trouble


def _apply_trouble(trouble: Trouble, what: str, fleet: VirtualFleet, fault: f.LinkFault, effect: Effect) -> End:
    effect.what = what
    ends: list[End] = []
    if fault.place is Place.ROUTER:
        fleet.network.begin(trouble)
        ends.append(lambda: fleet.network.end(trouble))
    for process in processes_of(fleet, fault):
        process.begin(trouble, fault.direction)
        ends.append(lambda process=process: process.cease(trouble, fault.direction))  # type: ignore[misc]

    def end() -> None:
        for undo in ends:
            undo()
        effect.amount = trouble.count

    return end


def _delay(fleet: VirtualFleet, fault: f.DelayFault, effect: Effect, rng: random.Random) -> End:
    return _apply_trouble(troubles.Delay(rng, fault.delay), "messages delayed", fleet, fault, effect)


def _jitter(fleet: VirtualFleet, fault: f.JitterFault, effect: Effect, rng: random.Random) -> End:
    return _apply_trouble(troubles.Delay(rng, 0.0, fault.jitter), "messages delayed", fleet, fault, effect)


def _lose(fleet: VirtualFleet, fault: f.LossFault, effect: Effect, rng: random.Random) -> End:
    return _apply_trouble(troubles.Loss(rng, fault.fraction), "messages lost", fleet, fault, effect)


def _duplicate(fleet: VirtualFleet, fault: f.DuplicateFault, effect: Effect, rng: random.Random) -> End:
    trouble = troubles.Duplication(rng, fault.fraction, fault.delay)
    return _apply_trouble(trouble, "messages sent twice", fleet, fault, effect)


def _reorder(fleet: VirtualFleet, fault: f.ReorderFault, effect: Effect, rng: random.Random) -> End:
    trouble = troubles.Reordering(rng, fault.fraction, fault.delay)
    return _apply_trouble(trouble, "messages held back", fleet, fault, effect)


def _partition(fleet: VirtualFleet, fault: f.PartitionFault, effect: Effect, rng: random.Random) -> End:
    return _apply_trouble(troubles.Cut(), "messages lost", fleet, fault, effect)


def _stall(fleet: VirtualFleet, fault: f.StallFault, effect: Effect, rng: random.Random) -> End:
    return _apply_trouble(troubles.Stall(), "messages held up", fleet, fault, effect)


APPLY: dict[type[Fault], Begin] = {
    f.DelayFault: _delay,
    f.JitterFault: _jitter,
    f.LossFault: _lose,
    f.DuplicateFault: _duplicate,
    f.ReorderFault: _reorder,
    f.PartitionFault: _partition,
    f.StallFault: _stall,
}
"""How each kind is applied."""
