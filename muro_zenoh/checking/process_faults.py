"""Applies the faults of processes and their clocks to a fleet in memory."""

from __future__ import annotations

import asyncio
import contextvars
import math
import random

from muro_zenoh.checking.effect import Begin, Effect, End, processes_of
from muro_zenoh.checking.fleet import VirtualFleet
from muro_zenoh.config import faults as f
from muro_zenoh.config.faults import Fault, Place
from muro_zenoh.transport import memory_faults as troubles
from muro_zenoh.transport.memory_faults import Trouble

_ROUTER_BACK = 1.0
"""Time after which all have found a router again that was started anew at once [s]."""


def _router_down(trouble: Trouble, fleet: VirtualFleet, effect: Effect, what: str) -> End:
    effect.what = what
    fleet.network.begin(trouble)

    def end() -> None:
        fleet.network.end(trouble)
        effect.amount = trouble.count

    return end


def _crash_router(fleet: VirtualFleet, effect: Effect) -> End:
    end = _router_down(troubles.Cut(), fleet, effect, "messages lost")
    fleet.network.lapse()
    return end


def _crash(fleet: VirtualFleet, fault: f.CrashFault, effect: Effect, rng: random.Random) -> End:
    if fault.place is Place.ROUTER:
        return _crash_router(fleet, effect)
    effect.what = "processes killed"
    processes = processes_of(fleet, fault)
    for process in processes:
        process.held_down += 1
        effect.amount += process.running
        process.kill()

    def start() -> None:
        for process in processes:
            process.held_down -= 1
            process.start_again()

    return start


def _restart(fleet: VirtualFleet, fault: f.RestartFault, effect: Effect, rng: random.Random) -> End:
    if fault.place is Place.ROUTER:
        return _restart_router(fleet, fault, effect)
    effect.what = "processes started anew"
    processes = processes_of(fleet, fault)
    for process in processes:
        process.held_down += 1
        effect.amount += process.running
        process.end()

    def start() -> None:
        for process in processes:
            process.held_down -= 1
            process.start_after_end()

    if math.isfinite(fault.end):
        return start
    start()
    return lambda: None


def _restart_router(fleet: VirtualFleet, fault: f.RestartFault, effect: Effect) -> End:
    ends = [_crash_router(fleet, effect)]

    def end() -> None:
        while ends:
            ends.pop()()

    if math.isinf(fault.end):
        asyncio.get_running_loop().call_later(_ROUTER_BACK, end, context=contextvars.Context())
    return end


def _freeze(fleet: VirtualFleet, fault: f.FreezeFault, effect: Effect, rng: random.Random) -> End:
    if fault.place is Place.ROUTER:
        return _router_down(troubles.Stall(), fleet, effect, "messages held up")
    effect.what = "s frozen"
    frozen = [process for process in processes_of(fleet, fault) if process.running]
    for process in frozen:
        process.freeze()

    def thaw() -> None:
        woken = [process for process in frozen if process.frozen]
        for process in woken:
            process.thaw()
        effect.amount = (fleet.elapsed - effect.begun) if woken else 0.0

    return thaw


def _clock_offset(fleet: VirtualFleet, fault: f.ClockOffsetFault, effect: Effect, rng: random.Random) -> End:
    effect.what, effect.amount = "clocks wrong", 0.0
    clocks = [process.clock for process in processes_of(fleet, fault)]
    begun = asyncio.get_running_loop().time()
    for clock in clocks:
        clock.offset += fault.offset - fault.drift * begun
        clock.drift += fault.drift
        effect.amount += fault.offset != 0.0 or fault.drift != 0.0

    def end() -> None:
        for clock in clocks:
            clock.offset -= fault.offset - fault.drift * begun
            clock.drift -= fault.drift

    return end


def _clock_step(fleet: VirtualFleet, fault: f.ClockStepFault, effect: Effect, rng: random.Random) -> End:
    effect.what = "clocks set"
    for process in processes_of(fleet, fault):
        process.clock.offset += fault.step
        effect.amount += fault.step != 0.0
    return lambda: None


APPLY: dict[type[Fault], Begin] = {
    f.CrashFault: _crash,
    f.RestartFault: _restart,
    f.FreezeFault: _freeze,
    f.ClockOffsetFault: _clock_offset,
    f.ClockStepFault: _clock_step,
}
"""How each kind is applied."""
