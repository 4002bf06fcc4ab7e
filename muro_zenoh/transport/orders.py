"""Taking orders: questions that are asked on one key, and answered once each."""

from __future__ import annotations

import asyncio
import inspect
import logging
import threading
from collections.abc import Awaitable, Callable
from typing import Any, Generic, TypeVar

import msgspec

from muro_zenoh.channels import Role, Verb
from muro_zenoh.errors import MessageError, MuroError, OrderRefused
from muro_zenoh.messages import Message, Order, Reply, check_encoding, decode
from muro_zenoh.runtime.clock import Clock
from muro_zenoh.transport.clock_offset import RoundTrip
from muro_zenoh.transport.link import Question
from muro_zenoh.transport.pulse import LONGEST_WAIT, Pulse
from muro_zenoh.transport.received import Counters

log = logging.getLogger(__name__)

T = TypeVar("T", bound=Message)
O = TypeVar("O", bound=Order)  # noqa: E741 - an order

MAX_WAITING = 64
"""Orders on one key that wait for their answer at most; more are dropped, and counted."""


class Orders(Generic[T]):
    """The orders on one key.

    Args:
        verb: which order.
        key: the key, for the log.
        handle: takes an order, returns its reply or something to await for it.
        send: sends a reply to an order that came at a time.
        clock: for these times, and for how long an order has waited.
        loop: where ``handle`` is called.
        counters: what becomes of the orders.
        pulse: whether this process was frozen, and an order may be left over from that time.
        ahead_of: what to add to the clock of the process with an epoch to have ours [s]; infinite when that is unknown.
    """

    def __init__(
        self,
        verb: Verb[T],
        key: str,
        handle: Callable[[T], Reply | Awaitable[Reply]],
        send: Callable[[Question, Reply, float], None],
        clock: Clock,
        loop: asyncio.AbstractEventLoop,
        counters: Counters,
        pulse: Pulse,
        ahead_of: Callable[[int], float],
    ) -> None:
        self._verb = verb
        self._key = key
        self._handle = handle
        self._send = send
        self._now = clock.now
        self._loop = loop
        self._counters = counters
        self._pulse = pulse
        self._ahead_of = ahead_of
        self._lock = threading.Lock()
        self._waiting = 0
        self._tasks: dict[asyncio.Task[None], None] = {}

    def file(self, question: Question) -> None:
        """Take a question from the middleware; from any thread."""
        arrival = self._now()
        with self._lock:
            self._counters.received += 1
            if self._waiting >= MAX_WAITING:
                self._counters.dropped += 1
                return
            self._waiting += 1
        try:
            self._loop.call_soon_threadsafe(self._take, question, self._pulse.paused(), arrival)
        except RuntimeError:
            log.debug("%s: a question came after the loop had closed", self._key)

    def close(self) -> list[asyncio.Task[Any]]:
        """Cancel the answers that are still being worked on; they are returned, to be waited for."""
        tasks = list(self._tasks)
        for task in tasks:
            task.cancel()
        return tasks

    def _take(self, question: Question, paused: bool, arrival: float) -> None:
        answer: Reply | Awaitable[Reply]
        try:
            order = self._read(question)
            if not self._verb.at_any_age:
                self._refuse_old(order, self._now(), arrival, paused)
            answer = self._handle(order)
        except Exception as error:
            answer = self._refusal(error)
        if inspect.isawaitable(answer):
            task = self._loop.create_task(self._finish(question, arrival, answer), name=f"order {self._key}")
            self._tasks[task] = None
            task.add_done_callback(self._tasks.pop)
        else:
            self._reply(question, arrival, answer)

    def _read(self, question: Question) -> T:
        try:
            check_encoding(question.encoding, self._verb.kind)
            return decode(question.payload, self._verb.kind)
        except MessageError:
            self._counters.rejected += 1
            raise

    def _refuse_old(self, order: T, now: float, arrival: float, paused: bool) -> None:
        """Refuse an order whose sender may have heard already that nobody answers."""
        reason = ""
        if paused or now - arrival > LONGEST_WAIT:
            reason = "the process that takes it was frozen, and the order may be old"
        elif isinstance(order, Order) and order.until is not None:
            late = now - order.until - self._ahead_of(order.clock)
            if late > 0.0:
                reason = f"it came {late:.1f} s after its sender had stopped waiting for the answer"
        if reason:
            self._counters.late += 1
            raise OrderRefused(f"{reason}: give it again")

    async def _finish(self, question: Question, arrival: float, answer: Awaitable[Reply]) -> None:
        try:
            reply = await answer
        except Exception as error:
            reply = self._refusal(error)
        self._reply(question, arrival, reply)

    def _refusal(self, error: Exception) -> Reply:
        """What is replied in place of an error; called while it is handled."""
        if isinstance(error, MuroError):
            return Reply(accepted=False, reason=str(error))
        log.exception("%s: taking the order failed", self._key)
        return Reply(accepted=False, reason=f"taking it failed: {type(error).__name__}: {error}")

    def _reply(self, question: Question, arrival: float, reply: Reply) -> None:
        with self._lock:
            self._waiting -= 1
        self._send(question, reply, arrival)


def with_deadline(order: O, trip: RoundTrip, clock: int, timeout: float) -> O:
    """An order that says how long its sender waits, in time that its receiver can tell.

    Args:
        order: the order, to be sent at the end of the round trip.
        trip: a question to the base station for the time. By half of its duration the measured offset may be wrong, so
            the deadline is earlier by that: an answer that takes no longer comes in time all the same.
        clock: the epoch of that base station.
        timeout: how long the sender waits [s].

    Returns:
        The order; without a deadline when the round trip is impossible.
    """
    if not trip.is_possible:
        return order
    until = trip.returned + trip.offset + timeout - 0.5 * trip.duration
    return msgspec.structs.replace(order, until=until, clock=clock)


def nobody_answered(verb: Verb[Any], key: str, name: str, timeout: float) -> str:
    """The text of a :class:`~muro_zenoh.errors.NoReply`.

    Args:
        verb: which order.
        key: the key it was given on.
        name: whom it was for; empty where there is only one.
        timeout: how long was waited at most [s].
    """
    role = verb.answered_by
    who = "base station" if role is Role.BASESTATION else str(role)
    process = f"muro {'run' if role is Role.SUPERVISOR else role}"
    if name:
        who, process = f"{who} of {name}", f"{process} FILE {name}"
    return (
        f"{key}: nobody answered (waited at most {timeout:g} s), expected the {who} to answer. "
        f"Is `{process}` running, and on this router?"
    )
