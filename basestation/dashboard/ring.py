"""The ring that robots spread out on: which of them do, and where on it they stay longer."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Final

import numpy as np

from muro_zenoh.behaviours import table
from muro_zenoh.behaviours.interface import BehaviourKind, Expectation
from muro_zenoh.config import Scenario, read_parameters
from muro_zenoh.errors import MuroError
from muro_zenoh.messages import Behaviour, Value

log = logging.getLogger(__name__)

_ANGLES: Final = 64


class RingOf:
    """What the behaviours of a fleet say of its ring; looked up once for each behaviour that is ordered.

    Args:
        scenario: the settings.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._known: dict[str, tuple[str, Mapping[str, Value], Expectation, list[float] | None]] = {}

    def spreading(self, behaviours: Mapping[str, Behaviour]) -> list[str]:
        """The robots that are to spread out on the circle, evenly or by its importance.

        Args:
            behaviours: what each robot is to do.
        """
        expected = {name: self._look(name, behaviours.get(name))[0] for name in self._scenario.robots}
        return [name for name, one in expected.items() if one.spreads or one.importance is not None]

    def importance(self, behaviours: Mapping[str, Behaviour]) -> list[float] | None:
        """The importance function at equal steps round the circle, its mean 1; None while no robot follows one.

        Args:
            behaviours: what each robot is to do.
        """
        found = (self._look(name, behaviours.get(name))[1] for name in self._scenario.robots)
        return next((values for values in found if values is not None), None)

    def _look(self, name: str, behaviour: Behaviour | None) -> tuple[Expectation, list[float] | None]:
        if behaviour is None or ":" in behaviour.behaviour:  # a user's own is not loaded into the page's process
            return Expectation(), None
        known = self._known.get(name)
        if known is None or known[:2] != (behaviour.behaviour, behaviour.parameters):
            expected = self._expected(name, behaviour)
            known = self._known[name] = behaviour.behaviour, behaviour.parameters, expected, _sampled(expected)
        return known[2:]

    def _expected(self, name: str, behaviour: Behaviour) -> Expectation:
        try:
            kind = table.find(behaviour.behaviour)
            assert isinstance(kind, BehaviourKind)
            parameters = read_parameters(kind, behaviour.parameters, "behaviour")
            return kind.expects(parameters, self._scenario.vehicle(name))
        except (MuroError, ValueError) as error:
            log.warning("behaviour %s of %s cannot be shown: %s", behaviour.behaviour, name, error)
            return Expectation()


def _sampled(expected: Expectation) -> list[float] | None:
    if expected.importance is None:
        return None
    values: list[float] = np.round(expected.importance.density(np.arange(_ANGLES) * 2.0 * np.pi / _ANGLES), 4).tolist()
    return values
