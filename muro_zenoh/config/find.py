"""Scenarios by name: the built-in ones, or a file."""

from __future__ import annotations

import difflib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import muro_zenoh
from muro_zenoh.behaviours.entry_points import BEHAVIOURS
from muro_zenoh.config.scenario import load_scenario
from muro_zenoh.config.sections import Scenario
from muro_zenoh.errors import ConfigError


def built_in_scenarios() -> dict[str, Path]:
    """The files of the built-in scenarios, by name."""
    folder = Path(muro_zenoh.__file__).parent / "scenarios"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def find_scenario(
    given: str,
    robots: int | None = None,
    overrides: Mapping[str, object] | None = None,
    others: Sequence[str] = (),
) -> Scenario:
    """A scenario by a built-in name or a file.

    Args:
        given: the name or file.
        robots: number of robots; None for the scenario's own number.
        overrides: values by full key, which override the scenario's.
        others: what else may be given to the caller, for the error.

    Raises:
        ConfigError: neither a built-in name nor a file, or a file with a wrong setting.
    """
    built_in = built_in_scenarios()
    if given in built_in:
        return load_scenario(built_in[given], robots=robots, overrides=overrides, name=given)
    path = Path(given)
    if path.suffix == ".py":
        raise ConfigError(
            "SCENARIO",
            got=f"{given!r}, a Python file",
            expected="a TOML file",
            hint=f'Name a function of it there: [behaviour] name = "{path.stem}:<function>"',
        )
    if not path.is_file():
        close = difflib.get_close_matches(given, [*built_in, *others], n=2, cutoff=0.5)
        raise ConfigError(
            "SCENARIO",
            got=f"{given!r}, which is not a file",
            expected=f"a TOML file, or one of {', '.join([*built_in, *others])}",
            hint=f"Did you mean {' or '.join(close)}?" if close else "",
        )
    # A user's own behaviours may be in modules beside the file.
    os.environ.setdefault(BEHAVIOURS, str(path.resolve().parent))
    return load_scenario(path, robots=robots, overrides=overrides)
