"""The kept state of the lab: circle, behaviours and stop, in memory and in a file.

A change of circle or behaviour, and a resume, hold once they are on the disk. A stop holds at once, also where the disk
is full or hangs; only its reply waits for the disk.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from pathlib import Path

import msgspec

from basestation.fleet.kept_state import KeptState
from basestation.fleet.state_file import StateFile
from muro_zenoh.config import Scenario
from muro_zenoh.errors import ConfigError
from muro_zenoh.messages import Behaviour, Circle, Health, Lease, Resume, SetBehaviour, SetCircle, Stop, StopOrder

log = logging.getLogger(__name__)


class StateStore:
    """The kept state and its file.

    Args:
        scenario: what holds when there is no file yet, and the limits of every order.
        path: the file; None keeps nothing beyond this process, and uses no threads.

    Raises:
        ConfigError: the file is there and is not such a state, or it cannot be written.

    Attributes:
        state: what holds now.
    """

    def __init__(self, scenario: Scenario, path: Path | None) -> None:
        self._scenario = scenario
        self._file = StateFile(path) if path is not None else None
        self._changing = asyncio.Lock()
        self._unsaved_leases = False
        self._saving_leases: asyncio.Task[None] | None = None
        known = (self._file.read() if self._file is not None else None) or KeptState.initial(scenario)
        self.state = known.fitted_to(scenario)
        if self.state is not known and self._file is not None:
            self._file.write_now(self.state)
        if self.state.circle != known.circle:
            text = "the kept %s does not fit into this scenario: using the scenario's %s"
            log.warning(text, known.circle, self.state.circle)
        for name in scenario.robots:
            kept, used = known.behaviour.get(name), self.state.behaviour[name]
            if kept is not None and used != kept:
                text = "the kept behaviour %s of %s does not fit into this scenario: using the scenario's %s"
                log.warning(text, kept.behaviour, name, used.behaviour)

    def close(self) -> None:
        """End the threads that write the file; a second time does nothing."""
        if self._saving_leases is not None:
            self._saving_leases.cancel()
            self._saving_leases = None
        if self._file is not None:
            self._file.close()

    # ---- what is published

    @property
    def robots(self) -> tuple[str, ...]:
        """The names of the robots whose behaviours are kept."""
        return self._scenario.robots

    @property
    def revision(self) -> int:
        """Of the newest change."""
        return self.state.revision

    @property
    def circle(self) -> Circle:
        """The circle, to be published."""
        return Circle.of(self.state.circle, revision=self.state.revision)

    @property
    def stop(self) -> StopOrder:
        """The stop order, to be published."""
        return StopOrder(all=self.state.stop_all, names=self.state.stop_names, revision=self.state.stop_revision)

    def behaviour(self, name: str) -> Behaviour:
        """A robot's behaviour, to be published.

        Args:
            name: of the robot.
        """
        kept = self.state.behaviour[name]
        return Behaviour(behaviour=kept.behaviour, parameters=kept.parameters, revision=kept.revision)

    # ---- stops: they hold when the call returns

    def add_stop(self, order: Stop) -> Awaitable[None]:
        """Stop some robots, or everybody. A robot that the settings do not have is stopped, too.

        Args:
            order: the order.

        Returns:
            Done when it is on the disk; raises a ConfigError when it cannot be written, and holds all the same.
        """
        return self._hold(self.state.with_stop(order.names, everybody=not order.names))

    def adopt(self, name: str, health: Health) -> Awaitable[None] | None:
        """Keep a stop that a robot received straight from an operator, and any newer revision.

        Args:
            name: of the robot.
            health: what its agent reports.

        Returns:
            None when there is nothing new; else as :meth:`add_stop`.
        """
        new = self.state.adopting(name, health)
        return self._hold(new) if new is not self.state else None

    def keep_leases(self, leases: tuple[Lease, ...]) -> None:
        """Keep the leases, for a base station that starts anew; one that cannot be written holds all the same.

        They are written one after the other, and only the newest: a program that asks for ever other robots must
        neither fill the memory nor keep a stop waiting for the disk.

        Args:
            leases: all that are in force.
        """
        self.state = msgspec.structs.replace(self.state, leases=leases)
        self._unsaved_leases = True
        if self._saving_leases is None:
            self._saving_leases = asyncio.create_task(self._save_leases(), name="save the leases")

    # ---- changes: they hold when they are on the disk

    async def set_circle(self, order: SetCircle) -> None:
        """Change the circle.

        Args:
            order: what is None stays as it is.

        Raises:
            OrderRefused: robots on it would leave the arena, or cannot do there what they do.
            ConfigError: it cannot be written; nothing has changed.
        """
        await self._change(lambda state: state.with_circle(order, self._scenario))

    async def set_behaviour(self, order: SetBehaviour) -> None:
        """Change the behaviour of some robots, or of all.

        Args:
            order: the order.

        Raises:
            OrderRefused: a robot that the settings do not have, no such behaviour, or one that they cannot do.
            ConfigError: it cannot be written; nothing has changed.
        """
        await self._change(lambda state: state.with_behaviour(order, self._scenario))

    async def resume(self, order: Resume) -> None:
        """Lift the stop of some robots, or everybody's.

        Args:
            order: the order.

        Raises:
            OrderRefused: the stop has changed since the operator looked, or a robot that the settings do not have.
            ConfigError: it cannot be written; nothing is lifted.
        """
        await self._change(lambda state: state.resumed(order, self._scenario))

    # ---- inside

    async def _save_leases(self) -> None:
        while self._unsaved_leases:
            self._unsaved_leases = False
            try:
                await self._written(self.state)
            except ConfigError as error:
                log.error("the leases hold, but are not saved: %s", error)
        self._saving_leases = None

    def _hold(self, new: KeptState) -> Awaitable[None]:
        self.state = new
        return self._written(new)

    async def _change(self, change: Callable[[KeptState], KeptState]) -> None:
        async with self._changing:
            while True:
                before = self.state
                new = change(before)
                await self._written(new)
                if self.state is before:
                    self.state = new
                    return
                # A stop came in while the disk was busy: the change is made to what holds now.

    def _written(self, state: KeptState) -> asyncio.Future[None]:
        """The write begins before this returns, so that the file ends up with what was decided last."""
        if self._file is not None:
            return self._file.write(state)
        done: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        done.set_result(None)
        return done
