"""The table of wheels: each file of this folder not listed here drives one kind, under the file's name.

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

_NOT_WHEELS: Final = frozenset({"base", "obedience", "run", "table", "wheels"})


def names() -> tuple[str, ...]:
    """The kinds of wheels, by name."""
    return tuple(
        sorted(module.name for module in pkgutil.iter_modules(base.__path__) if module.name not in _NOT_WHEELS)
    )


def check_base(scenario: Scenario, name: str, file: str) -> None:
    """Refuse a robot without a driver for its wheels. No driver is loaded.

    Args:
        scenario: the settings.
        name: the robot's name.
        file: the file of the settings, for errors.

    Raises:
        ConfigError: its ``base`` is not a file of this folder.
    """
    wanted = scenario.robot[name].base
    if wanted not in names():
        raise ConfigError(
            f"{file}: robot.{name}.base",
            got=repr(wanted),
            expected=f"one of {', '.join(names())}: each is a file in agents/base",
        )


def find(name: str) -> MakeWheels:
    """Load the driver of a kind of wheels.

    Args:
        name: the kind, one of :func:`names`.
    """
    make: MakeWheels = importlib.import_module(f"{base.__name__}.{name}").make_wheels
    return make
