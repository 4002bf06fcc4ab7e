"""From a TOML file to a checked :class:`~muro_zenoh.config.sections.Scenario`."""

from __future__ import annotations

import difflib
import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar, get_type_hints

import msgspec
from msgspec import Meta

from muro_zenoh.config.possible import check_possible
from muro_zenoh.config.sections import (
    Arena,
    BehaviourSettings,
    BusSettings,
    Camera,
    Checks,
    CircleSettings,
    GoalRow,
    Positive,
    Robot,
    Scenario,
    Section,
    Simulation,
)
from muro_zenoh.config.words import expected, show, unit_of
from muro_zenoh.errors import ConfigError
from muro_zenoh.messages import Name, Value

_SECTIONS: Final[dict[str, type[Section]]] = {
    "arena": Arena,
    "circle": CircleSettings,
    "bus": BusSettings,
    "checks": Checks,
    "simulation": Simulation,
}
_TOP = ("fleet", "description", "duration", "robots", "all", "robot", "camera", "behaviour", "goals", *_SECTIONS)

S = TypeVar("S", bound=Section)


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
    table = _read_with_fleet(path)
    for key, value in (overrides or {}).items():
        _override(table, key, value)
    return parse_scenario(table, path.name, name=name or path.stem, robots=robots)


def parse_scenario(table: Mapping[str, Any], file: str, *, name: str, robots: int | None = None) -> Scenario:
    """A scenario from a parsed TOML table; see :func:`load_scenario`.

    Args:
        table: the parsed file.
        file: its name, for errors.
        name: what to call the scenario.
        robots: how many robots to use.

    Raises:
        ConfigError: as for :func:`load_scenario`.
    """
    _check_keys(table, _TOP, file, "")
    sections: dict[str, Any] = {
        key: _section(kind, _table(table, key, file), file, key) for key, kind in _SECTIONS.items()
    }
    cameras = {
        _name(key, file, f"camera.{key}"): _section(
            Camera, _as_table(value, file, f"camera.{key}"), file, f"camera.{key}"
        )
        for key, value in _table(table, "camera", file).items()
    }
    scenario = Scenario(
        name=name,
        description=_value(str, table.get("description", ""), file, "description"),
        duration=_value(Positive, table.get("duration", 60.0), file, "duration"),
        robot=_robots(table, file, robots),
        camera=cameras,
        behaviour=_behaviour(_table(table, "behaviour", file), file),
        goals={
            _name(key, file, f"goals.{key}"): _value(tuple[GoalRow, ...], rows, file, f"goals.{key}")
            for key, rows in _table(table, "goals", file).items()
        },
        **sections,
    )
    check_possible(scenario, file)
    return scenario


def as_table(scenario: Scenario) -> dict[str, Any]:
    """The scenario as a table that :func:`parse_scenario` takes; how it is handed to the processes of a run."""
    table: dict[str, Any] = msgspec.to_builtins(scenario)
    table.pop("name")
    behaviour = table.pop("behaviour")
    table["behaviour"] = {"name": behaviour["name"], **behaviour["parameters"]}
    return _without_none(table)  # type: ignore[no-any-return]  # a dict in, a dict out


def parameters_as(kind: type[S], parameters: Mapping[str, object], where: str) -> S:
    """A behaviour's parameters as a checked value.

    Args:
        kind: the behaviour's own section type.
        parameters: what the scenario or the operator gave.
        where: the file or order they came from, for errors.

    Raises:
        ConfigError: a wrong key, type or range.
    """
    return _section(kind, parameters, where, "behaviour")


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


def _read_with_fleet(path: Path) -> dict[str, Any]:
    table = read_table(path)
    if "fleet" not in table:
        return table
    fleet_path = path.parent / _value(str, table["fleet"], path.name, "fleet")
    fleet = read_table(fleet_path)
    merged = {**fleet, **{key: value for key, value in table.items() if key != "fleet"}}
    for key in ("all", "arena", "bus", "simulation"):
        if key in fleet and key in table:
            merged[key] = {**_as_table(fleet[key], fleet_path.name, key), **_as_table(table[key], path.name, key)}
    return merged


