"""What a scenario asks of its robots, read from its behaviour, for the score sheet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from muro_zenoh.config import Scenario, parameters_as
from muro_zenoh.control.importance import Importance
from muro_zenoh.errors import ConfigError
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
    """
    try:
        return _asked_of(scenario)
    except ValueError as error:
        raise ConfigError(
            f"{scenario.name}: behaviour", got=str(error), expected="parameters that fit together"
        ) from error


def _asked_of(scenario: Scenario) -> Asked:
    # Not before `muro run` has looked whether these are our agents, or a foreign package of that name.
    from agents.tasks.coverage import CoverageParameters
    from agents.tasks.dubins import DubinsParameters
    from agents.tasks.pursuit import PursuitParameters

    name, parameters = scenario.behaviour.name, scenario.behaviour.parameters
    where = f"{scenario.name}: behaviour"
    goals = {robot: scenario.goals.get(robot, ()) for robot in scenario.robots}
    if name == "circle":
        return Asked(follows_circle=True)
    if name == "pursuit":
        law = parameters_as(PursuitParameters, parameters, where).pursuit_law()
        # Who weighs the circle does not spread evenly round it.
        importance = law.importance if law.name == "importance" else None
        return Asked(follows_circle=True, spreads=importance is None, importance=importance)
    if name == "steer":
        return Asked(goals=goals)
    if name == "dubins":
        return Asked(goals=goals, v_min=parameters_as(DubinsParameters, parameters, where).v_min)
    if name == "coverage":
        wanted = parameters_as(CoverageParameters, parameters, where)
        deployment = Deployment(scenario.arena, wanted.density(), wanted.hold_time)
        return Asked(v_min=wanted.v_min, deployment=deployment)
    return Asked()
