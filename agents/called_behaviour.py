"""A user's plain function as a behaviour: called at each estimate, it returns the twist."""

from __future__ import annotations

import reprlib
from collections.abc import Callable
from typing import Any

from agents.robot import Connection, Robot, twist_of
from muro_zenoh.behaviours.interface import Behaviour, Intent, Seen, hold
from muro_zenoh.errors import BehaviourError, ParameterError
from muro_zenoh.geometry import Twist2
from muro_zenoh.messages import Estimate
from muro_zenoh.transport import Latest


class CalledBehaviour(Behaviour):
    """A user's own function that is called at each estimate and returns ``v, omega``.

    It may call the robot's methods instead and return None.

    Args:
        function: the function.
        make_robot: makes the robot that it is called with.
    """

    def __init__(self, function: Callable[[Robot], Any], make_robot: Callable[[Connection], Robot]) -> None:
        self._function = function
        self._seen: Seen | None = None
        self._intent: Intent | None = None
        self._ride: Behaviour | None = None
        self._robot = make_robot(
            Connection(lambda: self._seen, self._want, self._behave, _no_estimates, lambda: self._seen_now)
        )

    def step(self, seen: Seen) -> Intent:
        """Call the function.

        Args:
            seen: the observations for the robot's properties.

        Raises:
            ParameterError: it returned something else.
        """
        self._seen, self._intent = seen, None
        wanted = self._function(self._robot)
        if wanted is not None:
            return Intent(_returned(wanted))
        if self._intent is not None:
            return self._intent
        return self._ride.step(seen) if self._ride is not None else hold("the behaviour returned nothing")

    @property
    def _seen_now(self) -> float:
        return self._seen.now if self._seen is not None else 0.0

    def _want(self, intent: Intent) -> None:
        self._intent = intent

    def _behave(self, ride: Behaviour | None) -> None:
        self._ride = ride


def _returned(wanted: Any) -> Twist2:
    try:
        v, omega = wanted
    except (TypeError, ValueError):
        raise ParameterError(
            "return value", got=reprlib.repr(wanted), expected="`return v, omega` [m/s, rad/s]"
        ) from None
    return twist_of(v, omega)


def _no_estimates() -> Latest[Estimate]:
    raise BehaviourError("robot.estimates() needs `async def f(robot)`; a plain function is called at each estimate")
