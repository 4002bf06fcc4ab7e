"""Stops from pages: sent to the robots as soon as they are read, then confirmed, a bounded number at a time."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any, Final

from basestation.dashboard.access import Right
from basestation.dashboard.client import Client
from muro_zenoh.orders.receipt import StopStatus
from muro_zenoh.orders.stop import REPEATED_FOR, StopResult, send_stop, stop_robots
from muro_zenoh.orders.wording import receipt_json, receipt_lines
from muro_zenoh.transport import Bus

log = logging.getLogger(__name__)

_YOUNG: Final = 0.25
"""A stop of the same robots by the same client joins a confirmation that began no longer ago: its order is still being
repeated [s]. Later ones begin a new confirmation, because somebody may have resumed in between."""

_MOST_AT_ONCE: Final = 8
"""Confirmations under way, of all viewers together and of all operators: each listens to all robots, and has the base
station save its state. The others wait for their turn; their stops have been sent."""

_MOST_OF_CLIENT: Final = 32
"""Confirmations of one client that are under way or wait."""

_MOST_IDS: Final = 16
"""Presses that one receipt answers; the oldest go unanswered."""


@dataclass(slots=True)
class _Confirmation:
    """What waits until robots have confirmed a stop, and the presses that it answers."""

    client: Client
    names: tuple[str, ...]
    ids: list[int]
    task: asyncio.Task[None] | None = None
    began: float = math.inf


class Stops:
    """Stops robots for clients.

    A stop is sent before :meth:`stop` returns. What follows (repetition, the base station's record, the receipt) may be
    cancelled at any time without losing it: a robot that has latched it reports so, and the base station adopts it.

    Args:
        bus: the bus, as an operator.
        confirmed: called when a receipt is there.
    """

    def __init__(self, bus: Bus, confirmed: Callable[[], None]) -> None:
        self._bus = bus
        self._confirmed = confirmed
        self._loop = asyncio.get_running_loop()
        self._places = {right: asyncio.Semaphore(_MOST_AT_ONCE) for right in (Right.VIEW, Right.STEER)}
        self._under_way: dict[tuple[int, tuple[str, ...]], _Confirmation] = {}

    def stop(self, client: Client, number: int, names: Collection[str]) -> None:
        """Stop robots, now; the client gets the receipt later.

        Args:
            client: who stops them.
            number: of its order, for the reply.
            names: which robots; none for all.
        """
        key = client.number, tuple(sorted(set(names)))
        try:
            send_stop(self._bus, key[1])
        except Exception:  # whatever it is: the confirmation sends it again
            log.exception("stop of client %d: it cannot be sent; it is tried again", client.number)
        ids = [number]
        running = self._under_way.get(key)
        if running is not None:
            running.ids[:] = [*running.ids[1 - _MOST_IDS :], number]
            if self._loop.time() - running.began < _YOUNG:
                return
            self._end(running)
            ids = running.ids
        elif sum(one.client is client for one in self._under_way.values()) >= _MOST_OF_CLIENT:
            reason = f"it was sent to the robots; {_MOST_OF_CLIENT} receipts are still awaited"
            client.reply(id=number, order="stop", outcome="unanswered", reason=reason)
            return
        made = self._under_way[key] = _Confirmation(client, key[1], ids)
        made.task = asyncio.create_task(self._confirm(made), name=f"stop of client {client.number}")

    def make_way(self, client: Client, names: Collection[str]) -> str:
        """Let a client resume robots: the stops of them that it gave itself are repeated no longer.

        Args:
            client: who resumes.
            names: which robots; none for all.

        Returns:
            Why it may not resume yet; empty when it may.
        """
        own = [
            one
            for one in self._under_way.values()
            if one.client is client and (not names or not one.names or not set(names).isdisjoint(one.names))
        ]
        if any(self._loop.time() - one.began < REPEATED_FOR for one in own):
            return "a stop was pressed just now, and is still sent: look again, then resume"
        for one in own:
            self._end(one)
            self._reply(one, {"outcome": "unanswered", "reason": "resumed before every robot had confirmed"})
        return ""

    async def close(self) -> None:
        """Wait for no receipt any longer: what was sent holds."""
        tasks = [one.task for one in self._under_way.values() if one.task is not None]
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks)

    async def _confirm(self, one: _Confirmation) -> None:
        try:
            async with self._places[one.client.right]:
                one.began = self._loop.time()
                result = _of(await stop_robots(self._bus, one.names))
        except Exception as error:
            log.exception("stop of client %d: no receipt", one.client.number)
            result = {"outcome": "unanswered", "reason": f"it was sent, and nobody confirms it: {error}"}
        self._forget(one)
        self._confirmed()
        self._reply(one, result)

    def _end(self, one: _Confirmation) -> None:
        self._forget(one)
        if one.task is not None:
            one.task.cancel()

    def _forget(self, one: _Confirmation) -> None:
        self._under_way.pop((one.client.number, one.names), None)

    @staticmethod
    def _reply(one: _Confirmation, result: dict[str, Any]) -> None:
        for number in one.ids:
            one.client.reply(id=number, order="stop", **result)


def _of(result: StopResult) -> dict[str, Any]:
    lines = receipt_lines(result)
    unheard = (StopStatus.UNCONFIRMED, StopStatus.NOT_ALIVE, StopStatus.UNKNOWN)
    latched = any(robot.status not in unheard for robot in result.robots.values())
    answered = latched or (result.reply is not None and result.reply.accepted)
    return {
        "outcome": "taken" if answered else "unanswered",
        "reason": "" if result.confirmed else lines[-1],
        "receipt": {**receipt_json(result), "lines": lines},
    }
