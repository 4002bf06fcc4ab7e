"""Applies the faults of a scenario to a fleet in memory, and notes what each of them really did.

Each kind has a function that begins it, and returns one that ends it. Adding a kind: such a function, in ``_APPLY``.
"""

from __future__ import annotations

import asyncio
import contextvars
import math
import random
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

import msgspec

from muro_zenoh import channels
from muro_zenoh.channels import Role, key_of
from muro_zenoh.checking.fleet import VirtualFleet
from muro_zenoh.checking.process import Process
from muro_zenoh.config import faults as f
from muro_zenoh.config.faults import Fault, Place
from muro_zenoh.geometry import wrap_to_pi
from muro_zenoh.messages import Estimate, VelocityCommand, decode, encode
from muro_zenoh.transport import Bus
from muro_zenoh.transport import memory_faults as troubles
from muro_zenoh.transport.memory_faults import Trouble

F = TypeVar("F", bound=Fault)

End = Callable[[], None]


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


_ROUTER_BACK = 1.0
"""Time after which all have found a router again that was started anew at once [s]."""

Begin = Callable[[VirtualFleet, Any, Effect, random.Random], End]


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
            if fault.at == 0.0 and not isinstance(fault, f.ProcessFault):
                self._begin(number)
            else:
                loop.call_later(fault.at, self._begin, number, context=outside)
            if math.isfinite(fault.end):
                loop.call_later(fault.end, self._end, number, context=outside)

    def finish(self) -> None:
        """End those that are left, so that their effects are complete; not the kills."""
        for number in list(self._ends):
            if not isinstance(self.effects[number].fault, f.CrashFault | f.RestartFault):
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


# ---- links


def _apply_trouble(trouble: Trouble, what: str, fleet: VirtualFleet, fault: f.LinkFault, effect: Effect) -> End:
    effect.what = what
    ends: list[End] = []
    if fault.place is Place.ROUTER:
        fleet.network.begin(trouble)
        ends.append(lambda: fleet.network.end(trouble))
    for process in _processes(fleet, fault):
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


# ---- processes


def _processes(fleet: VirtualFleet, fault: Fault) -> list[Process]:
    """Those that a target names; none for the router."""
    match fault.place:
        case Place.ROBOT:
            return [fleet.processes[f"{fault.robot}/agent"], fleet.base_of(fault.robot)]
        case Place.CAMERAS:
            return [fleet.processes[f"camera/{name}"] for name in fleet.cameras]
        case Place.ROUTER:
            return []
        case _:
            return [fleet.processes[fault.target]]


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
    processes = _processes(fleet, fault)
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
    processes = _processes(fleet, fault)
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
    frozen = [process for process in _processes(fleet, fault) if process.running]
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
    clocks = [process.clock for process in _processes(fleet, fault)]
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
    for process in _processes(fleet, fault):
        process.clock.offset += fault.step
        effect.amount += fault.step != 0.0
    return lambda: None


# ---- cameras and robots


def _camera_dropout(fleet: VirtualFleet, fault: f.CameraDropoutFault, effect: Effect, rng: random.Random) -> End:
    view = fleet.view
    effect.what = "sightings missed" if fault.robot else "pictures missed"
    unseen = view.hidden if fault.robot else view.blind
    names = [fault.robot or fault.target.partition("/")[2]] if fault.place is not Place.CAMERAS else list(fleet.cameras)
    before = sum(view.missed[name] for name in names)
    unseen.update(names)

    def end() -> None:
        unseen.subtract(names)
        effect.amount = sum(view.missed[name] for name in names) - before

    return end


def _halt(fleet: VirtualFleet, fault: f.HaltFault, effect: Effect, rng: random.Random) -> End:
    effect.what = "s jammed against a command"
    world, row = fleet.world, fleet.scenario.robots.index(fault.robot)
    world.catch_up()
    world.jammed[row] += 1
    before = world.jammed_for[row]

    def end() -> None:
        world.catch_up()
        world.jammed[row] -= 1
        effect.amount = world.jammed_for[row] - before

    return end


def _carry(fleet: VirtualFleet, fault: f.CarryFault, effect: Effect, rng: random.Random) -> End:
    effect.what = "m carried"
    world, row = fleet.world, fleet.scenario.robots.index(fault.robot)
    hand = world.carry(row, (fault.x, fault.y, fault.theta), fault.end - fault.at)

    def end() -> None:
        effect.amount = world.set_down(row, hand)

    return end


def _lie(fleet: VirtualFleet, fault: f.LieFault, effect: Effect, rng: random.Random) -> End:
    effect.what = "estimates falsified"
    key = key_of(fleet.operator.realm, channels.ESTIMATE, fault.robot)
    first: list[Estimate] = []

    def change(payload: bytes) -> bytes:
        effect.amount += 1
        said = decode(payload, Estimate)
        if fault.stuck:
            first.append(said)
            return encode(msgspec.structs.replace(first[0], stamp=said.stamp, seq=said.seq, epoch=said.epoch))
        return encode(
            msgspec.structs.replace(
                said,
                x=said.x + fault.x,
                y=said.y + fault.y,
                theta=wrap_to_pi(said.theta + fault.theta),
                v=said.v + fault.v,
                omega=said.omega + fault.omega,
            )
        )

    changes = fleet.network.changes.setdefault(key, [])
    changes.append(change)
    return lambda: changes.remove(change)


_FOREIGN_PERIOD = 0.05


def _foreign_driver(fleet: VirtualFleet, fault: f.ForeignDriverFault, effect: Effect, rng: random.Random) -> End:
    if fault.by == "wheels":
        return _drive_wheels(fleet, fault, effect)
    effect.what = "commands sent"

    async def drive(bus: Bus) -> None:
        commands = bus.publisher(channels.CMD_VEL, fault.robot)
        while True:
            commands.put(VelocityCommand(v=fault.v, omega=fault.omega))
            effect.amount += 1
            await asyncio.sleep(_FOREIGN_PERIOD)

    def put(bus: Bus) -> Coroutine[Any, Any, None]:
        return drive(bus)

    name = f"foreign {len(fleet.processes)}"
    process = fleet.add(name, put, (Role.AGENT,), (name,))
    process.start()
    return process.kill


def _drive_wheels(fleet: VirtualFleet, fault: f.ForeignDriverFault, effect: Effect) -> End:
    effect.what = "s driven"
    world, row = fleet.world, fleet.scenario.robots.index(fault.robot)
    world.catch_up()
    twist = fault.v, fault.omega
    world.driven.append((row, twist))

    def end() -> None:
        world.catch_up()
        world.driven.remove((row, twist))
        effect.amount = fleet.elapsed - effect.begun

    return end


_APPLY: dict[type[Fault], Begin] = {
    f.DelayFault: _delay,
    f.JitterFault: _jitter,
    f.LossFault: _lose,
    f.DuplicateFault: _duplicate,
    f.ReorderFault: _reorder,
    f.PartitionFault: _partition,
    f.StallFault: _stall,
    f.CrashFault: _crash,
    f.RestartFault: _restart,
    f.FreezeFault: _freeze,
    f.CameraDropoutFault: _camera_dropout,
    f.ClockOffsetFault: _clock_offset,
    f.ClockStepFault: _clock_step,
    f.HaltFault: _halt,
    f.CarryFault: _carry,
    f.LieFault: _lie,
    f.ForeignDriverFault: _foreign_driver,
}
"""How each kind is applied."""
