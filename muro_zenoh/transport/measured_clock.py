"""Another process's clock as this one measures it: asked about once a second, and answered at once.

Every process measures the base station's, and an agent that of its base: a link that was slow from the beginning would
else count as quick, and wheel speeds would seem to be later than they are.
"""

from __future__ import annotations

import asyncio
import math
from typing import Final

from muro_zenoh import channels
from muro_zenoh.channels import Verb
from muro_zenoh.config import ClockSettings
from muro_zenoh.errors import MuroError
from muro_zenoh.messages import AskTime, Reply
from muro_zenoh.transport.bus import Bus
from muro_zenoh.transport.clock_offset import OffsetEstimate, RoundTrip
from muro_zenoh.transport.link import Closable

_PERIOD: Final = 1.0
_FIRST_PERIOD: Final = 0.1
_FIRST: Final = 8
"""So many questions are asked one after the other at the start, and after a clock was set or an answer did not come."""

_TIMEOUT: Final = 3.0
"""An answer is awaited for this time [s]: far longer than a path takes on which a robot may drive, for a path that was
never measured counts as quick."""

_SILENT: Final = 5.0
"""A base station that has not answered for this time is a complaint [s]."""

_STEP_SHOWN: Final = 10.0
"""A clock that was set stays a complaint for this time [s]."""


class MeasuredClock:
    """Our clock against another process's.

    Args:
        bus: the bus; its mailboxes judge the other's messages by what is measured.
        verb: asks for the time.
        name: whose, where the verb has names.
    """

    def __init__(self, bus: Bus, verb: Verb[AskTime], name: str = "") -> None:
        self._bus = bus
        self._verb = verb
        self._name = name
        self._estimate = OffsetEstimate()
        self._epoch = 0
        self._at_once = _FIRST
        self._gets_answers = False

    async def run(self) -> None:
        """Measure until cancelled."""
        while True:
            unknown = self._estimate.best is None
            self._at_once = max(0, self._at_once - 1)
            try:
                await self._ask()
                self._gets_answers = True
            except MuroError:  # nobody answers, or not with a reply
                if self._gets_answers:  # another one may be there in a moment
                    self._gets_answers, self._at_once = False, _FIRST
            if unknown and self._estimate.best is not None:
                continue  # the other one learns of our clock with the second question
            await asyncio.sleep(_FIRST_PERIOD if self._at_once else _PERIOD)

    async def _ask(self) -> None:
        bus, estimate = self._bus, self._estimate
        sent = bus.clock.now()
        question = AskTime(offset=estimate.offset if estimate.best is not None else None, steps=estimate.steps)
        reply = await bus.ask(self._verb, question, name=self._name, timeout=_TIMEOUT)
        self.take(reply.epoch, RoundTrip(sent, reply.received, reply.stamp, bus.clock.now()))

    def take(self, epoch: int, trip: RoundTrip) -> float:
        """Take an answer.

        Args:
            epoch: the process that answered; another one starts anew.
            trip: the time stamps.

        Returns:
            By how much its clock was set against ours [s]; 0 unless that is certain.
        """
        if epoch != self._epoch:
            self._epoch, self._estimate, self._at_once = epoch, OffsetEstimate(), _FIRST
        step = self._estimate.add(trip)
        if self._estimate.best is not None:
            self._bus.clocks.note(epoch, -self._estimate.offset, trip.returned, self._estimate.steps)
        if step:
            self._at_once = _FIRST
        return step


class StationClock(MeasuredClock):
    """Our clock against the base station's, and what an operator should know of it.

    Args:
        bus: the bus; its mailboxes judge the base station's messages by what is measured.
        settings: above which differences there is a complaint.
    """

    def __init__(self, bus: Bus, settings: ClockSettings) -> None:
        super().__init__(bus, channels.TIME)
        self._settings = settings
        self._step = 0.0
        self._stepped = -math.inf
        self._answered = bus.clock.now()

    def take(self, epoch: int, trip: RoundTrip) -> float:
        """Take an answer, as :meth:`MeasuredClock.take` does.

        Args:
            epoch: the base station that answered; another one starts anew.
            trip: the time stamps.
        """
        step = super().take(epoch, trip)
        if self._estimate.best is not None:
            self._answered = trip.returned
        if abs(step) > self._settings.step:
            self._step, self._stepped = step, trip.returned
        return step

    def complaints(self) -> tuple[str, ...]:
        """What is wrong with our clock or the base station's, for the operator."""
        now, found = self._bus.clock.now(), []
        best = self._estimate.best
        if best is not None and abs(best.offset) - self._estimate.bound(now) > self._settings.skew:
            found.append(
                f"clock {_time(best.offset)} {'behind' if best.offset > 0 else 'ahead of'} the base station's "
                f"(limit {_time(self._settings.skew)})"
            )
        if now - self._stepped <= _STEP_SHOWN:
            found.append(
                f"clock was set {_time(self._step)} {'back' if self._step > 0 else 'forward'} against the base "
                f"station's (limit {_time(self._settings.step)} within a second)"
            )
        silent = now - self._answered
        if silent > _SILENT:
            found.append(f"clock not compared: the base station has not answered for {silent:.0f} s")
        return tuple(found)

    def numbers(self) -> dict[str, float]:
        """The offset, the round trip and the offset's bound as gauges for a health message [s]."""
        best = self._estimate.best
        if best is None:
            return {}
        return {
            "clock_offset_s": round(self._estimate.offset, 6),
            "clock_round_trip_s": round(best.duration, 6),
            "clock_bound_s": round(self._estimate.bound(self._bus.clock.now()), 6),
        }


def answer_time(bus: Bus, verb: Verb[AskTime] = channels.TIME, name: str = "") -> Closable:
    """Answer with this process's time.

    Args:
        bus: this process's; its mailboxes judge the askers' messages by what they have measured.
        verb: that asks for it: by default for the base station's.
        name: whose time, where the verb has names.
    """

    def answer(order: AskTime) -> Reply:
        if order.offset is not None:
            bus.clocks.note(order.epoch, order.offset, bus.clock.now(), order.steps)
        return Reply(accepted=True)

    return bus.answer(verb, answer, name=name)


def _time(value: float) -> str:
    value = abs(value)
    return f"{value:.3g} s" if value >= 1.0 else f"{1e3 * value:.0f} ms"
