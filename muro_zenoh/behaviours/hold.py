"""Stand still."""

from __future__ import annotations

from dataclasses import dataclass

from muro_zenoh.behaviours.interface import Behaviour, BehaviourKind, Intent, Seen, Vehicle, hold


@dataclass(frozen=True, slots=True)
class Parameters:
    """No parameters."""


class Hold(Behaviour):
    """Stand still until another behaviour is ordered."""

    def step(self, seen: Seen) -> Intent:
        """Stand still.

        Args:
            seen: not used.
        """
        return hold("the behaviour is hold")


def make(parameters: Parameters, vehicle: Vehicle) -> Hold:
    """The behaviour of one robot.

    Args:
        parameters: none.
        vehicle: not used.
    """
    return Hold()


BEHAVIOUR = BehaviourKind(Parameters, make, "stand still")
