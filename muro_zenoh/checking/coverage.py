"""Which faults met which processes, and in which state the robots were: the table that shows what a check has tried."""

from __future__ import annotations

from collections import Counter
from enum import StrEnum
from typing import Final, NamedTuple

from muro_zenoh.config.faults import KINDS, Fault, Place


class Activity(StrEnum):
    """What a robot does when a fault begins to take effect."""

    STARTING = "starting"
    DRIVING = "driving"
    HOLDING = "holding"
    STOPPED = "stopped"


ROLES: Final = {
    Place.ROBOT: "robot",
    Place.AGENT: "agent",
    Place.BASE: "base",
    Place.BASESTATION: "basestation",
    Place.CAMERAS: "camera",
    Place.CAMERA: "camera",
    Place.ROUTER: "router",
}
"""The roles in the table; one camera and all of them are one role."""


class Cell(NamedTuple):
    """A ``kind`` of fault, the ``role`` of what it befell, and the ``activity`` of a robot that it concerned."""

    kind: str
    role: str
    activity: Activity


CELLS: Final = tuple(
    Cell(kind, role, activity)
    for kind, fault in KINDS.items()
    for role in dict.fromkeys(ROLES[place] for place in fault.places)
    for activity in Activity
)
"""Every cell. All of them can occur: a thousand random trials have met each (docs/checking.md)."""


def cell_of(fault: Fault, activity: Activity) -> Cell:
    """The cell of a fault.

    Args:
        fault: the fault.
        activity: what a robot that it concerns did.
    """
    return Cell(fault.kind, ROLES[fault.place], activity)


def as_nested(met: Counter[Cell]) -> dict[str, dict[str, dict[str, int]]]:
    """The table for JSON: how often, by kind, role and activity; every cell that can occur is in it.

    Args:
        met: how often each has occurred.
    """
    table: dict[str, dict[str, dict[str, int]]] = {}
    for cell in CELLS:
        table.setdefault(cell.kind, {}).setdefault(cell.role, {})[str(cell.activity)] = met[cell]
    return table
