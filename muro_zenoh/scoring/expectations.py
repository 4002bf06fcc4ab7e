"""What the robots of a scenario should achieve, for the score sheet; from the table of behaviours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from muro_zenoh.behaviours import table
from muro_zenoh.behaviours.interface import BehaviourKind, Expectation
from muro_zenoh.config import Scenario, read_parameters
from muro_zenoh.control.importance import Importance
from muro_zenoh.scoring.deployment import Deployment


class Expectations(NamedTuple):
    """What the robots should achieve.

    Attributes:
        follows_circle: whether they follow the circle.
        spreads: whether they spread evenly on it.
        importance: where on the circle they should stay longer; None for no weighting.
        goals: goals to visit in order, by robot.
        v_min: speed on the arcs of planned paths [m/s]; None when they plan none.
        deployment: the floor to cover; None when they cover none.
    """

    follows_circle: bool = False
    spreads: bool = False
    importance: Importance | None = None
    goals: Mapping[str, Sequence[Sequence[float]]] = {}
    v_min: float | None = None
    deployment: Deployment | None = None


def expectations_of(scenario: Scenario) -> Expectations:
    """The expectations of a scenario; none for a user's own behaviour.

    Args:
        scenario: the scenario.

    Raises:
        ConfigError: the behaviour does not take these parameters, or they are inconsistent.
        BehaviourError: no such behaviour.
    """
    expected = _expected(scenario)
    deployment = expected.deployment
    return Expectations(
        expected.on_circle,
        expected.evenly,
        expected.importance,
        {robot: scenario.goals.get(robot, ()) for robot in scenario.robots} if expected.goals else {},
        expected.v_min,
        Deployment(scenario.vehicle(scenario.robots[0]).arena, deployment.density, deployment.hold_time)
        if deployment
        else None,
    )


def _expected(scenario: Scenario) -> Expectation:
    kind = table.find(scenario.behaviour.name)
    if not isinstance(kind, BehaviourKind):
        return Expectation()
    return kind.expects(read_parameters(kind, scenario.behaviour.parameters, scenario.name))
