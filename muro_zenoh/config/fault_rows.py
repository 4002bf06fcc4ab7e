"""Reads the ``[[fault]]`` tables of a scenario."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from muro_zenoh.config.descriptions import show
from muro_zenoh.config.faults import KINDS, Fault, Place
from muro_zenoh.config.origin import Origin
from muro_zenoh.config.reading import check_choice, read_section, read_table
from muro_zenoh.config.sections import Scenario
from muro_zenoh.errors import ConfigError
from muro_zenoh.messages import Break


def read_faults(
    rows: object, duration: float, origin: Origin, robots: Collection[str], cameras: Collection[str]
) -> tuple[Fault, ...]:
    """The faults of a file.

    Args:
        rows: the ``[[fault]]`` tables.
        duration: of the run [s]; a fault that begins later would never befall anything.
        origin: their origin, for errors.
        robots: the names of the robots.
        cameras: the names of the cameras.

    Raises:
        ConfigError: not tables, an unknown kind, a wrong key, type or range, a target that there is not, or a time at
            which the run is over.
    """
    if not isinstance(rows, Sequence) or isinstance(rows, str):
        raise ConfigError(origin.at("fault"), got=show(rows), expected="tables [[fault]]")
    faults = tuple(_read(row, origin, f"fault[{number}]", robots, cameras) for number, row in enumerate(rows))
    for number, fault in enumerate(faults):
        if fault.at >= duration:
            raise ConfigError(
                origin.at(f"fault[{number}].at"),
                got=f"{fault.at:g} s",
                expected=f"a time before the end of the run, which lasts {duration:g} s",
                hint="Let it begin earlier, or the run last longer.",
            )
    return faults


def _read(row: object, origin: Origin, path: str, robots: Collection[str], cameras: Collection[str]) -> Fault:
    table: dict[str, Any] = dict(read_table(row, origin, path))
    kind = check_choice(table.pop("kind", None), tuple(KINDS), origin, f"{path}.kind")
    fault = read_section(KINDS[kind], table, origin, path)
    check_choice(fault.target, targets(fault.places, robots, cameras), origin, f"{path}.target")
    return fault


def targets(places: Collection[Place], robots: Collection[str], cameras: Collection[str]) -> tuple[str, ...]:
    """The targets that a fault can have.

    Args:
        places: what it can befall.
        robots: the names of the robots.
        cameras: the names of the cameras.
    """
    names = {
        Place.ROBOT: tuple(robots),
        Place.AGENT: tuple(f"{name}/agent" for name in robots),
        Place.BASE: tuple(f"{name}/base" for name in robots),
        Place.CAMERA: tuple(f"camera/{name}" for name in cameras),
    }
    return tuple(target for place in places for target in names.get(place, (str(place),)))


def fault_of(order: Break, scenario: Scenario, at: float = 0.0) -> Fault:
    """The fault that is ordered.

    Args:
        order: the order.
        scenario: its robots and cameras.
        at: when it begins, from the start of the run [s].

    Raises:
        ConfigError: an unknown kind, a wrong number, or a target that there is not.
    """
    row = {**order.numbers, "kind": order.fault, "target": order.target, "at": at}
    if order.duration is not None:
        row["duration"] = order.duration
    return _read(row, Origin(""), "fault", scenario.robots, tuple(scenario.camera))
