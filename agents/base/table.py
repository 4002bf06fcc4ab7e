"""The table of wheels: each file of this folder that is not named here drives one kind, and is called as its file is.

Such a file has one function, ``make_wheels(robot, clock)``. A robot's ``base`` setting names the file.
"""

from __future__ import annotations

import importlib
import pkgutil
from typing import Final

from agents import base
from agents.base.wheels import MakeWheels
from muro_zenoh.config import Scenario
from muro_zenoh.errors import ConfigError

_NOT_WHEELS: Final = frozenset({"base", "run", "table", "wheels"})


def names() -> tuple[str, ...]:
    """The kinds of wheels, by name."""
    return tuple(
        sorted(module.name for module in pkgutil.iter_modules(base.__path__) if module.name not in _NOT_WHEELS)
    )


def check_base(scenario: Scenario, name: str, file: str) -> None:
    """Refuse a robot whose wheels nothing here can drive; no driver is loaded.

    Args:
        scenario: the settings.
        name: the robot's name.
        file: where the settings came from, for errors.

    Raises:
        ConfigError: its ``base`` is no file of this folder.
    """
    wanted = scenario.robot[name].base
    if wanted not in names():
        raise ConfigError(
            f"{file}: robot.{name}.base",
            got=repr(wanted),
            expected=f"one of {', '.join(names())}: each is a file in agents/base",
        )


def find(name: str) -> MakeWheels:
    """What makes the wheels of a kind. The driver is loaded now, with all that it needs.

    Args:
        name: the kind, one of :func:`names`.
    """
    make: MakeWheels = importlib.import_module(f"{base.__name__}.{name}").make_wheels
    return make
