"""A run from its first process to its score sheet."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

import click

from muro_zenoh.channels import Role
from muro_zenoh.config import Scenario
from muro_zenoh.errors import SupervisionError
from muro_zenoh.scoring.collector import Collector
from muro_zenoh.scoring.sheet import score_sheet
from muro_zenoh.scoring.view import View, view_of
from muro_zenoh.supervision import launch
from muro_zenoh.supervision.supervisor import Supervisor
from muro_zenoh.supervision.usage import UsageTable
from muro_zenoh.transport import open_bus

INTERRUPTED = 130
"""Exit code of a run that was asked to leave before its end."""


@dataclass(frozen=True, slots=True)
class Order:
    """What an operator asked for.

    Attributes:
        scenario: the scenario.
        folder: of the run.
        seed: of the simulator.
        connect: a router that runs elsewhere; None for one of our own.
        report: where the score sheet goes besides the folder; None for nowhere.
    """

    scenario: Scenario
    folder: Path
    seed: int
    connect: str | None
    report: Path | None


class Screen(Protocol):
    """Where a run is shown."""

    def tell(self, text: str) -> None:
        """Say something that happened."""
        ...

    def show(self, view: View) -> None:
        """Show how it is now; called a few times a second."""
        ...

    def __enter__(self) -> Screen: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


async def conduct(order: Order, screen: Screen) -> int:
    """Carry a run out.

    Args:
        order: which.
        screen: where it is shown.

    Returns:
        The exit code.
    """
    screen.tell(
        f"{order.scenario.name}: {len(order.scenario.robots)} robots, seed {order.seed}; logs in {order.folder}/"
    )
    sheet = None
    with screen:
        try:
            async with Supervisor(order.folder, screen.tell) as supervisor:
                sheet = await _run(order, supervisor, screen)
        except SupervisionError as error:
            screen.tell(f"given up: {error}")
        except asyncio.CancelledError:
            screen.tell("interrupted before everything was ready")
            return INTERRUPTED
    if sheet is None:
        return 1
    text = json.dumps(sheet, indent=1) + "\n"
    for path in (order.folder / "report.json", order.report):
        if path is not None:
            path.write_text(text)
    click.echo(summary(sheet))
    click.echo(f"score sheet: {order.report or order.folder / 'report.json'}")
    if sheet["ended"] == "interrupted":
        return INTERRUPTED
    return 0 if sheet["passed"] else 1


async def _run(order: Order, supervisor: Supervisor, screen: Screen) -> dict[str, Any]:
    """From the first process to the score sheet; the processes are left to the supervisor."""
    began = asyncio.get_running_loop().time()
    scenario = order.scenario
    if order.connect is None:
        scenario, starting = await launch.start_all(supervisor, scenario, order.seed, order.folder)
        endpoint = scenario.bus.connect[0]
        if endpoint != f"tcp/{launch.HOST}:{launch.PORT}":
            screen.tell(
                f"port {launch.PORT} is taken, so this fleet is one of its own on {endpoint}: "
                f"speak to it with --connect {endpoint}"
            )
    else:
        scenario = launch.connected_to(scenario, order.connect)
        file = launch.write_scenario(scenario, order.folder)
        specs = launch.fleet_specs(scenario, file, order.seed, order.folder)
        starting = asyncio.create_task(supervisor.start(specs), name="start the fleet")
    try:
        async with open_bus(scenario.bus, Role.OPERATOR) as bus:
            collector = Collector(bus, scenario)
            collecting = asyncio.create_task(collector.run(), name="collect")
            try:
                await starting
                screen.tell(f"all processes ready after {asyncio.get_running_loop().time() - began:.2f} s")
                return await _watch(order, supervisor, screen, collector, collecting)
            finally:
                collecting.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await collecting
    finally:
        starting.cancel()
        await asyncio.wait({starting})


async def _watch(
    order: Order, supervisor: Supervisor, screen: Screen, collector: Collector, collecting: asyncio.Task[None]
) -> dict[str, Any]:
    """From the moment all are ready to the score sheet."""
    scenario, loop = order.scenario, asyncio.get_running_loop()
    usage = UsageTable()

    def processes() -> list[tuple[str, int | None]]:
        return [*((c.spec.name, c.pid) for c in supervisor.children), ("muro", os.getpid())]

    def restarts() -> int:
        return sum(child.restarts for child in supervisor.children)

    usage.begin(processes())
    collector.begin()
    begin = loop.time()
    end = begin + scenario.duration
    failing = asyncio.ensure_future(supervisor.failure())
    ended, next_usage = "duration", begin + 1.0
    waits: set[asyncio.Future[Any]] = {failing, collecting}
    try:
        while (now := loop.time()) < end:
            await asyncio.wait(waits, timeout=min(0.25, end - now), return_when=asyncio.FIRST_COMPLETED)
            if collecting.done():
                await collecting  # its error
            if failing.done():
                ended = "failed"
                screen.tell(f"given up: {failing.result()}")
                break
            if loop.time() >= next_usage:
                next_usage += 1.0
                usage.note(processes())
            screen.show(view_of(collector, scenario, restarts()))
    except asyncio.CancelledError:
        ended = "interrupted"
        screen.tell("interrupted: the processes are ended, and the score sheet is that of the time until now")
    finally:
        failing.cancel()
    elapsed = min(loop.time() - begin, scenario.duration)
    usage.note(processes())
    seen = collector.observed(
        duration=elapsed, seed=order.seed, ended=ended, restarts=restarts(), processes=usage.report(elapsed)
    )
    return score_sheet(seen, scenario.checks)


def summary(sheet: dict[str, Any]) -> str:
    """A score sheet for people to read.

    Args:
        sheet: as :func:`~muro_zenoh.scoring.sheet.score_sheet` makes it.
    """

    def value(number: float | None, unit: str = "") -> str:
        return "-" if number is None else f"{number:g}{unit}"

    def spread(key: str, unit: str) -> str:
        return "  ".join(f"{name} {value(number, unit)}" for name, number in sheet[key].items())

    rates = [rate for rate in sheet["fix_rate_hz"].values() if rate is not None]
    errors = [c["error"] for c in sheet["calibration"].values() if c["error"] is not None]
    cpu = [p["cpu_percent"] for p in sheet["processes"].values() if p["cpu_percent"] is not None]
    told: list[str] = []
    if sheet["radius_error_m"]["p50"] is not None:
        told += [
            f"  settled at          {value(sheet['settle_time_s'], ' s')}",
            f"  from the circle     {spread('radius_error_m', ' m')}",
        ]
    if sheet["spacing_error_rad"]["p50"] is not None:
        told.append(f"  spacing error       {spread('spacing_error_rad', ' rad')}")
    if sheet["density_error"] is not None:
        told.append(f"  density error       {sheet['density_error']:g}")
    if sheet["goals_asked"]:
        told.append(
            f"  goals               {sheet['goals_reached']} of {sheet['goals_asked']} reached, at most "
            f"{value(sheet['goal_distance_m'], ' m')} and {value(sheet['goal_heading_rad'], ' rad')} off"
        )
    if sheet["tracking_error_m"]["p50"] is not None:
        told.append(f"  from the path       {spread('tracking_error_m', ' m')}")
    if sheet["coverage"]["cost"] is not None:
        cover = sheet["coverage"]
        told.append(
            f"  from the centroid   {value(cover['distance_m'], ' m')} at most, after {cover['rounds']} rounds; "
            f"the cost could fall by {value(cover['gain'])}, and rose by {value(cover['rise'])} at most"
        )
    lines = [
        f"{sheet['scenario']}: {sheet['robots']} robots, {sheet['duration_s']:g} s, seed {value(sheet['seed'])}",
        *told,
        f"  least separation    {value(sheet['min_separation_m'], ' m')}, {value(sheet['collisions'])} collisions",
        f"  pose age            {spread('pose_age_ms', ' ms')}",
        f"  pose to command     {spread('pose_to_command_ms', ' ms')}",
        f"  fixes               {value(min(rates, default=None), ' Hz')} at least",
        f"  calibration         {value(max(errors, default=None))} off at most",
        f"  restarts            {sheet['restarts']}",
        f"  processor           {value(round(sum(cpu), 1) if cpu else None, ' %')} of one core, all processes",
    ]
    for name, check in sheet["checks"].items():
        met = "met" if check["passed"] else "NOT MET"
        lines.append(f"  check {name}: {value(check['value'])} (limit {value(check['limit'])}) {met}")
    lines.append(
        "passed" if sheet["passed"] else "NOT PASSED" + (f" ({sheet['ended']})" * (sheet["ended"] != "duration"))
    )
    return "\n".join(lines)
