"""Applies the faults of cameras and robots to a fleet in memory."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Coroutine
from typing import Any

import msgspec

from muro_zenoh import channels
from muro_zenoh.channels import Role, key_of
from muro_zenoh.checking.effect import Begin, Effect, End
from muro_zenoh.checking.fleet import VirtualFleet
from muro_zenoh.config import faults as f
from muro_zenoh.config.faults import Fault, Place
from muro_zenoh.geometry import wrap_to_pi
from muro_zenoh.messages import Estimate, VelocityCommand, decode, encode
from muro_zenoh.transport import Bus


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


APPLY: dict[type[Fault], Begin] = {
    f.CameraDropoutFault: _camera_dropout,
    f.HaltFault: _halt,
    f.CarryFault: _carry,
    f.LieFault: _lie,
    f.ForeignDriverFault: _foreign_driver,
}
"""How each kind is applied."""
