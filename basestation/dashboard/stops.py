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
_MOST_OF_ALL: Final = 64
"""Confirmations of one client, and of all viewers or all operators, that are under way or wait."""

_MOST_IDS: Final = 16
"""Presses that one receipt answers; the oldest go unanswered."""


@dataclass(slots=True)
class _Confirmation:
    """What waits until robots have confirmed a stop, and the presses that it answers. It has ``begun`` when it was its
    turn: then its stop is sent anew, and repeated until it has arrived, and for a moment from there. ``sent`` is when
    it was sent, infinite when it could not be; ``arrived`` is when the first word of that came [s]."""

    client: Client
    names: tuple[str, ...]
    ids: list[int]
    sent: float
    arrived: float = math.nan
    begun: bool = False
    task: asyncio.Task[None] | None = None


class Stops:
    """Stops robots for clients.

    A stop is sent before :meth:`stop` returns. Once it has arrived, what follows (repetition, the base station's
    record, the receipt) may be cancelled without losing it: a robot that has latched it reports so, and the base
    station adopts it.

    Args:
        bus: the bus, as an operator.
        robots: those that are waited for; a stop of others is sent, and that is all.
        confirmed: called when a receipt is there.
    """

    def __init__(self, bus: Bus, robots: Collection[str], confirmed: Callable[[], None]) -> None:
        self._bus = bus
        self._robots = frozenset(robots)
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
        sent = self._loop.time()
        try:
            send_stop(self._bus, tuple(sorted(set(names))))
        except Exception:  # whatever it is: the confirmation sends it again
            log.exception("stop of client %d: it cannot be sent; it is tried again", client.number)
            sent = math.inf
        known = tuple(sorted(self._robots.intersection(names)))
        if names and not known:
            reason = "none of these robots is in the fleet file; the stop was sent to them all the same"
            client.reply(id=number, order="stop", outcome="refused", reason=reason)
            return
        ids = [number]
        running = self._under_way.get((client.number, known))
        if running is not None:
            running.ids[:] = [*running.ids[1 - _MOST_IDS :], number]
            if not running.begun:
                running.sent = sent
                return
            if self._loop.time() - running.sent < _YOUNG:
                return
            self._end(running)
            ids = running.ids
        elif awaited := self._too_many(client):
            reason = f"it was sent to the robots; {awaited} receipts are still awaited"
            client.reply(id=number, order="stop", outcome="unanswered", reason=reason)
            return
        made = self._under_way[client.number, known] = _Confirmation(client, known, ids, sent)
        made.task = asyncio.create_task(self._confirm(made), name=f"stop of client {client.number}")

    def make_way(self, client: Client, names: Collection[str]) -> str:
        """Let a client resume robots: the stops of them that it gave itself are repeated no longer.

        Args:
            client: who resumes.
            names: which robots; none for all.

        Returns:
            Why it may not resume yet; empty when it may.
        """
        own = [one for one in self._about(names) if one.client is client]
        if any(self._is_repeated(one) for one in own):
            return "a stop was pressed just now, and is still sent: look again, then resume"
        for one in own:
            self._overtake(one)
        return ""

    def resumed(self, names: Collection[str]) -> None:
        """Robots were resumed just now: stops of them that still wait for their turn are not sent anew, whoever gave
        them. One that was sent a moment ago is: the base station may not have known of it.

        Args:
            names: which robots; none for all.
        """
        for one in self._about(names):
            if not one.begun and self._loop.time() - one.sent >= REPEATED_FOR:
                self._overtake(one)

    def leave(self, client: Client) -> None:
        """Forget a client that is gone: its stops were sent, and those that wait for their turn do not any longer.

        Args:
            client: which.
        """
        for one in self._about(()):
            if one.client is client and not one.begun and one.sent < math.inf:
                self._end(one)

    async def close(self) -> None:
        """Wait for no receipt any longer: what has arrived holds."""
        tasks = [one.task for one in self._under_way.values() if one.task is not None]
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks)

    async def _confirm(self, one: _Confirmation) -> None:
        try:
            async with self._places[one.client.right]:
                one.begun, one.sent = True, self._loop.time()
                result = _of(await stop_robots(self._bus, one.names, lambda: self._note_arrival(one)))
        except Exception as error:
            log.exception("stop of client %d: no receipt", one.client.number)
            result = {"outcome": "unanswered", "reason": f"it was sent, and nobody confirms it: {error}"}
        self._forget(one)
        self._confirmed()
        self._reply(one, result)

    def _note_arrival(self, one: _Confirmation) -> None:
        one.arrived = self._loop.time()

    def _is_repeated(self, one: _Confirmation) -> bool:
        """Whether a stop is still sent, so that a resume would be undone, or the stop lost if it were cancelled. One
        that waits for its turn counts as arrived when it was sent."""
        since = one.arrived if one.begun else one.sent
        return not self._loop.time() - since >= REPEATED_FOR  # as with no time at all

    def _about(self, names: Collection[str]) -> list[_Confirmation]:
        """The confirmations that are about any of these robots; none for all."""
        ones = self._under_way.values()
        return [one for one in ones if not names or not one.names or not set(names).isdisjoint(one.names)]

    def _too_many(self, client: Client) -> int:
        """How many confirmations keep another one of a client from being awaited; 0 for none."""
        alike = [one.client for one in self._under_way.values() if one.client.right is client.right]
        own = sum(one is client for one in alike)
        return own if own >= _MOST_OF_CLIENT else len(alike) if len(alike) >= _MOST_OF_ALL else 0

    def _overtake(self, one: _Confirmation) -> None:
        self._end(one)
        self._reply(one, {"outcome": "unanswered", "reason": "resumed before every robot had confirmed"})

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
    unheard = (StopStatus.UNCONFIRMED, StopStatus.NOT_ALIVE, StopStatus.UNKNOWN)
    latched = any(robot.status not in unheard for robot in result.robots.values())
    answered = latched or (result.reply is not None and result.reply.accepted)
    return {
        "outcome": "taken" if answered else "unanswered",
        "reason": "" if result.confirmed else receipt_lines(result)[-1],
        "receipt": receipt_json(result),
    }
