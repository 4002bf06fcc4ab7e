"""Orders to the base station: each is a query with one reply, accepted or refused with the reason.

Nothing here waits for a camera. A change is saved before it is accepted; only a stop takes effect at once and is
published before it is saved.
"""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from typing import TypeVar

from basestation.fleet.leases import Leases
from basestation.fleet.state_store import StateStore
from basestation.tasks.kept_state import KeptStateTask
from basestation.tasks.positions import PositionsTask
from muro_zenoh import channels
from muro_zenoh.errors import MuroError, OrderRefused
from muro_zenoh.messages import Clear, Message, Reply, Resume, SetBehaviour, SetCircle, Stop, TakeLease
from muro_zenoh.transport import Bus, Closable

log = logging.getLogger(__name__)

T = TypeVar("T", bound=Message)


class OrdersTask:
    """Answers orders.

    Args:
        bus: the bus.
        store: the kept state.
        kept: publishes it.
        leases: who may order which robots.
        positions: the fleet's table.
    """

    def __init__(
        self, bus: Bus, store: StateStore, kept: KeptStateTask, leases: Leases, positions: PositionsTask
    ) -> None:
        self._bus = bus
        self._store = store
        self._kept = kept
        self._leases = leases
        self._positions = positions
        self._declared: list[Closable] = []
        self._closed = False

    def listen(self) -> None:
        """Answer orders until :meth:`close`."""
        self._answer(channels.STOP_ORDER, self._stop)
        self._answer(channels.RESUME, self._resume)
        self._answer(channels.SET_CIRCLE, self._set_circle)
        self._answer(channels.SET_BEHAVIOUR, self._set_behaviour)
        self._answer(channels.CLEAR, self._clear)
        self._answer(channels.TAKE_LEASE, self._take_lease)

    def close(self) -> None:
        """Take no more orders: nothing would publish what they change. One that is on its way is refused."""
        self._closed = True
        for declared in self._declared:
            declared.close()

    def _answer(self, verb: channels.Verb[T], obey: Callable[[T], Awaitable[None]]) -> None:
        async def answer(order: T) -> Reply:
            try:
                if self._closed:
                    raise OrderRefused("the base station is shutting down")
                await obey(order)
            except MuroError as error:
                log.info("%s: refused: %s", order, error)
                return Reply(accepted=False, reason=str(error), revision=self._store.revision)
            log.log(logging.DEBUG if isinstance(order, TakeLease) else logging.INFO, "%s: accepted", order)
            return Reply(accepted=True, revision=self._store.revision)

        self._declared.append(self._bus.answer(verb, answer))

    async def _stop(self, order: Stop) -> None:
        saved = self._store.add_stop(order)
        self._kept.publish()
        await saved

    async def _resume(self, order: Resume) -> None:
        if not self._kept.adopted:  # it could lift a stop that an operator ordered in the meantime
            raise OrderRefused(
                "resume: the base station has just started and is still receiving the robots' stop states; "
                "try again in 2 s"
            )
        await self._store.resume(order)
        self._kept.publish()

    async def _set_circle(self, order: SetCircle) -> None:
        self._leases.check(order, (), self._bus.clock.now())
        await self._store.set_circle(order)
        self._kept.publish()

    async def _set_behaviour(self, order: SetBehaviour) -> None:
        self._leases.check(order, order.names, self._bus.clock.now())
        await self._store.set_behaviour(order)
        self._kept.publish()

    async def _take_lease(self, order: TakeLease) -> None:
        before = self._store.state.leases
        self._leases.take(order, self._store.robots, self._bus.clock.now())
        if self._store.state.leases != before:
            self._kept.publish_leases()

    async def _clear(self, order: Clear) -> None:
        if not self._positions.clear(order.name):
            raise OrderRefused(f"robot {order.name} was never seen")
