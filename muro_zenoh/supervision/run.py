"""A run, from its first process to its score sheet."""

from __future__ import annotations

import asyncio
import os
import re
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager, AbstractContextManager, AsyncExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Protocol

from basestation.dashboard.offer import Offer
from muro_zenoh.channels import Role
from muro_zenoh.config import Scenario
from muro_zenoh.errors import INTERRUPTED, OrderRefused, SupervisionError
from muro_zenoh.orders.lease import holding
from muro_zenoh.scoring.collector import Collector
from muro_zenoh.scoring.observed import Observed
from muro_zenoh.scoring.score import score_run
from muro_zenoh.scoring.sheet import ScoreSheet
from muro_zenoh.scoring.view import View, view_of
from muro_zenoh.supervision import joining, launch
from muro_zenoh.supervision.breaking import Breaking
from muro_zenoh.supervision.child import Child
from muro_zenoh.supervision.faults import Faults, Links
from muro_zenoh.supervision.folder import REPORT, write_event, write_report, write_scenario
from muro_zenoh.supervision.supervisor import Supervisor
from muro_zenoh.supervision.usage import UsageTable
from muro_zenoh.transport import Bus, open_bus
from muro_zenoh.wording import counted

_VIEW_PERIOD = 0.25
_USAGE_PERIOD = 1.0

_PATIENCE = 2.0
"""A base station that is alive answers within this time [s]."""


@dataclass(frozen=True, slots=True)
class RunSettings:
    """The settings of a run.

    Attributes:
        scenario: the scenario.
        folder: of the run.
        seed: the simulator's seed.
        connect: endpoint of a running router, with the processes of the fleet that are there; None to start one.
        page: what the base station serves; or why nothing, empty where nobody wants to know.
    """

    scenario: Scenario
    folder: Path
    seed: int = 1
    connect: str | None = None
    page: Offer | str = ""


class RunResult(NamedTuple):
    """The result of a run.

    Attributes:
        sheet: the score sheet; None when not all processes became ready.
        interrupted: whether a signal ended it.
    """

    sheet: ScoreSheet | None
    interrupted: bool

    @property
    def exit_code(self) -> int:
        """Exit code of ``muro run``: 130 when it was interrupted, 1 when it did not pass; 0 otherwise, also without
        checks."""
        if self.interrupted:
            return INTERRUPTED
        return 1 if self.sheet is None or self.sheet.passed is False else 0


class Screen(Protocol):
    """Where a run is shown."""

    def notify(self, text: str) -> None:
        """Show an event."""
        ...

    def show(self, view: View) -> None:
        """Show the state of the run; called a few times a second."""
        ...

    def operating(self, bus: Bus, say: Callable[[str], None]) -> AbstractContextManager[None]:
        """Let the operator's keys be orders on a bus, within a block; what comes of them is said."""
        ...

    def __enter__(self) -> Screen: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


async def run_fleet(settings: RunSettings, screen: Screen) -> RunResult:
    """Run a fleet as processes on this machine, and write its score sheet to the folder of the run.

    Args:
        settings: the settings of the run.
        screen: where it is shown.
    """
    scenario = settings.scenario
    screen = _Logged(screen, settings.folder)
    screen.notify(
        f"{scenario.name}: {counted(len(scenario.robots), 'robot')}, seed {settings.seed}; logs in {settings.folder}/"
    )
    with screen:
        try:
            async with (
                Links(scenario, settings.seed) as links,
                Supervisor(settings.folder, screen.notify) as supervisor,
            ):
                seen = await _run(settings, supervisor, links, screen)
        except (SupervisionError, OrderRefused) as error:
            screen.notify(f"{'refused' if isinstance(error, OrderRefused) else 'failed'}: {error}")
            return RunResult(None, interrupted=False)
        except asyncio.CancelledError:
            screen.notify("interrupted before all processes were ready")
            return RunResult(None, interrupted=True)
    # The processes have ended: no robot drives while hours of a run are scored.
    sheet = score_run(seen, scenario.checks)
    write_report(sheet, settings.folder / REPORT)
    return RunResult(sheet, interrupted=sheet.ended == "interrupted")


class _Logged:
    """A screen whose events are also kept, in the log of the run itself."""

    def __init__(self, screen: Screen, folder: Path) -> None:
        self._screen = screen
        self._folder = folder
        self.show = screen.show
        self.operating = screen.operating

    def notify(self, text: str) -> None:
        # The log may be read by others than the operator, and the token is his.
        write_event(re.sub(r"(?<=#token=)\S+", "...", text), self._folder)
        self._screen.notify(text)

    def __enter__(self) -> Screen:
        self._screen.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._screen.__exit__(kind, error, trace)


async def _run(settings: RunSettings, supervisor: Supervisor, links: Links, screen: Screen) -> Observed:
    """From the first process to the end of the run; the supervisor stops the processes."""
    if settings.connect is not None:
        return await _run_on(settings.connect, settings, supervisor, links, screen)
    scenario, starting = await launch.start_all(
        supervisor, settings.scenario, settings.seed, settings.folder, links, settings.page
    )
    endpoint = scenario.bus.connect[0]
    if endpoint != f"tcp/{launch.HOST}:{launch.PORT}":
        screen.notify(
            f"port {launch.PORT} is in use, so this fleet has its own router on {endpoint}: "
            f"connect to it with --connect {endpoint}"
        )
    try:
        async with open_bus(scenario.bus, Role.OPERATOR, Role.SUPERVISOR) as bus:
            return await _observe(settings, scenario, supervisor, links, screen, bus, starting, joining.NOBODY)
    finally:
        await _ended(starting)


