"""Settings files as plain tables, with the origin of each key: a file, its fleet file, or the command line."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any, Final

from muro_zenoh.config.descriptions import show
from muro_zenoh.config.origin import Origin
from muro_zenoh.config.reading import read_rows, read_table, read_value
from muro_zenoh.errors import ConfigError

_MERGED: Final = ("all", "arena", "bus", "simulation")
"""Sections in which a scenario overrides single keys of its fleet file; it adds rows to the walls there, and all others
it replaces as a whole."""


def read_file(path: Path, fleet: object = None) -> tuple[dict[str, Any], Origin]:
    """A settings file, merged into its fleet file.

    Args:
        path: the TOML file, or a JSON one by its ending.
        fleet: the fleet file from the command line, relative to the current folder; None for the one that the file
            names, relative to itself.

    Raises:
        ConfigError: the file, or its fleet file, does not exist, is not readable, has another format than its ending,
            or is not a table.
    """
    table = parse_file(path)
    origin = Origin(path.name)
    named = table.pop("fleet", None)
    if fleet is not None:
        origin.note("fleet", "--set ")
        fleet_path = Path(read_value(str, fleet, origin, "fleet"))
    elif named is not None:
        fleet_path = path.parent / read_value(str, named, origin, "fleet")
    else:
        _read_calibrations(table, path.parent, origin)
        return table, origin
    lab = parse_file(fleet_path)
    fleet_origin = Origin(fleet_path.name)
    if "fleet" in lab:
        raise ConfigError(fleet_origin.at("fleet"), got=show(lab["fleet"]), expected="no key fleet in a fleet file")
    merged = {**lab, **table}
    for key in lab:
        if key not in table:
            origin.note(key, f"{fleet_path.name}: ")
        elif key in _MERGED:
            ours, theirs = read_table(table[key], origin, key), read_table(lab[key], fleet_origin, key)
            merged[key] = {**theirs, **ours}
            for inner in theirs.keys() - ours.keys():
                origin.note(f"{key}.{inner}", f"{fleet_path.name}: ")
        elif key == "wall":  # they stand in the lab, whatever a scenario adds
            own, rows = read_rows(table[key], origin, key), read_rows(lab[key], fleet_origin, key)
            merged[key] = [*own, *rows]
            for index in range(len(rows)):
                origin.note(f"{key}[{len(own) + index}]", f"{fleet_path.name}: ", f"{key}[{index}]")
    _read_calibrations(merged, (path if "camera" in table else fleet_path).parent, origin)
    return merged, origin


def _read_calibrations(table: dict[str, Any], folder: Path, origin: Origin) -> None:
    """Replace the names of calibration files by what is in them."""
    cameras = table.get("camera")
    for name, camera in cameras.items() if isinstance(cameras, dict) else ():
        given = camera.get("calibration") if isinstance(camera, dict) else None
        if isinstance(given, str):
            if not (folder / given).exists():
                raise ConfigError(
                    f"camera.{name}.calibration",
                    got=f"{given!r}, and there is no such file in {folder}",
                    expected="a file that muro calibrate wrote",
                    hint="Leave this line out until then",
                )
            camera["calibration"] = parse_file(folder / given)
            origin.note(f"camera.{name}.calibration", f"{Path(given).name}: ")


def parse_file(path: Path) -> dict[str, Any]:
    """The table in a file.

    Args:
        path: the TOML file, or a JSON one by its ending.

    Raises:
        ConfigError: the file does not exist, is not readable, or has another format than its ending.
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
