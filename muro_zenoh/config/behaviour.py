"""A behaviour's settings: read into its parameters, and refused early when no robot could run it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from muro_zenoh.behaviours import table
from muro_zenoh.behaviours.interface import Behaviour, BehaviourKind, Vehicle
from muro_zenoh.behaviours.table import OwnBehaviour
from muro_zenoh.config.origin import Origin
from muro_zenoh.config.reading import config_error, read_section
from muro_zenoh.errors import BehaviourError, ConfigError, ParameterError
from muro_zenoh.geometry import Circle

_PATH = "behaviour"

T = TypeVar("T")


def parameters_as(kind: type[T], parameters: Mapping[str, Any], where: str | Origin) -> T:
    """A behaviour's parameters as a checked value.

    Args:
        kind: their type, a frozen dataclass or a :class:`~muro_zenoh.config.Section`.
        parameters: values by key.
        where: the file or order that they come from, for errors.

    Raises:
        ConfigError: a wrong key, type or range, or values that do not fit together.
    """
    return read_section(kind, parameters, _origin(where), _PATH)


def read_parameters(kind: BehaviourKind, parameters: Mapping[str, Any], where: str | Origin) -> Any:
    """A behaviour's parameters, checked.

    Args:
        kind: the behaviour.
        parameters: values by key.
        where: the file or order that they come from, for errors.

    Raises:
        ConfigError: a wrong key, type or range, or inconsistent values.
    """
    return parameters_as(kind.parameters, parameters, where)


def make_behaviour(
    kind: BehaviourKind, parameters: Mapping[str, Any], vehicle: Vehicle, where: str | Origin
) -> Behaviour:
    """The behaviour of one robot.

    Args:
        kind: the behaviour's row of the table.
        parameters: values by key.
        vehicle: the robot.
        where: the file or order that they come from, for errors.

    Raises:
        ConfigError: invalid parameters, or parameters that do not fit the robot.
        BehaviourError: a function named in the parameters cannot be loaded, or raises an exception.
    """
    checked = read_parameters(kind, parameters, where)
    try:
        return kind.make(checked, vehicle)
    except ParameterError as error:
        raise config_error(error, _origin(where), _PATH) from None


def check_settings(
    name: str, parameters: Mapping[str, Any], where: str | Origin, fleet: Sequence[Vehicle], circle: Circle
) -> None:
    """Refuse invalid parameters, and a behaviour that the fleet cannot run on the circle. No user code is loaded.

    Args:
        name: of the behaviour; a user's own is not checked.
        parameters: values by key.
        where: the file or order that they come from, for errors.
        fleet: the robots that are to do it.
        circle: the circle.

    Raises:
        ConfigError: no such behaviour, a wrong parameter, or one that does not fit the robots or the circle.
    """
    if ":" in name:
        return
    origin = _origin(where)
    kind = _find(name, origin)
    assert isinstance(kind, BehaviourKind)  # it is a built-in one
    try:
        kind.fits(read_parameters(kind, parameters, origin), circle, fleet)
    except ParameterError as error:
        raise config_error(error, origin, "" if error.what.startswith("circle.") else _PATH) from None


def check_behaviour(name: str, parameters: Mapping[str, Any], where: str | Origin, fleet: Sequence[Vehicle]) -> None:
    """Refuse, before anything starts, a behaviour that no robot could run. User code is loaded as on the robots.

    Args:
        name: of the behaviour.
        parameters: values by key; those of a user's own behaviour are not checked.
        where: the file or order that names it, for errors.
        fleet: the robots that are to do it.

    Raises:
        ConfigError: no such behaviour, a wrong parameter, or one that does not fit a robot.
    """
    origin = _origin(where)
    kind = _find(name, origin)
    if isinstance(kind, BehaviourKind):
        try:
            for vehicle in fleet:
                make_behaviour(kind, parameters, vehicle, origin)
        except BehaviourError as error:
            raise ConfigError(
                origin.at(_PATH), got=str(error), expected="a function that can be loaded and called"
            ) from None


def _find(name: str, origin: Origin) -> BehaviourKind | OwnBehaviour:
    try:
        return table.find(name)
    except BehaviourError as error:
        expected = f"one of {', '.join(table.names())}" if ":" not in name else f"one that loads: {error}"
        raise ConfigError(origin.at(f"{_PATH}.name"), got=repr(name), expected=expected) from None


def _origin(where: str | Origin) -> Origin:
    return where if isinstance(where, Origin) else Origin(where)
