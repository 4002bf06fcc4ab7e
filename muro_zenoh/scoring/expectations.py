"""What a scenario asks of its robots, for the score sheet: read from the table of behaviours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from muro_zenoh.behaviours import table
from muro_zenoh.behaviours.interface import BehaviourKind, Expectation
from muro_zenoh.config import Scenario, read_parameters
from muro_zenoh.control.importance import Importance
from muro_zenoh.scoring.deployment import Deployment


class Asked(NamedTuple):
    """What the robots shall do.

    Attributes:
        follows_circle: follow the circle ...
        spreads: ... and spread evenly round it ...
        importance: ... or stay longer where this is greater.
        goals: go to these, one after the other, by robot.
        v_min: along paths, on whose arcs they drive so fast [m/s].
        deployment: cover the floor.
    """

    follows_circle: bool = False
    spreads: bool = False
    importance: Importance | None = None
    goals: Mapping[str, Sequence[Sequence[float]]] = {}
    v_min: float | None = None
    deployment: Deployment | None = None


def asked_of(scenario: Scenario) -> Asked:
    """What a scenario asks of its robots; nothing, for a behaviour that is a user's own.

    Args:
        scenario: the scenario.

    Raises:
        ConfigError: the behaviour does not take these parameters, or they do not fit together.
        BehaviourError: no such behaviour.
    """
    expected = _expected(scenario)
    asked = expected.deployment
    return Asked(
        expected.on_circle,
        expected.evenly,
        expected.importance,
        {robot: scenario.goals.get(robot, ()) for robot in scenario.robots} if expected.goals else {},
        expected.v_min,
        Deployment(scenario.vehicle(scenario.robots[0]).arena, asked.density, asked.hold_time) if asked else None,
    )


def _expected(scenario: Scenario) -> Expectation:
    kind = table.find(scenario.behaviour.name)
    if not isinstance(kind, BehaviourKind):
        return Expectation()
    return kind.expects(read_parameters(kind, scenario.behaviour.parameters, scenario.name))
