"""Orders from pages: each is one that the command line gives too, and is answered with what came of it."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine, Mapping
from typing import Any, Final

from basestation.dashboard.access import Right
from basestation.dashboard.client import Client
from basestation.dashboard.hands import Hands
from basestation.dashboard.requests import (
    Answered,
    BehaviourOrder,
    BreakOrder,
    CircleOrder,
    ClearOrder,
    DriveOrder,
    GoalOrder,
    Order,
    PictureOrder,
    ResumeOrder,
    StopOrder,
    read_order,
)
from basestation.dashboard.stops import Stops
from basestation.dashboard.watching import FleetWatch
from muro_zenoh import channels
from muro_zenoh.behaviours import table
from muro_zenoh.behaviours.interface import Need
from muro_zenoh.config import Scenario
from muro_zenoh.config.faults import CarryFault, Place
from muro_zenoh.errors import MuroError, NoReply, OrderRefused
from muro_zenoh.messages import Break, Clear, DriveWish, Goal, Reply, SetBehaviour, SetCircle
from muro_zenoh.orders.behaviour import set_behaviour
from muro_zenoh.orders.goal import send_goal
from muro_zenoh.orders.stop import resume_robots
from muro_zenoh.transport import Bus

log = logging.getLogger(__name__)

_MOST_AT_ONCE: Final = 8
"""Orders of one client that are under way; a stop does not count."""

_BREAK_TIMEOUT: Final = 8.0
"""A process whose link is to be broken may have to start anew first [s]."""

_OLDEST_SIGHT: Final = 0.3
"""Nobody drives by a state that is older [s]; the time until the wish arrives counts, so that none is late, either."""

_CARRY: Final = CarryFault.__struct_config__.tag

_BY_HAND: Final = frozenset(name for name in table.names() if Need.HAND in table.built_in(name).needs)
"""The behaviours that are driven by hand."""

_FREE: Final = ("stop", "picture")
"""What everyone may who may read."""


class Desk:
    """Takes orders, and gives them to the fleet.

    Args:
        bus: the bus, as an operator.
        scenario: the settings.
        watch: what is known of the fleet.
    """

    def __init__(self, bus: Bus, scenario: Scenario, watch: FleetWatch) -> None:
        self._bus = bus
        self._scenario = scenario
        self._watch = watch
        self._hands = Hands(bus)
        self._running: dict[int, set[asyncio.Task[None]]] = {}
        self._stops = Stops(bus, scenario.robots, watch.look)
        self._give: Mapping[type, Callable[[Any], Coroutine[Any, Any, dict[str, Any]]]] = {
            ResumeOrder: self._resume,
            GoalOrder: self._goal,
            BehaviourOrder: self._behaviour,
            CircleOrder: self._circle,
            ClearOrder: self._clear,
            BreakOrder: self._break,
        }

    def take(self, client: Client, data: bytes) -> None:
        """Take an order.

        Args:
            client: whose.
            data: the message.

        Raises:
            BadMessage: it is none.
        """
        order = read_order(data)
        if client.right is not Right.STEER and order.word not in _FREE:
            self._answer(client, order, outcome="refused", reason="only an operator may: open the operator's link")
        elif isinstance(order, StopOrder):
            self._stops.stop(client, order.id, order.names)
            self._hands.release(order.names)
        elif isinstance(order, DriveOrder):
            self._drive(client, order)
        elif isinstance(order, PictureOrder):
            self._picture(client, order)
        else:
            self._begin(client, order)

    def leave(self, client: Client) -> None:
        """Forget a client that is gone: nothing is driven for it. Orders that it gave are carried out, and what it
        stopped stays stopped.

        Args:
            client: which.
        """
        self._hands.leave(client.number)
        self._stops.leave(client)

    async def close(self) -> None:
        """Drive nobody any more, and wait for no answer: what was ordered holds."""
        self._hands.release(())
        await self._stops.close()
        tasks = set().union(*self._running.values())
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks)

    # ---- orders that are answered

    def _begin(self, client: Client, order: Answered) -> None:
        running = self._running.setdefault(client.number, set())
        if len(running) >= _MOST_AT_ONCE:
            self._answer(client, order, outcome="refused", reason=f"{len(running)} orders are still under way")
            return
        if isinstance(order, ResumeOrder) and (reason := self._stops.make_way(client, order.names)):
            self._answer(client, order, outcome="refused", reason=reason)
            return

        async def give() -> None:
            try:
                result = await self._give[type(order)](order)
            except NoReply as error:
                result = {"outcome": "unanswered", "reason": str(error)}
            except (MuroError, ValueError) as error:
                result = {"outcome": "refused", "reason": str(error)}
            self._watch.look()
            self._answer(client, order, **result)

        task = asyncio.create_task(give(), name=f"{order.word} of client {client.number}")
        running.add(task)
        task.add_done_callback(lambda done: self._end(client.number, done))

    def _end(self, number: int, task: asyncio.Task[None]) -> None:
        running = self._running[number]
        running.discard(task)
        if not running:
            del self._running[number]
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("%s: %r", task.get_name(), error, exc_info=error)

    async def _resume(self, order: ResumeOrder) -> dict[str, Any]:
        def accepted() -> None:
            self._stops.resumed(order.names)

        result = await resume_robots(self._bus, order.names, order.revision, accepted)
        still = f"still stopped: {' '.join(result.still_stopped)}" if result.still_stopped else ""
        return _of_reply(result.reply, still)

    async def _goal(self, order: GoalOrder) -> dict[str, Any]:
        self._require(order.name)
        goal = Goal(x=order.x, y=order.y, theta=order.theta)
        reply = await send_goal(self._bus, order.name, goal)
        if reply.accepted:
            self._watch.set_goal(order.name, goal)
        return _of_reply(reply)

    async def _behaviour(self, order: BehaviourOrder) -> dict[str, Any]:
        # A page leaves out what is as by default; those of a user's own are the scenario's, which no robot knows.
        own, parameters = self._scenario.behaviour, order.parameters
        if ":" in order.behaviour and order.behaviour == own.name:
            parameters = {**own.parameters, **parameters}
        change = SetBehaviour(behaviour=order.behaviour, parameters=parameters, names=order.names)
        result = await set_behaviour(self._bus, change)
        if result.refusals:
            reasons = "; ".join(f"{name} cannot run it: {reason}" for name, reason in result.refusals.items())
            return {"outcome": "refused", "reason": reasons}
        absent = [name for name in order.names or self._scenario.robots if not self._watch.has_agent(name)]
        missing = f"no agent is running for {' '.join(absent)}" if absent and result.reply.accepted else ""
        return _of_reply(result.reply, missing)

    async def _circle(self, order: CircleOrder) -> dict[str, Any]:
        change = SetCircle(x=order.x, y=order.y, radius=order.radius, clockwise=order.clockwise)
        return _of_reply(await self._bus.ask(channels.SET_CIRCLE, change))

    async def _clear(self, order: ClearOrder) -> dict[str, Any]:
        return _of_reply(await self._bus.ask(channels.CLEAR, Clear(name=order.name)))

    async def _break(self, order: BreakOrder) -> dict[str, Any]:
        if not self._watch.can_be_broken:
            raise ValueError("only a fleet that `muro run` simulates can be broken")
        if order.kind == _CARRY and order.duration is not None and not any(order.numbers.values()):
            raise ValueError("carry: got no way and no angle, expected one of x, y, theta that is not 0")
        fault = Break(fault=order.kind, target=order.target, duration=order.duration, numbers=order.numbers)
        try:
            return _of_reply(await self._bus.ask(channels.BREAK, fault, timeout=_BREAK_TIMEOUT))
        except NoReply as error:
            if order.target != Place.ROUTER:
                raise
            raise NoReply("the answer would have come over the router, which was to be broken") from error

    # ---- what is not answered

    def _drive(self, client: Client, order: DriveOrder) -> None:
        try:
            self._require(order.name)
            behaviour = self._watch.behaviours.get(order.name)
            if behaviour is None or behaviour.behaviour not in _BY_HAND:
                runs = f"runs {behaviour.behaviour}" if behaviour is not None else "has no behaviour yet"
                raise ValueError(f"{order.name} {runs}: choose the behaviour {' or '.join(sorted(_BY_HAND))} first")
            if (order.v, order.omega) != (0.0, 0.0):
                self._require_free(order.name)
                age = self._bus.clock.now() - order.t
                if not 0.0 <= age <= _OLDEST_SIGHT:
                    raise ValueError(
                        f"got a wish by a state of {age:.1f} s ago, expected at most {_OLDEST_SIGHT:g} s: the "
                        "connection is too slow to drive by hand"
                    )
            self._hands.drive(client.number, order.name, order.v, order.omega)
        except (MuroError, ValueError) as error:
            if self._hands.may_complain(client.number):
                self._answer(client, order, outcome="refused", reason=str(error))

    def _picture(self, client: Client, order: PictureOrder) -> None:
        if order.camera not in self._scenario.camera:
            cameras = ", ".join(self._scenario.camera) or "none"
            self._answer(client, order, outcome="refused", reason=f"got {order.camera!r}, expected one of {cameras}")
            return
        (client.cameras.add if order.on else client.cameras.discard)(order.camera)
        self._answer(client, order, outcome="taken", reason="")

    def _require(self, name: str) -> None:
        if name not in self._scenario.robot:
            raise ValueError(f"got the robot {name!r}, expected one of {', '.join(self._scenario.robots)}")

    def _require_free(self, name: str) -> None:
        """A wish has no reply from the robot, so that it ignores those of others would not be seen."""
        ours = DriveWish(v=0.0, omega=0.0, operator=self._bus.operator)
        for lease in self._watch.leases:
            if lease.covers((name,)) and not lease.admits(ours):
                raise OrderRefused(str(lease))

    @staticmethod
    def _answer(client: Client, order: Order, **values: Any) -> None:
        client.reply(id=order.id, order=order.word, **values)


def _of_reply(reply: Reply, reason: str = "") -> dict[str, Any]:
    return {"outcome": "taken" if reply.accepted else "refused", "reason": reason or reply.reason}
