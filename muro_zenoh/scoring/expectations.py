"""What the robots of a scenario should achieve, for the score sheet; from the table of behaviours."""

from __future__ import annotations

from muro_zenoh.behaviours import table
from muro_zenoh.behaviours.interface import BehaviourKind, Expectation, Need
from muro_zenoh.config import Scenario, read_parameters


def expectation_of(scenario: Scenario) -> Expectation:
    """The expectation of a scenario; nothing for a user's own behaviour.

    Args:
        scenario: the scenario.

    Raises:
        ConfigError: the behaviour does not take these parameters, or they are inconsistent.
        BehaviourError: no such behaviour.
    """
    kind = table.find(scenario.behaviour.name)
    if not isinstance(kind, BehaviourKind):
        return Expectation()
    parameters = read_parameters(kind, scenario.behaviour.parameters, scenario.name)
    expected = kind.expects(parameters, scenario.vehicle(scenario.robots[0]))
    if Need.GOALS not in kind.needs:
        return expected
    return expected._replace(goals={robot: scenario.goals.get(robot, ()) for robot in scenario.robots})
