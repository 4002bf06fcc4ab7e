"""Values from the command line, which override those of a file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from muro_zenoh.config.origin import Origin
from muro_zenoh.config.reading import read_value
from muro_zenoh.errors import ConfigError
from muro_zenoh.quantities import Quantity

_ROBOT = "robot."
_Count = Annotated[int, Quantity(at_least=1, whole=True)]


def apply_overrides(
    table: dict[str, Any], origin: Origin, overrides: Mapping[str, object], robots: int | None = None
) -> None:
    """Override values of a file.

    Another behaviour than the file's begins without the file's parameters, which belong to that one.

    Args:
        table: the file; changed in place.
        origin: of its keys; changed in place.
        overrides: values by full key, such as ``circle.radius``.
        robots: number of robots, if it is not the file's.

    Raises:
        ConfigError: a part of a key is not a table, or a robot that the file does not have.
    """
    behaviour = table.get("behaviour")
    if isinstance(behaviour, dict) and overrides.get("behaviour.name") not in (None, behaviour.get("name")):
        table["behaviour"] = {}
    of_robots = {key: value for key, value in overrides.items() if key.startswith(_ROBOT)}
    for key, value in overrides.items():
        if key not in of_robots:
            _override(table, origin, key, value)
    if not of_robots:
        return
    if "robot" not in table:
        table["robot"] = numbered_robots(table, origin, robots)
        table.pop("robots", None)
    for key, value in of_robots.items():
        if isinstance(table["robot"], dict):
            _check_robot(key, list(table["robot"])[:robots])
        _override(table, origin, key, value)


def numbered_robots(table: Mapping[str, Any], origin: Origin, wanted: int | None) -> dict[str, dict[str, Any]]:
    """The robots of a file that names none: ``r1``, ``r2`` ..., with the tags 0, 1 ...

    Args:
        table: the file.
        origin: of its keys, for errors.
        wanted: how many; None for the file's number, which is 1 by default.

    Raises:
        ConfigError: fewer than one.
    """
    if wanted is None:
        wanted = read_value(_Count, table.get("robots", 1), origin, "robots")
    if wanted < 1:
        raise ConfigError("--robots", got=str(wanted), expected="1 or more")
    return {f"r{i + 1}": {"tag": i} for i in range(wanted)}


def _check_robot(key: str, names: list[str]) -> None:
    name = key.removeprefix(_ROBOT).partition(".")[0]
    if name not in names:
        raise ConfigError(f"--set {key}", got=f"robot {name}", expected=f"one of {', '.join(names)}")


def _override(table: dict[str, Any], origin: Origin, key: str, value: object) -> None:
    *steps, last = key.split(".")
    for i, step in enumerate(steps):
        child = table.setdefault(step, {})
        if not isinstance(child, dict):
            raise ConfigError(f"--set {key}", got=f"{'.'.join(steps[: i + 1])} = {child!r}", expected="a table there")
        table = child
    table[last] = value
    origin.note(key, "--set ")
