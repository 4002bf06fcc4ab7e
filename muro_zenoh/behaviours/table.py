"""The table of behaviours: each file of this package not listed here is one, under the file's name."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from muro_zenoh import behaviours
from muro_zenoh.behaviours import hold
from muro_zenoh.behaviours.entry_points import load_function
from muro_zenoh.behaviours.interface import BehaviourKind
from muro_zenoh.errors import BehaviourError

_NOT_BEHAVIOURS: Final = frozenset({"interface", "table", "entry_points"})

DEFAULT: Final = hold.__name__.rpartition(".")[2]
"""The behaviour of a robot for which none is set."""


@dataclass(frozen=True, slots=True)
class OwnBehaviour:
    """A user's own behaviour.

    Args:
        function: ``async def f(robot)``, or ``def f(robot)``, which is called at each estimate and returns
            ``v, omega``.
        is_async: whether it is the first kind.
    """

    function: Callable[[Any], Any]
    is_async: bool


def names() -> tuple[str, ...]:
    """The built-in behaviours, by name."""
    return tuple(sorted({module.name for module in pkgutil.iter_modules(behaviours.__path__)} - _NOT_BEHAVIOURS))


def find(name: str) -> BehaviourKind | OwnBehaviour:
    """Find a behaviour by its name.

    Args:
        name: of a built-in behaviour, or ``module:function`` for a user's function of one argument.

    Raises:
        BehaviourError: no such behaviour, module or function, or not a function of one argument.
    """
    if ":" in name:
        return _own(name)
    if name not in names():
        raise BehaviourError(f"got {name!r}, expected one of {', '.join(names())}, or your own as module:function")
    return built_in(name)


def built_in(name: str) -> BehaviourKind:
    """The row of a built-in behaviour.

    Args:
        name: of the behaviour, one of :func:`names`.
    """
    kind: BehaviourKind = importlib.import_module(f"{behaviours.__name__}.{name}").BEHAVIOUR
    return kind


def _own(name: str) -> OwnBehaviour:
    function = load_function(name)
    wrong = BehaviourError(f"got {function!r}, expected `def f(robot)` or `async def f(robot)`")
    if not inspect.isfunction(function) or len(inspect.signature(function).parameters) != 1:
        raise wrong
    if inspect.isasyncgenfunction(function) or inspect.isgeneratorfunction(function):
        raise wrong
    return OwnBehaviour(function, inspect.iscoroutinefunction(function))
