"""The door through which behaviours come in, built in or a user's own: ``module:function``, called with the robot."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Awaitable, Callable
from typing import Final

from agents.robot import Robot
from muro_zenoh.errors import BehaviourError

BehaviourFunction = Callable[[Robot], Awaitable[None]]

BUILT_IN: Final = {
    "circle": "agents.tasks.path_following:circle",
    "pursuit": "agents.tasks.pursuit:pursuit",
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
    module_name, colon, function_name = BUILT_IN.get(name, name).partition(":")
    if not colon:
        raise BehaviourError(
            f"behaviour: got {name!r}, expected one of {', '.join(BUILT_IN)}, or your own as module:function"
        )
    try:
        function = getattr(importlib.import_module(module_name), function_name)
    except ModuleNotFoundError as error:
        raise BehaviourError(
            f"behaviour {name!r}: {error}; is the file's folder on the path of the agent (PYTHONPATH)?"
        ) from error
    except AttributeError:
        raise BehaviourError(f"behaviour {name!r}: module {module_name} has no function {function_name!r}") from None
    except Exception as error:
        raise BehaviourError(f"behaviour {name!r}: importing {module_name} failed: {error!r}") from error
    if not inspect.iscoroutinefunction(function) or len(inspect.signature(function).parameters) != 1:
        raise BehaviourError(f"behaviour {name!r}: got {function!r}, expected `async def {function_name}(robot)`")
    return function  # type: ignore[no-any-return]  # just checked
