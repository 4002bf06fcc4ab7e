"""From a TOML file to a checked :class:`~muro_zenoh.config.sections.Scenario`."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

import msgspec

from muro_zenoh.behaviours.table import DEFAULT
from muro_zenoh.config.descriptions import show
from muro_zenoh.config.feasibility import check_feasible
from muro_zenoh.config.origin import Origin
from muro_zenoh.config.reading import check_keys, read_section, read_value
from muro_zenoh.config.sections import (
    ARENA,
    CIRCLE,
    BehaviourSettings,
    BusSettings,
    CameraSettings,
    Checks,
    GoalRow,
    RobotSettings,
    Scenario,
    Simulation,
)
from muro_zenoh.errors import ConfigError
from muro_zenoh.messages import Name, Value
from muro_zenoh.quantities import Period, Quantity

_SECTIONS: Final[dict[str, Any]] = {
    "arena": ARENA,
    "circle": CIRCLE,
    "bus": BusSettings(),
    "checks": Checks(),
    "simulation": Simulation(),
}
"""The sections that are one value each, as they are when nothing is given."""

_TOP = ("fleet", "description", "duration", "robots", "all", "robot", "camera", "behaviour", "goals", *_SECTIONS)

_MERGED = ("all", "arena", "bus", "simulation")
"""Sections in which a scenario changes single keys of its fleet file."""

T = TypeVar("T")


def load_scenario(
    path: Path | str, *, robots: int | None = None, overrides: Mapping[str, object] | None = None, name: str = ""
) -> Scenario:
    """Read a scenario, or a fleet file, and check it.

    Args:
        path: the TOML file; or the JSON one that :func:`as_table` became for the processes of a run.
        robots: how many robots to use: so many of those in the file, or so many made from ``[all]``.
        overrides: values by full key, such as ``{"circle.radius": 1.0}``, laid over the file's.
        name: what to call it; by default the file's name without its ending.

    Raises:
        ConfigError: no such file, not TOML (JSON), a wrong key, type or range, or an impossible scenario.
    """
    path = Path(path)
    table, origin = _read_with_fleet(path)
    for key, value in (overrides or {}).items():
        _override(table, key, value)
        origin.note(key, "--set ")
    return parse_scenario(table, origin, name=name or path.stem, robots=robots)


def parse_scenario(table: Mapping[str, Any], file: str | Origin, *, name: str, robots: int | None = None) -> Scenario:
    """A scenario from a parsed TOML table; see :func:`load_scenario`.

    Args:
        table: the parsed file.
        file: its name, for errors; or which key came from which file.
        name: what to call the scenario.
        robots: how many robots to use.

    Raises:
        ConfigError: as for :func:`load_scenario`.
    """
    origin = file if isinstance(file, Origin) else Origin(file)
    check_keys(table, _TOP, origin, "")
    sections: dict[str, Any] = {
        key: read_section(type(default), _table(table, key, origin), origin, key, default)
        for key, default in _SECTIONS.items()
    }
    cameras = {
        _name(key, origin, f"camera.{key}"): read_section(
            CameraSettings, _as_table(value, origin, f"camera.{key}"), origin, f"camera.{key}"
        )
        for key, value in _table(table, "camera", origin).items()
    }
    scenario = Scenario(
        name=name,
        description=read_value(str, table.get("description", ""), origin, "description"),
        duration=read_value(Period, table.get("duration", 60.0), origin, "duration"),
        robot=_robots(table, origin, robots),
        camera=cameras,
        behaviour=_behaviour(_table(table, "behaviour", origin), origin),
        goals={
            _name(key, origin, f"goals.{key}"): read_value(tuple[GoalRow, ...], rows, origin, f"goals.{key}")
            for key, rows in _table(table, "goals", origin).items()
        },
        **sections,
    )
    check_feasible(scenario, origin)
    return scenario


def as_table(scenario: Scenario) -> dict[str, Any]:
    """The scenario as a table that :func:`parse_scenario` takes; how it is handed to the processes of a run."""
    table: dict[str, Any] = msgspec.to_builtins(scenario)
    table.pop("name")
    behaviour = table.pop("behaviour")
    table["behaviour"] = {"name": behaviour["name"], **behaviour["parameters"]}
    return _without_none(table)  # type: ignore[no-any-return]  # a dict in, a dict out


def parameters_as(kind: type[T], parameters: Mapping[str, object], where: str) -> T:
    """A behaviour's parameters as a checked value.

    Args:
        kind: their type, a frozen dataclass.
        parameters: what the scenario or the operator gave.
        where: the file or order they came from, for errors.

    Raises:
        ConfigError: a wrong key, type or range.
    """
    return read_section(kind, parameters, Origin(where), "behaviour")


# ---- reading


def read_table(path: Path) -> dict[str, Any]:
    """A TOML file, or a JSON one by its ending, as a table.

    Args:
        path: the file.

    Raises:
        ConfigError: no such file, not readable, not what its ending says, or no table.
    """
    kind = "JSON" if path.suffix == ".json" else "TOML"
    try:
        text = path.read_bytes().decode()
        table = json.loads(text) if kind == "JSON" else tomllib.loads(text)
    except FileNotFoundError:
        raise ConfigError(str(path), got="no such file", expected=f"a {kind} file") from None
    except OSError as error:
        raise ConfigError(str(path), got=error.strerror or str(error), expected=f"a readable {kind} file") from error
    except (tomllib.TOMLDecodeError, json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(str(path), got=str(error), expected=kind) from error
    if not isinstance(table, dict):
        raise ConfigError(str(path), got=show(table), expected="a table of settings")
    return table


def _read_with_fleet(path: Path) -> tuple[dict[str, Any], Origin]:
    table = read_table(path)
    origin = Origin(path.name)
    if "fleet" not in table:
        return table, origin
    fleet_path = path.parent / read_value(str, table.pop("fleet"), origin, "fleet")
    fleet = read_table(fleet_path)
    fleet_origin = Origin(fleet_path.name)
    if "fleet" in fleet:
        raise ConfigError(fleet_origin.at("fleet"), got=show(fleet["fleet"]), expected="no fleet in a fleet file")
    merged = {**fleet, **table}
    for key in fleet:
        if key not in table:
            origin.note(key, f"{fleet_path.name}: ")
        elif key in _MERGED:
            ours, theirs = _as_table(table[key], origin, key), _as_table(fleet[key], fleet_origin, key)
            merged[key] = {**theirs, **ours}
            for inner in theirs.keys() - ours.keys():
                origin.note(f"{key}.{inner}", f"{fleet_path.name}: ")
    return merged, origin


def _override(table: dict[str, Any], key: str, value: object) -> None:
    *way, last = key.split(".")
    for i, step in enumerate(way):
        child = table.setdefault(step, {})
        if not isinstance(child, dict):
            raise ConfigError(f"--set {key}", got=f"{'.'.join(way[: i + 1])} = {child!r}", expected="a table there")
        table = child
    table[last] = value


def _table(table: Mapping[str, Any], key: str, origin: Origin) -> Mapping[str, Any]:
    return _as_table(table.get(key, {}), origin, key)


def _as_table(value: object, origin: Origin, key: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise ConfigError(origin.at(key), got=show(value), expected=f"a table [{key}]")
    return value


def _name(name: str, origin: Origin, path: str) -> str:
    read_value(Name, name, origin, path)
    return name


def _robots(table: Mapping[str, Any], origin: Origin, wanted: int | None) -> dict[str, RobotSettings]:
    common = dict(_table(table, "all", origin))
    if "tag" in common:
        raise ConfigError(origin.at("all.tag"), got=show(common["tag"]), expected="no tag here: each robot has its own")
    read_section(RobotSettings, common, origin, "all")  # so that an error there is named there
    given = _table(table, "robot", origin)
    if given and "robots" in table:
        raise ConfigError(origin.at("robots"), got="a number besides [robot.*]", expected="either the one or the other")
    if wanted is None and "robots" in table:
        wanted = read_value(Annotated[int, Quantity(at_least=1, whole=True)], table["robots"], origin, "robots")
    if given:
        robots = {
            _name(key, origin, f"robot.{key}"): read_section(
                RobotSettings, {**common, **_as_table(value, origin, f"robot.{key}")}, origin, f"robot.{key}"
            )
            for key, value in given.items()
        }
        if wanted is not None and wanted > len(robots):
            raise ConfigError(
                "--robots", got=str(wanted), expected=f"at most {len(robots)}, the robots in {origin.file}"
            )
        return dict(list(robots.items())[:wanted])
    if wanted is not None and wanted < 1:
        raise ConfigError("--robots", got=str(wanted), expected="1 or more")
    return {f"r{i + 1}": read_section(RobotSettings, {**common, "tag": i}, origin, "all") for i in range(wanted or 1)}


def _behaviour(table: Mapping[str, Any], origin: Origin) -> BehaviourSettings:
    name = read_value(str, table.get("name", DEFAULT), origin, "behaviour.name")
    rest = {k: read_value(Value, v, origin, f"behaviour.{k}") for k, v in table.items() if k != "name"}
    return BehaviourSettings(name=name, parameters=rest)


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    return value
