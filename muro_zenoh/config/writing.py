"""A scenario as the text of a TOML file, without what is as by default."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import msgspec

from muro_zenoh.config.faults import KINDS, Fault
from muro_zenoh.config.scenario import as_table
from muro_zenoh.config.sections import CameraSettings, RobotSettings, Scenario


def as_toml(scenario: Scenario) -> str:
    """The text of a file that :func:`~muro_zenoh.config.load_scenario` reads as this scenario.

    Args:
        scenario: the scenario.
    """
    table = as_table(scenario)
    defaults = as_table(Scenario(name=scenario.name, robot={}))
    for section, usual in (("robot", RobotSettings()), ("camera", CameraSettings())):
        default = msgspec.to_builtins(usual)
        table[section] = {
            name: {key: value for key, value in part.items() if value != default[key]}
            for name, part in table[section].items()
        }
    for key in list(table):
        if key not in ("robot", "camera") and table[key] == defaults.get(key):
            del table[key]
    return "\n".join(_lines("", table)).strip() + "\n"


def faults_as_toml(faults: Sequence[Fault]) -> str:
    """Faults as rows ``[[fault]]`` of a scenario's file.

    Args:
        faults: the faults.
    """
    defaults = {field.name: field.default for kind in KINDS.values() for field in msgspec.structs.fields(kind)}
    rows = [
        {key: value for key, value in msgspec.to_builtins(fault).items() if key == "kind" or value != defaults[key]}
        for fault in faults
    ]
    return "\n".join(_lines("", {"fault": rows})).strip() + "\n" if rows else ""


def _lines(path: str, table: Mapping[str, Any]) -> Iterator[str]:
    inner = {key: value for key, value in table.items() if isinstance(value, Mapping) or _is_rows(value)}
    for key, value in table.items():
        if key not in inner:
            yield f"{key} = {_value(value)}"
    for key, value in inner.items():
        full = f"{path}{key}"
        for part, head in ((row, f"[[{full}]]") for row in value) if _is_rows(value) else ((value, f"[{full}]"),):
            lines = list(_lines(f"{full}.", part))
            if not lines or not lines[0].startswith("\n["):
                yield f"\n{head}"
            yield from lines


def _is_rows(value: Any) -> bool:
    return isinstance(value, list | tuple) and bool(value) and isinstance(value[0], Mapping)


def _value(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    return json.dumps(value)  # of a text, a number, true and false TOML is as JSON