async def _run_on(
    endpoint: str, settings: RunSettings, supervisor: Supervisor, links: Links, screen: Screen
) -> Observed:
    """A run on a router that is there, with the processes of its fleet that are there."""
    scenario, folder = launch.connected_to(settings.scenario, endpoint), settings.folder
    async with open_bus(scenario.bus, Role.OPERATOR, Role.SUPERVISOR) as bus, AsyncExitStack() as stack:
        there = await joining.look(bus, scenario.robots)
        if there.basestation:  # before anything is started or ordered
            await stack.enter_async_context(_holding(bus, scenario, screen, patience=_PATIENCE))
            stack.push_async_callback(joining.leave, bus, there.robots)
        if there.processes:
            screen.notify(f"running already: {' '.join(sorted(there.processes))}")
        if re.fullmatch(r"tcp/[^/?#]+:\d+", endpoint) is not None:
            links.lead_to(endpoint)
        file = write_scenario(scenario, folder)
        specs = launch.fleet_specs(scenario, file, settings.seed, folder, links.endpoints, settings.page)
        missing = [spec for spec in specs if spec.name not in there.processes]
        starting = asyncio.create_task(supervisor.start(missing), name="start the fleet")
        stack.push_async_callback(_ended, starting)
        return await _observe(settings, scenario, supervisor, links, screen, bus, starting, there)


def _holding(
    bus: Bus, scenario: Scenario, screen: Screen, *, patience: float | None
) -> AbstractAsyncContextManager[None]:
    def lost(reason: str) -> None:
        screen.notify(f"the robots are no longer held by this run: {reason}")

    return holding(bus, "muro run", scenario.robots, lost=lost, patience=patience)


async def _observe(
    settings: RunSettings,
    scenario: Scenario,
    supervisor: Supervisor,
    links: Links,
    screen: Screen,
    bus: Bus,
    starting: asyncio.Task[list[Child]],
    there: joining.There,
) -> Observed:
    """From the start of the processes to the end of the run."""
    began = asyncio.get_running_loop().time()
    collector = Collector(bus, scenario)
    collecting = asyncio.create_task(collector.run(), name="collect")
    try:
        async with AsyncExitStack() as stack:
            stack.enter_context(screen.operating(bus, screen.notify))
            await starting
            screen.notify(f"all processes ready after {asyncio.get_running_loop().time() - began:.2f} s")
            if not there.basestation and settings.page:
                page = settings.page
                screen.notify(page if isinstance(page, str) else "\n".join(page.lines))
            if there.basestation:  # it keeps what was ordered before
                await joining.order(bus, scenario)
            else:
                await stack.enter_async_context(_holding(bus, scenario, screen, patience=None))

            def children() -> dict[str, Child]:
                return {child.spec.name: child for child in supervisor.children}

            breaking = Breaking(bus, scenario, settings.folder)
            faults = Faults(
                scenario, links, children, bus.clock, screen.notify, breaking.in_room, lambda: breaking.publish(faults)
            )
            stack.enter_context(breaking.on_order(faults))
            return await _watch(settings, supervisor, screen, collector, collecting, faults)
    finally:
        await _ended(collecting)


async def _ended(task: asyncio.Task[Any]) -> None:
    task.cancel()
    await asyncio.wait({task})


async def _watch(
    settings: RunSettings,
    supervisor: Supervisor,
    screen: Screen,
    collector: Collector,
    collecting: asyncio.Task[None],
    faults: Faults,
) -> Observed:
    """From the moment when all are ready to the end of the run."""
    scenario, loop = settings.scenario, asyncio.get_running_loop()
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
    ended, next_usage = "duration", begin + _USAGE_PERIOD
    befalling = asyncio.create_task(faults.run(begin), name="faults")
    waits: set[asyncio.Future[Any]] = {failing, collecting}
    try:
        while (now := loop.time()) < end:
            await asyncio.wait(waits, timeout=min(_VIEW_PERIOD, end - now), return_when=asyncio.FIRST_COMPLETED)
            if collecting.done():
                await collecting  # its error
            if befalling.done():
                await befalling  # its error
            if failing.done():
                ended = "failed"
                screen.notify(f"failed: {failing.result()}")
                break
            if loop.time() >= next_usage:
                next_usage += _USAGE_PERIOD
                usage.note(processes())
            screen.show(view_of(collector, scenario, restarts(), faults.lasting))
    except asyncio.CancelledError:
        ended = "interrupted"
        screen.notify("interrupted: stopping all processes; the score sheet covers the time until now")
    finally:
        failing.cancel()
        befalling.cancel()
        await asyncio.wait({befalling})
        await faults.close()
    elapsed = min(loop.time() - begin, scenario.duration)
    usage.note(processes())
    return collector.observed(
        duration=elapsed,
        seed=settings.seed,
        ended=ended,
        restarts=restarts(),
        processes=usage.report(elapsed),
        faults=faults.seen,
    )
