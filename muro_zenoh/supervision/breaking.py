"""Faults that an operator orders while a run lasts: taken, carried out, published, and kept as rows of a scenario."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Final

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import Fault, Scenario
from muro_zenoh.config.fault_rows import fault_of
from muro_zenoh.config.writing import faults_as_toml
from muro_zenoh.errors import OrderRefused
from muro_zenoh.messages import Break, FaultList, Reply
from muro_zenoh.supervision.faults import Faults
from muro_zenoh.supervision.folder import FAULTS
from muro_zenoh.transport import Bus

log = logging.getLogger(__name__)

_NAME: Final = "muro"
"""The name of this process among those that are alive."""

_MOST: Final = 1000


class Breaking:
    """The faults of a run as others see and order them.

    Args:
        bus: the run's.
        scenario: the scenario.
        folder: of the run.
    """

    def __init__(self, bus: Bus, scenario: Scenario, folder: Path) -> None:
        self._bus = bus
        self._scenario = scenario
        self._file = folder / FAULTS
        self._list = bus.publisher(channels.FAULTS)

    @contextmanager
    def on_order(self, faults: Faults) -> Iterator[None]:
        """Let faults happen on an operator's order, within a block.

        Args:
            faults: those of the run.
        """

        async def obey(order: Break) -> Reply:
            if len(faults.ordered) >= _MOST:
                raise OrderRefused(f"break: got {_MOST + 1} faults in one run, expected at most {_MOST}")
            note = await faults.let_happen(fault_of(order, self._scenario, at=round(faults.elapsed, 2)))
            self._keep(faults)
            return Reply(accepted=True, reason=note)

        self._bus.announce(Role.SUPERVISOR, _NAME)
        with closing(self._bus.answer(channels.BREAK, obey)):
            self.publish(faults)
            yield

    def publish(self, faults: Faults) -> None:
        """Say which faults there are.

        Args:
            faults: those of the run.
        """
        self._list.put(FaultList(rows=faults_as_toml(faults.ordered), lasting=faults.lasting))

    async def in_room(self, fault: Fault) -> None:
        """Have the simulator let a fault happen.

        Args:
            fault: which.

        Raises:
            NoReply: there is no simulator.
            OrderRefused: it cannot.
        """
        given = {name: getattr(fault, name) for name in fault.__struct_fields__}
        numbers = {key: value for key, value in given.items() if key not in ("target", "at", "until", "duration")}
        lasts = None if fault.duration is None and fault.until is None else fault.end - fault.at
        reply = await self._bus.ask(
            channels.BEFALL, Break(fault=fault.kind, target=fault.target, duration=lasts, numbers=numbers)
        )
        if not reply.accepted:
            raise OrderRefused(reply.reason)

    def _keep(self, faults: Faults) -> None:
        try:
            self._file.write_text(faults_as_toml(faults.ordered))
        except OSError as error:
            log.warning("%s: %s", self._file, error.strerror or error)