def _override(table: dict[str, Any], key: str, value: object) -> None:
    *way, last = key.split(".")
    for i, step in enumerate(way):
        child = table.setdefault(step, {})
        if not isinstance(child, dict):
            raise ConfigError(f"--set {key}", got=f"{'.'.join(way[: i + 1])} = {child!r}", expected="a table there")
        table = child
    table[last] = value


def _table(table: Mapping[str, Any], key: str, file: str) -> Mapping[str, Any]:
    return _as_table(table.get(key, {}), file, key)


def _as_table(value: object, file: str, key: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise ConfigError(f"{file}: {key}", got=show(value), expected=f"a table [{key}]")
    return value


def _section(kind: type[S], table: Mapping[str, Any], file: str, path: str) -> S:
    hints = get_type_hints(kind, include_extras=True)
    _check_keys(table, tuple(hints), file, path)
    values = {key: _value(hints[key], value, file, f"{path}.{key}", unit_of(kind, key)) for key, value in table.items()}
    return kind(**values)


def _check_keys(table: Mapping[str, Any], known: tuple[str, ...], file: str, path: str) -> None:
    for key in table:
        if key not in known:
            close = difflib.get_close_matches(key, known, n=1)
            raise ConfigError(
                f"{file}: {path}.{key}" if path else f"{file}: {key}",
                got="a key that nothing reads",
                expected=f"one of {', '.join(known)}",
                hint=f"Did you mean {close[0]}?" if close else "",
            )


def _value(kind: Any, value: object, file: str, path: str, unit: str = "") -> Any:
    try:
        converted = msgspec.convert(value, kind)
    except msgspec.ValidationError:
        raise ConfigError(f"{file}: {path}", got=show(value), expected=expected(kind, unit)) from None
    if isinstance(converted, float) and not math.isfinite(converted):
        raise ConfigError(f"{file}: {path}", got=str(converted), expected="a finite number")
    return converted


def _name(name: str, file: str, path: str) -> str:
    _value(Name, name, file, path)
    return name


def _robots(table: Mapping[str, Any], file: str, wanted: int | None) -> dict[str, Robot]:
    common = dict(_table(table, "all", file))
    if "tag" in common:
        raise ConfigError(f"{file}: all.tag", got=show(common["tag"]), expected="no tag here: each robot has its own")
    _section(Robot, common, file, "all")  # so that an error there is named there
    given = _table(table, "robot", file)
    if given and "robots" in table:
        raise ConfigError(f"{file}: robots", got="a number besides [robot.*]", expected="either the one or the other")
    if wanted is None and "robots" in table:
        wanted = _value(Annotated[int, Meta(ge=1)], table["robots"], file, "robots")
    if given:
        robots = {
            _name(key, file, f"robot.{key}"): _section(
                Robot, {**common, **_as_table(value, file, f"robot.{key}")}, file, f"robot.{key}"
            )
            for key, value in given.items()
        }
        if wanted is not None and wanted > len(robots):
            raise ConfigError("--robots", got=str(wanted), expected=f"at most {len(robots)}, the robots in {file}")
        return dict(list(robots.items())[:wanted])
    if wanted is not None and wanted < 1:
        raise ConfigError("--robots", got=str(wanted), expected="1 or more")
    return {f"r{i + 1}": _section(Robot, {**common, "tag": i}, file, "all") for i in range(wanted or 1)}


def _behaviour(table: Mapping[str, Any], file: str) -> BehaviourSettings:
    name = _value(str, table.get("name", "hold"), file, "behaviour.name")
    rest = {k: _value(Value, v, file, f"behaviour.{k}") for k, v in table.items() if k != "name"}
    return BehaviourSettings(name=name, parameters=rest)


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    return value
