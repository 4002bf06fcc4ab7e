"""The door through which behaviours come in, built in or a user's own: ``module:function``, called with the robot."""

from __future__ import annotations

import inspect
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Final

from agents.robot import Robot
from muro_zenoh.behaviours.entry_points import load_function
from muro_zenoh.config import parameters_as
from muro_zenoh.errors import BehaviourError, ConfigError

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

_PARAMETERS: Final = {
    "circle": "agents.tasks.path_following:CircleParameters",
    "pursuit": "agents.tasks.pursuit:PursuitParameters",
    "dubins": "agents.tasks.dubins:DubinsParameters",
    "coverage": "agents.tasks.coverage:CoverageParameters",
    "steer": "agents.tasks.steer:SteerParameters",
}
"""What their parameters are."""

_LAWS: Final = ("circle_law", "pursuit_law", "density")
"""What is made of parameters, and may refuse them."""


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


def check_behaviour(name: str, parameters: Mapping[str, object], where: str) -> None:
    """Refuse, before anything starts, what no robot could run.

    Args:
        name: of the behaviour.
        parameters: for it; those of a user's own behaviour are its own affair.
        where: the file or order that names it, for errors.

    Raises:
        ConfigError: no such behaviour, or a wrong parameter.
    """
    try:
        load_behaviour(name)
    except BehaviourError as error:
        raise ConfigError(
            f"{where}: behaviour.name",
            got=repr(name),
            expected=str(error).partition("expected ")[2] or f"one that loads: {error}",
        ) from None
    if name not in _PARAMETERS:
        return
    kind: Any = load_function(_PARAMETERS[name])
    checked = parameters_as(kind, parameters, where)
    for law in _LAWS:
        try:
            getattr(checked, law, lambda: None)()
        except ValueError as error:
            what, _, rest = str(error).partition(": got ")
            got, _, expected = rest.partition(", expected ")
            raise ConfigError(f"{where}: behaviour: {what}", got=got or what, expected=expected or "another") from None
