"""What is checked: random trials, a scenario, or a student's own file, as a function from a seed to a trial."""

from __future__ import annotations

import ast
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from muro_zenoh.behaviours.entry_points import BEHAVIOURS
from muro_zenoh.checking.random_trial import DURATION, faulty, random_trial
from muro_zenoh.config import Scenario, check_behaviour, find_scenario, parse_scenario
from muro_zenoh.errors import ConfigError

RANDOM: Final = "random"
"""The built-in check."""

FAULTS: Final = 2
"""Random faults in each trial of a scenario without faults, orders and starts of its own."""

QUICK_ROBOTS: Final = 3
QUICK_DURATION: Final = 10.0
"""Robots, and virtual seconds, of a trial of a quick check: so that a hundred take 20 s on two cores."""

_OWN_ROBOTS: Final = 5


@dataclass(frozen=True, slots=True)
class Trials:
    """From a seed to a trial.

    Args:
        scenario: what all trials have in common; None for random ones.
        faults: number of random faults in each.
    """

    scenario: Scenario | None
    faults: int

    def __call__(self, seed: int) -> Scenario:
        """The trial of a seed.

        Args:
            seed: the seed.
        """
        if self.scenario is None:
            return random_trial(seed)
        return faulty(self.scenario, self.faults, seed) if self.faults else self.scenario


def trials_of(
    given: str, *, robots: int | None, duration: float | None, quick: bool, overrides: Mapping[str, object]
) -> Trials:
    """The trials of what a user names.

    Args:
        given: ``random``, a built-in scenario, a TOML file, or ``FILE.py`` or ``FILE.py:function``.
        robots: number of robots; None for the scenario's own number, or fewer in a quick check.
        duration: of a trial [s]; None for the usual one.
        quick: short trials of few robots without faults.
        overrides: values by full key, which override the scenario's.

    Raises:
        ConfigError: none of these, a wrong setting, or one that random trials do not have.
    """
    if given == RANDOM:
        if robots is not None or duration is not None or quick or overrides:
            raise ConfigError(
                "random",
                got="--robots, --duration, --quick or --set",
                expected="none of them: everything in a random trial is drawn from its seed",
            )
        return Trials(None, FAULTS)
    path, colon, function = given.partition(":")
    if path.endswith(".py"):
        scenario = _own(Path(path), function if colon else None, robots or _OWN_ROBOTS, overrides)
    else:
        scenario = find_scenario(given, robots, overrides, others=(RANDOM, "FILE.py[:function]"))
    if not scenario.camera:
        raise ConfigError(f"{given}: camera", got="none", expected="a section [camera.<name>]: nobody drives blindly")
    for name in scenario.robots:
        wanted = scenario.behaviour_of(name)
        check_behaviour(wanted.name, wanted.parameters, given, [scenario.vehicle(name)])
    if quick and robots is None:
        few = scenario.robots[:QUICK_ROBOTS]
        scenario = msgspec.structs.replace(scenario, robot={name: scenario.robot[name] for name in few})
    # One that says itself what happens is taken as it is: a trial that was written down to be repeated.
    is_complete = bool(scenario.faults or scenario.orders or scenario.starts)
    usual = scenario.duration if is_complete else min(QUICK_DURATION if quick else DURATION, scenario.duration)
    scenario = msgspec.structs.replace(scenario, duration=duration or usual)
    return Trials(scenario, 0 if quick or is_complete else FAULTS)


def _own(path: Path, function: str | None, robots: int, overrides: Mapping[str, object]) -> Scenario:
    """The scenario of a student's file: the usual fleet and room, and the function as behaviour."""
    name = function or _function_of(path)
    os.environ.setdefault(BEHAVIOURS, str(path.resolve().parent))
    table: dict[str, object] = {"camera": {"north": {}}, "behaviour": {"name": f"{path.stem}:{name}"}}
    for key, value in overrides.items():
        section, _, inner = key.rpartition(".")
        if not section or "." in section:
            raise ConfigError(f"--set {key}", got="another key", expected="one such as circle.radius")
        part = table.setdefault(section, {})
        assert isinstance(part, dict)
        part[inner] = value
    return parse_scenario({"robots": robots, **table}, str(path), name=path.stem)


def _function_of(path: Path) -> str:
    """The behaviour in a file: its one function of an argument ``robot``, or its one function of one argument."""
    try:
        body = ast.parse(path.read_text(encoding="utf-8"), str(path)).body
    except OSError as error:
        raise ConfigError(str(path), got=error.strerror or str(error), expected="a Python file") from None
    except UnicodeDecodeError as error:
        raise ConfigError(str(path), got=str(error), expected="a Python file in UTF-8") from None
    except SyntaxError as error:
        raise ConfigError(f"{path}:{error.lineno}", got=f"{error.msg}", expected="Python") from None
    functions = [
        (node.name, node.args.args[0].arg)
        for node in body
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and len(node.args.posonlyargs) + len(node.args.args) + len(node.args.kwonlyargs) == 1
        and node.args.args
        and not node.name.startswith("_")
    ]
    named = [name for name, argument in functions if argument == "robot"] or [name for name, _ in functions]
    if len(named) == 1:
        return named[0]
    raise ConfigError(
        str(path),
        got=f"{len(named)} functions that may be a behaviour" + (f" ({', '.join(named)})" if named else ""),
        expected="one `def f(robot)` or `async def f(robot)`",
        hint=f"Name it: {path}:{named[0]}" if named else "",
    )
