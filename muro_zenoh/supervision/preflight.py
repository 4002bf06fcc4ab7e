"""Checks before any process of a run is started."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import muro_zenoh
from muro_zenoh.behaviours.table import DEFAULT
from muro_zenoh.config import Scenario, check_behaviour
from muro_zenoh.errors import ConfigError


def check_own_packages() -> None:
    """Refuse foreign packages with the generic names of our packages.

    Raises:
        ConfigError: ``agents`` or ``basestation`` belongs to another distribution, or is missing.
    """
    home = Path(muro_zenoh.__file__).resolve().parent.parent
    for name in ("agents", "basestation"):
        spec = importlib.util.find_spec(name)
        places = list(spec.submodule_search_locations or [str(spec.origin)]) if spec is not None else []
        if not places or Path(places[0]).resolve().parent != home:
            raise ConfigError(
                f"package {name}",
                got=f"the one in {places[0]}" if places else "none",
                expected=f"muro-zenoh's own in {home}",
                hint="Another distribution uses this name: install muro-zenoh in a virtual environment of its own.",
            )


def check_can_run(scenario: Scenario, file: str) -> None:
    """Refuse a scenario whose robots could not move.

    Args:
        scenario: the scenario.
        file: its file, for errors.

    Raises:
        ConfigError: no camera, rows of orders, no such wheels or behaviour, or invalid parameters.
    """
    from agents.base.table import check_base  # only after check_own_packages

    behaviour = scenario.behaviour
    if not scenario.camera and behaviour.name != DEFAULT:
        raise ConfigError(
            f"{file}: camera",
            got="none",
            expected="a section [camera.<name>], because no robot drives without poses",
        )
    if scenario.orders:
        raise ConfigError(
            f"{file}: order",
            got=f"{len(scenario.orders)} of them",
            expected="none, because only `muro check` gives orders by itself",
            hint="Give them with `muro set`, `muro stop` and `muro resume`.",
        )
    for name in scenario.robots:
        check_base(scenario, name, file)
        check_behaviour(behaviour.name, scenario.behaviour_of(name).parameters, file, [scenario.vehicle(name)])
