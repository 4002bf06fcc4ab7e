"""The door through which behaviours come in, built in or a user's own: ``module:function``, called with the robot."""

from __future__ import annotations

import inspect
from collections.abc import Awaitable, Callable
from typing import Final

from agents.doors import load_function
from agents.robot import Robot
from muro_zenoh.errors import BehaviourError

BehaviourFunction = Callable[[Robot], Awaitable[None]]

BUILT_IN: Final = {
    "circle": "agents.tasks.path_following:circle",
    "pursuit": "agents.tasks.pursuit:pursuit",
    "dubins": "agents.tasks.dubins:dubins",
    "coverage": "agents.tasks.coverage:coverage",
    "steer": "agents.tasks.steer:steer",
    "hold": "agents.tasks.hold:hold",
}
"""Where the built-in behaviours are."""


def load_behaviour(name: str) -> BehaviourFunction:
    """The behaviour of a name.

    Args:
        name: a built-in one's, or ``module:function`` for ``async def function(robot)`` in a module that can be
            imported.

    Raises:
        BehaviourError: no such behaviour, module or function, or not an ``async def`` of one argument.
    """
    where = BUILT_IN.get(name, name)
    if ":" not in where:
        raise BehaviourError(f"got {name!r}, expected one of {', '.join(BUILT_IN)}, or your own as module:function")
    function = load_function(where)
    if not inspect.iscoroutinefunction(function) or len(inspect.signature(function).parameters) != 1:
        raise BehaviourError(f"{name!r}: got {function!r}, expected `async def f(robot)`")
    return function
