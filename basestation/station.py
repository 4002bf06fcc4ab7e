"""The base station: vision, the fleet's table, the kept state, orders and health as concurrent tasks."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path

from basestation.dashboard.child import keep_page
from basestation.fleet.leases import Leases
from basestation.fleet.state_store import StateStore
from basestation.localization.of_scenario import make_fusion
from basestation.localization.sightings import SightingSource
from basestation.tasks.bases import BasesTask
from basestation.tasks.health import HealthTask
from basestation.tasks.kept_state import KeptStateTask
from basestation.tasks.orders import OrdersTask
from basestation.tasks.positions import PositionsTask
from basestation.tasks.vision import cameras_on_bus
from muro_zenoh.channels import Role
from muro_zenoh.config import Scenario
from muro_zenoh.runtime.process import ready, worker_threads
from muro_zenoh.transport import Bus, open_bus
from muro_zenoh.transport.measured_clock import answer_time


class Station:
    """The base station's tasks, wired together.

    Args:
        bus: the bus.
        scenario: the settings.
        state: the file of the kept state; None keeps it only in memory, and uses no threads.
        sources: the cameras' sightings, one source per camera.

    Raises:
        ConfigError: the file is not a kept state.

    Attributes:
        store: the kept state.
    """

    def __init__(self, bus: Bus, scenario: Scenario, state: Path | None, sources: Sequence[SightingSource]) -> None:
        self.store = StateStore(scenario, state)
        self._bus = bus
        self._sources = sources
        self._positions = PositionsTask(bus, scenario.robots, make_fusion(scenario), scenario.timeouts.pose)
        leases = Leases(self.store.state.leases, bus.clock.now(), self.store.keep_leases)
        self._kept = KeptStateTask(bus, self.store, leases)
        self._orders = OrdersTask(bus, self.store, self._kept, leases, self._positions)
        self._bases = BasesTask(bus, scenario.robots, self._positions.doubted)
        self._health = HealthTask(
            bus, self._kept, self._positions, self._bases, scenario.robots, tuple(scenario.camera)
        )

    async def run(self) -> None:
        """Run all tasks. When one crashes, the base station exits, and the robots stop.

        Raises:
            ExceptionGroup: the exceptions of a task; a TransportError when another base station is running.
        """
        self._orders.listen()
        answer_time(self._bus)
        try:
            async with asyncio.TaskGroup() as tasks:
                for number, source in enumerate(self._sources):
                    tasks.create_task(self._positions.watch(source), name=f"vision {number}")
                tasks.create_task(self._positions.repeat(), name="positions")
                tasks.create_task(self._bases.run(), name="bases")
                tasks.create_task(self._kept.run(), name="kept state")
                tasks.create_task(self._health.be_the_only_one(), name="be the only one")
                tasks.create_task(self._health.report(), name="health")
        finally:
            self._orders.close()
            self.store.close()


async def run_basestation(scenario: Scenario, state: Path | None, page: Sequence[str] = ()) -> None:
    """The base station process.

    Args:
        scenario: the settings.
        state: the file of the kept state; None keeps it only in memory.
        page: program and arguments of the page's process; none for no page.

    Raises:
        NotConnected: no router answered.
        ConfigError: a camera's points do not determine a homography, or the file is not a kept state.
    """
    # One thread per camera: no camera waits for another, and no answer to an order waits for a camera.
    with worker_threads(len(scenario.camera), "vision") as threads:
        async with open_bus(scenario.bus, Role.BASESTATION) as bus:
            station = Station(bus, scenario, state, cameras_on_bus(bus, scenario, threads))
            bus.announce(Role.BASESTATION, "basestation")
            ready("basestation")
            serving = asyncio.create_task(keep_page(page), name="page") if page else None
            try:
                await station.run()
            finally:
                if serving is not None:
                    serving.cancel()
                    await asyncio.wait({serving})
