"""The operator of a trial, who gives the scenario's orders."""

from __future__ import annotations

import asyncio
import contextlib
from typing import NamedTuple

from muro_zenoh import channels
from muro_zenoh.checking.fleet import VirtualFleet
from muro_zenoh.config import BehaviourSettings, Scenario
from muro_zenoh.config.order import OrderRow
from muro_zenoh.errors import MuroError
from muro_zenoh.messages import SetBehaviour
from muro_zenoh.orders.stop import resume_robots, stop_robots
from muro_zenoh.transport import Bus


class Ordered(NamedTuple):
    """An order that was given.

    Attributes:
        time: when [s].
        order: the order.
        accepted: whether it was; None when no answer came, so it may have been.
        answered: when the answer came, or was waited for no longer [s]: until then it may have taken effect.
    """

    time: float
    order: OrderRow
    accepted: bool | None
    answered: float


class Operator:
    """A faultless operator, at the fleet's own network. Called with a fleet it acts until it is cancelled.

    Args:
        scenario: the orders, and the goals that go with behaviours.

    Attributes:
        orders: what was ordered.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.orders: list[Ordered] = []
        self._scenario = scenario

    async def __call__(self, fleet: VirtualFleet) -> None:
        """Give each order when it is due.

        Args:
            fleet: the fleet.
        """
        async with asyncio.TaskGroup() as tasks:
            for order in self._scenario.orders:
                tasks.create_task(self._give(fleet, order), name=f"operator at {order.at:g} s")

    async def _give(self, fleet: VirtualFleet, order: OrderRow) -> None:
        await asyncio.sleep(order.at - fleet.elapsed)
        # A resume lifts a stop as soon as it is given: what came of it is known later.
        given, accepted, answered = fleet.elapsed, None, None
        try:
            with contextlib.suppress(MuroError):  # nobody answered
                accepted, answered = await _GIVE[order.kind](fleet.operator, order, self._scenario)
        finally:
            now = fleet.operator.clock.now()
            self.orders.append(Ordered(given, order, accepted, fleet.elapsed + (answered or now) - now))


Answer = tuple[bool, float]
"""Whether an order was accepted, and when its answer came [s since 1970]."""


async def _stop(bus: Bus, order: OrderRow, scenario: Scenario) -> Answer:
    return (await stop_robots(bus, order.robots)).confirmed, bus.clock.now()


async def _resume(bus: Bus, order: OrderRow, scenario: Scenario) -> Answer:
    result = await resume_robots(bus, order.robots)
    return result.reply.accepted, result.answered


async def _set_behaviour(bus: Bus, order: OrderRow, scenario: Scenario) -> Answer:
    common = BehaviourSettings(name=order.behaviour, parameters=order.parameters)
    of_each = {name: scenario.behaviour_of(name, common) for name in order.robots or scenario.robots}
    if all(own == common for own in of_each.values()):
        orders = [SetBehaviour(behaviour=common.name, parameters=common.parameters, names=order.robots)]
    else:
        orders = [
            SetBehaviour(behaviour=own.name, parameters=own.parameters, names=(name,)) for name, own in of_each.items()
        ]
    replies = [await bus.ask(channels.SET_BEHAVIOUR, each) for each in orders]
    return all(reply.accepted for reply in replies), bus.clock.now()


_GIVE = {"stop": _stop, "resume": _resume, "behaviour": _set_behaviour}
