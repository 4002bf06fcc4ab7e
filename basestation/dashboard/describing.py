"""What a page has to know of a fleet before it can show it: the robots, the cameras, what can be ordered with what."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Collection, Mapping
from typing import Annotated, Any, Final, Literal, get_args, get_origin

import numpy as np

from basestation.localization.floor_map import FloorMap
from muro_zenoh.behaviours import table
from muro_zenoh.behaviours.interface import Need
from muro_zenoh.config import Scenario
from muro_zenoh.config.cameras import camera_model
from muro_zenoh.config.fault_rows import targets
from muro_zenoh.config.faults import KINDS, RUN_KINDS, CameraDropoutFault, Fault, LinkFault, Place, RobotFault
from muro_zenoh.config.schema import REQUIRED, Field, fields_of
from muro_zenoh.quantities import Quantity, quantity_of

_EDGE: Final = 12
"""Points on each edge of a picture that its outline on the floor is drawn through."""

_TYPES: Final[Mapping[Any, str]] = {float: "number", int: "integer", bool: "boolean", str: "text", tuple: "array"}

_OWN_TYPES: Final = ((bool, "boolean"), ((int, float), "number"), ((tuple, list), "array"))
"""Of a value of a user's own parameter; a whole number may be meant as a number."""

_FAULT_FIELDS: Final = ("target", "at", "until", "duration")
"""What every fault has, and a page does not ask for among the numbers of its kind."""


def describe(scenario: Scenario) -> dict[str, Any]:
    """What does not change while a fleet runs.

    Args:
        scenario: the settings.

    Returns:
        The message ``hello`` of docs/page.md, without what depends on the client and on the run.
    """
    arena = scenario.arena
    return {
        "kind": "hello",
        "realm": scenario.bus.realm,
        "scenario": scenario.name,
        "arena": [arena.x_min, arena.y_min, arena.x_max, arena.y_max],
        "walls": [list(wall) for wall in scenario.walls],
        "robots": {
            name: {
                "radius": robot.radius,
                "v_max": robot.v_max,
                "omega_max": robot.omega_max,
                "margin": scenario.separation.margin if scenario.separation.enabled else 0.0,
            }
            for name, robot in scenario.robot.items()
        },
        "behaviours": {**{name: _behaviour(name) for name in table.names()}, **_own(scenario)},
        "cameras": {
            name: {"outline": outline(FloorMap(camera_model(name, settings, arena)), tag_height(scenario))}
            for name, settings in scenario.camera.items()
        },
    }


def describe_faults(scenario: Scenario) -> dict[str, Any]:
    """The faults that an operator may let happen in a run.

    Args:
        scenario: the settings.

    Returns:
        By kind: what it is, what it can befall, and its numbers.
    """
    return {kind: _fault(KINDS[kind], scenario) for kind in RUN_KINDS}


def _fault(kind: type[Fault], scenario: Scenario) -> dict[str, Any]:
    if issubclass(kind, CameraDropoutFault):
        places: Collection[Place] = (Place.CAMERAS, Place.CAMERA)
    elif issubclass(kind, RobotFault):
        places = kind.places
    elif issubclass(kind, LinkFault):
        places = (Place.AGENT,)
    else:  # the others that it can befall are no processes of a run
        places = (Place.AGENT, Place.BASESTATION, Place.ROUTER)
    numbers = {key: value for key, value in describe_section(kind).items() if key not in _FAULT_FIELDS}
    return {
        "doc": (inspect.getdoc(kind) or "").partition("\n\n")[0].replace("\n", " "),
        "targets": list(targets(places, scenario.robots, tuple(scenario.camera))),
        "parameters": numbers,
    }


def tag_height(scenario: Scenario) -> float:
    """The height of the plane in which pictures are shown: the tags', for these are where the robots are seen [m].

    Args:
        scenario: the settings.
    """
    return float(np.median([robot.tag_z for robot in scenario.robot.values()]))


def outline(view: FloorMap, height: float) -> list[list[float]]:
    """What a camera sees of a plane, as a polygon [m, world]; empty when its picture shows the horizon.

    Args:
        view: the camera.
        height: of the plane [m].
    """
    steps = np.linspace(0.0, 1.0, _EDGE, endpoint=False)
    right, lower = view.camera.width - 1.0, view.camera.height - 1.0
    edges = [
        np.column_stack((right * steps, 0.0 * steps)),
        np.column_stack((0.0 * steps + right, lower * steps)),
        np.column_stack((right * (1.0 - steps), 0.0 * steps + lower)),
        np.column_stack((0.0 * steps, lower * (1.0 - steps))),
    ]
    points = view.to_metres(np.concatenate(edges), height)
    corners: list[list[float]] = np.round(points, 4).tolist()
    return corners if np.isfinite(points).all() else []


