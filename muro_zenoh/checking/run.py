"""Runs a scenario's fleet in virtual time from beginning to end, with its faults, and returns what happened."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import numpy as np

from agents.base.simulated import STEP
from muro_zenoh import channels
from muro_zenoh.checking.faults import Faults
from muro_zenoh.checking.fleet import VirtualFleet
from muro_zenoh.checking.trace import HealthReport, ProcessEnd, Trace
from muro_zenoh.config import Scenario
from muro_zenoh.runtime.virtual_time import run_virtually

Script = Callable[[VirtualFleet], Awaitable[None]]
"""What an operator does during a run: it awaits ``asyncio.sleep`` and gives orders with ``fleet.operator``."""


def run_fleet(scenario: Scenario, seed: int, script: Script | None = None) -> Trace:
    """Run a fleet for the scenario's duration.

    Args:
        scenario: the settings, with the faults.
        seed: of all that is random: starts, noise, the order of what happens at one instant, the faults. The same seed
            gives the same run.
        script: what an operator does meanwhile.

    Returns:
        What happened.

    Raises:
        PlanningError: the robots do not fit into the arena.
        Exception: what the script raises.
    """
    return run_virtually(_run(scenario, seed, script), seed)


async def _run(scenario: Scenario, seed: int, script: Script | None) -> Trace:
    async with VirtualFleet(scenario, seed, restart=True) as fleet:
        reports: list[HealthReport] = []
        faults = Faults(fleet, seed)
        async with asyncio.TaskGroup() as tasks:
            running = [tasks.create_task(_hear(fleet, reports))]
            faults.schedule()
            await fleet.start()
            if script is not None:
                running.append(tasks.create_task(_follow(script, fleet)))
            await asyncio.sleep(scenario.duration - fleet.elapsed)
            fleet.world.catch_up()
            faults.finish()
            if faults.failures:
                raise ExceptionGroup("faults could not be applied", faults.failures)
            for task in running:
                task.cancel()
        return _trace(fleet, reports, faults)


async def _follow(script: Script, fleet: VirtualFleet) -> None:
    await script(fleet)


async def _hear(fleet: VirtualFleet, reports: list[HealthReport]) -> None:
    before: dict[str, tuple[object, ...]] = {}
    newest: dict[tuple[str, int], int] = {}
    async for received in fleet.operator.every(channels.HEALTH, "*", depth=4096):
        health = received.message
        writer = received.name, health.epoch
        if health.seq <= newest.get(writer, 0):
            continue  # on its way it was overtaken or doubled: what it says is no longer so
        newest[writer] = health.seq
        said = health.state, health.reasons, health.failure, health.stop_latched
        if before.get(received.name) != said:
            before[received.name] = said
            reports.append(HealthReport(fleet.elapsed, received.name, *said))


def _trace(fleet: VirtualFleet, reports: list[HealthReport], faults: Faults) -> Trace:
    robots = fleet.scenario.robots
    record = fleet.world.record
    times = STEP * np.arange(1, len(record) + 1, dtype=np.float64)
    return Trace(
        robots=robots,
        times=times,
        poses=record[:, :, 0:3],
        twists=record[:, :, 3:5],
        commands=record[:, :, 5:7],
        informed={name: fleet.witnesses.informed(name, times, fleet.begun) for name in robots},
        reports=tuple(reports),
        ends=tuple(ProcessEnd(time, name, repr(error) if error else "") for time, name, error in fleet.ends),
        effects=tuple(faults.effects),
    )
