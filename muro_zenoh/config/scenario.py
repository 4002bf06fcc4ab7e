"""From a settings file to a checked :class:`~muro_zenoh.config.sections.Scenario`, and back to a table."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

from muro_zenoh.behaviours.table import DEFAULT
from muro_zenoh.config.checks import Checks
from muro_zenoh.config.descriptions import show
from muro_zenoh.config.fault_rows import read_faults
from muro_zenoh.config.feasibility import check_feasible
from muro_zenoh.config.files import read_file
from muro_zenoh.config.order import OrderRow
from muro_zenoh.config.origin import Origin
from muro_zenoh.config.overrides import apply_overrides, numbered_robots
from muro_zenoh.config.reading import check_keys, read_rows, read_section, read_table, read_value
from muro_zenoh.config.sections import (
    ARENA,
    CIRCLE,
    BehaviourSettings,
    BusSettings,
    CalibrationSettings,
    CameraSettings,
    ClockSettings,
    GoalRow,
    RobotSettings,
    Scenario,
    Simulation,
    StartRow,
)
from muro_zenoh.config.timeouts import TIMEOUTS
from muro_zenoh.config.wall import WallRow
from muro_zenoh.errors import ConfigError
from muro_zenoh.messages import Name, Value
from muro_zenoh.quantities import Period
from muro_zenoh.safety.separation import SeparationSettings

T = TypeVar("T")

PROCESSES: Final = ("muro", "router", "simulator", "basestation")
"""The names of the processes of a run that are not agents. An agent's is its robot's, so no robot has one of these."""

_SECTIONS: Final[dict[str, Any]] = {
    "arena": ARENA,
    "circle": CIRCLE,
    "bus": BusSettings(),
    "clocks": ClockSettings(),
    "checks": Checks(),
    "simulation": Simulation(),
    "timeouts": TIMEOUTS,
    "separation": SeparationSettings(),
}
"""The sections that are one value each, with their defaults."""

_TOP = (
    "fleet",
    "description",
    "duration",
    "robots",
    "all",
    "robot",
    "wall",
    "camera",
    "behaviour",
    "goals",
    "starts",
    "order",
    "fault",
    *_SECTIONS,
)


def load_scenario(
    path: Path | str, *, robots: int | None = None, overrides: Mapping[str, object] | None = None, name: str = ""
) -> Scenario:
    """Read a scenario, or a fleet file, and check it.

    Args:
        path: the TOML file, or the JSON file that was written for the processes of a run: the scenario's ``name``, and
            what :func:`as_table` gives.
        robots: number of robots: the first ones of the file, or as many made from ``[all]``.
        overrides: values by full key, such as ``{"circle.radius": 1.0}``, which override the file's.
        name: the scenario's name; by default that in a run's JSON file, or the file's name without its ending.

    Raises:
        ConfigError: no such file, not TOML (JSON), a wrong key, type or range, or an impossible scenario.
    """
    path = Path(path)
    given = dict(overrides or {})
    table, origin = read_file(path, given.pop("fleet", None))
    apply_overrides(table, origin, given, robots)
    if path.suffix == ".json" and "name" in table:
        known = read_value(str, table.pop("name"), origin, "name")
    else:
        known = path.stem
    return parse_scenario(table, origin, name=name or known, robots=robots)


def parse_scenario(table: Mapping[str, Any], file: str | Origin, *, name: str, robots: int | None = None) -> Scenario:
    """A scenario from a parsed TOML table; see :func:`load_scenario`.

    Args:
        table: the parsed file.
        file: its name, or the origin of each key, for errors.
        name: the scenario's name.
        robots: number of robots.

    Raises:
        ConfigError: as for :func:`load_scenario`.
    """
    origin = file if isinstance(file, Origin) else Origin(file)
    check_keys(table, _TOP, origin, "")
    sections: dict[str, Any] = {
        key: read_section(type(default), table.get(key, {}), origin, key, default) for key, default in _SECTIONS.items()
    }
    cameras = {
        _name(key, origin, f"camera.{key}"): _camera(value, origin, f"camera.{key}")
        for key, value in _table(table, "camera", origin).items()
    }
    robot = _robots(table, origin, robots)
    duration = read_value(Period, table.get("duration", 60.0), origin, "duration")
    scenario = Scenario(
        name=name,
        description=read_value(str, table.get("description", ""), origin, "description"),
        duration=duration,
        robot=robot,
        wall=_rows(WallRow, table, "wall", origin),
        camera=cameras,
        behaviour=_behaviour(_table(table, "behaviour", origin), origin),
        goals={
            _name(key, origin, f"goals.{key}"): read_value(tuple[GoalRow, ...], rows, origin, f"goals.{key}")
            for key, rows in _table(table, "goals", origin).items()
        },
        starts={
            _name(key, origin, f"starts.{key}"): read_value(StartRow, row, origin, f"starts.{key}")
            for key, row in _table(table, "starts", origin).items()
        },
        orders=_rows(OrderRow, table, "order", origin),
        faults=read_faults(table.get("fault", []), duration, origin, robot, cameras),
        **sections,
    )
    check_feasible(scenario, origin)
    return scenario


def as_table(scenario: Scenario) -> dict[str, Any]:
    """The scenario as a table for :func:`parse_scenario`, to pass it to the processes of a run."""
    table: dict[str, Any] = msgspec.to_builtins(scenario)
    table.pop("name")
    behaviour = table.pop("behaviour")
    table["behaviour"] = {"name": behaviour["name"], **behaviour["parameters"]}
    return _without_none(table)  # type: ignore[no-any-return]  # a dict in, a dict out


def _table(table: Mapping[str, Any], key: str, origin: Origin) -> Mapping[str, Any]:
    return read_table(table.get(key, {}), origin, key)


def _rows(kind: type[T], table: Mapping[str, Any], key: str, origin: Origin) -> tuple[T, ...]:
    """The rows of ``[[key]]``."""
    rows = read_rows(table.get(key, ()), origin, key)
    return tuple(read_section(kind, row, origin, f"{key}[{index}]") for index, row in enumerate(rows))


def _name(name: str, origin: Origin, path: str) -> str:
    read_value(Name, name, origin, path)
    return name


def _camera(value: object, origin: Origin, path: str) -> CameraSettings:
    table = read_table(value, origin, path)
    if "calibration" in table:  # so that an error in it is reported with its key
        read_section(CalibrationSettings, table["calibration"], origin, f"{path}.calibration")
    return read_section(CameraSettings, table, origin, path)


def _robot_name(name: str, origin: Origin) -> str:
    if name in PROCESSES:
        raise ConfigError(
            origin.at(f"robot.{name}"),
            got="the name of one of our own processes",
            expected=f"another name than {', '.join(PROCESSES)}",
        )
    return _name(name, origin, f"robot.{name}")


def _robots(table: Mapping[str, Any], origin: Origin, wanted: int | None) -> dict[str, RobotSettings]:
    common = dict(_table(table, "all", origin))
    if "tag" in common:
        raise ConfigError(
            origin.at("all.tag"), got=show(common["tag"]), expected="no tag in [all], because each robot has its own"
        )
    read_section(RobotSettings, common, origin, "all")  # so that an error in [all] is reported there
    given = _table(table, "robot", origin)
    if given and "robots" in table:
        raise ConfigError(origin.at("robots"), got="a number besides [robot.*]", expected="only one of the two")
    if given and wanted is not None and wanted > len(given):
        raise ConfigError("--robots", got=str(wanted), expected=f"at most {len(given)}, the robots in {origin.file}")
    robots = {
        _robot_name(key, origin): read_section(
            RobotSettings, {**common, **read_table(value, origin, f"robot.{key}")}, origin, f"robot.{key}"
        )
        for key, value in (given or numbered_robots(table, origin, wanted)).items()
    }
    return dict(list(robots.items())[:wanted])


def _behaviour(table: Mapping[str, Any], origin: Origin) -> BehaviourSettings:
    name = read_value(str, table.get("name", DEFAULT), origin, "behaviour.name")
    rest = {k: read_value(Value, v, origin, f"behaviour.{k}") for k, v in table.items() if k != "name"}
    return BehaviourSettings(name=name, parameters=rest)


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    if isinstance(value, list | tuple):
        return [_without_none(item) for item in value]
    return value