def _behaviour(name: str) -> dict[str, Any]:
    kind = table.built_in(name)
    return {
        "summary": kind.summary,
        "needs": sorted(need.value for need in kind.needs),
        "parameters": describe_section(kind.parameters),
    }


def _own(scenario: Scenario) -> dict[str, Any]:
    """The scenario's behaviour when it is a user's own: its parameters are known by their values alone, and what it
    needs is not."""
    settings = scenario.behaviour
    if ":" not in settings.name:
        return {}
    parameters = {}
    for key, value in settings.parameters.items():
        kind = next((word for of, word in _OWN_TYPES if isinstance(value, of)), "text")
        limits = dict.fromkeys(("at_least", "above", "at_most", "below", "when"))
        parameters[key] = {
            "type": kind,
            "default": _plain(value),
            "unit": "",
            "choices": [],
            "doc": "",
            "required": False,
            **limits,
        }
    needs = sorted(need.value for need in Need if need not in (Need.GOALS, Need.HAND))
    return {settings.name: {"summary": "the scenario's own behaviour", "needs": needs, "parameters": parameters}}


def describe_section(kind: Any) -> dict[str, dict[str, Any]]:
    """The keys of a section of the settings, those of nested ones among them.

    Args:
        kind: the section's type.

    Returns:
        By key: type, default, unit, limits, what it means, and the choice that it depends on.
    """
    keys: dict[str, dict[str, Any]] = {}
    _collect(kind, None, None, keys)
    return keys


def _collect(kind: Any, default: Any, when: list[Any] | None, keys: dict[str, dict[str, Any]]) -> None:
    docs = _documented(kind)
    for field in fields_of(kind):
        value = field.default if default is None else getattr(default, field.name)
        if field.is_key:
            choices = {"type": "choice", "choices": list(field.lifted)} if field.lifted else {}
            shown = getattr(value, "NAME", None) if field.lifted else value
            one = {**_parameter(field, shown), **choices, "doc": docs.get(field.name, ""), "when": when}
            keys[field.name] = _merged(keys.get(field.name), one)
        for name, option in field.lifted.items():
            condition = [field.name, [name]] if name else when
            _collect(option, value if type(value) is option else None, condition, keys)


def _merged(known: dict[str, Any] | None, one: dict[str, Any]) -> dict[str, Any]:
    """A key that several options of a choice have: with the first one's default, and the names of all of them."""
    if known is None:
        return one
    names = [*known["when"][1], *one["when"][1]] if known["when"] and one["when"] else None
    when = [known["when"][0], names] if names else None
    return {**known, "doc": known["doc"] or one["doc"], "when": when}


def _parameter(field: Field, default: Any) -> dict[str, Any]:
    quantity = quantity_of(field.hint) or Quantity()
    kind = next((_TYPES[t] for t in _bare(field.hint) if t in _TYPES), "text")
    choices = [value for part in _bare(field.hint) if get_origin(part) is Literal for value in get_args(part)]
    return {
        "type": "choice" if choices else kind,
        "default": None if default is REQUIRED else _plain(default),
        "required": default is REQUIRED,
        "unit": quantity.unit,
        "at_least": _plain(quantity.at_least),
        "above": _plain(quantity.above),
        "at_most": _plain(quantity.at_most),
        "below": _plain(quantity.below),
        "choices": choices,
    }


def _bare(hint: Any) -> list[Any]:
    """The types of a hint, without None and annotations; of a tuple, ``tuple``."""
    if get_origin(hint) is Annotated:
        return _bare(get_args(hint)[0])
    if get_origin(hint) is tuple:
        return [tuple]
    if get_origin(hint) is Literal or not get_args(hint):
        return [hint]
    return [bare for part in get_args(hint) for bare in _bare(part) if bare is not type(None)]


def _plain(value: Any) -> Any:
    """A value as MessagePack has it; an infinite number is no limit."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return list(value) if isinstance(value, tuple) else value


def _documented(kind: Any) -> dict[str, str]:
    """What the docstrings of a class, and of those that it inherits from, say of each field."""
    docs: dict[str, str] = {}
    for ancestor in reversed(kind.__mro__[:-1]):
        found = re.search(
            r"^(?:Args|Attributes):\n((?: .*\n?|\n)+)", inspect.cleandoc(ancestor.__doc__ or ""), re.MULTILINE
        )
        name = ""
        for line in found[1].splitlines() if found else ():
            begins = re.fullmatch(r"    (\w+): (.*)", line)
            if begins:
                name, docs[begins[1]] = begins[1], begins[2]
            elif name:
                docs[name] = f"{docs[name]} {line.strip()}".strip()
    return docs
